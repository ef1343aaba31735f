"""Applying a protocol to a run: `evaluations/<protocol>/{episodes.csv, summary.json, trajectories.npz}`."""

from __future__ import annotations

import csv
import json
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.agents.base import CONTROLLERS, Agent, learns, resolve
from auvbench.config import schema
from auvbench.envs.batch import at_frequency
from auvbench.errors import RunError
from auvbench.evaluation.protocol import Circumstance, circumstances, fingerprint
from auvbench.evaluation.rollout import Rollout, roll_out
from auvbench.runs import provenance
from auvbench.runs.directory import RunDirectory, now
from auvbench.runs.files import write_json
from auvbench.runs.plan import load_config
from auvbench.tasks.record import OUTCOMES, RECORD_COLUMNS, Record
from auvbench.vehicles import sheet

SCHEMA_VERSION = 1
COLUMNS = ("condition", "frequency_hz", *RECORD_COLUMNS)

MEANS = RECORD_COLUMNS[RECORD_COLUMNS.index("steps") : RECORD_COLUMNS.index("waypoint_x_m")]
"""The columns of a record that are averaged in summary.json: all but the scenario's own."""


def read_summary(run: RunDirectory, protocol: str) -> dict[str, Any] | None:
    """summary.json of an evaluation that is there and whole, else None."""
    try:
        summary = json.loads((run.evaluation(protocol) / "summary.json").read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError):
        return None
    if not isinstance(summary, dict) or summary.get("schema_version") != SCHEMA_VERSION:
        return None
    return summary


def is_done(run: RunDirectory, protocol: schema.Protocol) -> bool:
    """Whether the run has this protocol's rows, of these very scenarios."""
    summary = read_summary(run, protocol.name)
    if summary is None or not (run.evaluation(protocol.name) / "episodes.csv").is_file():
        return False
    expected = fingerprint(protocol, circumstances(protocol, run.check()))
    return bool(summary.get("fingerprint") == expected)


def make_agent(run: RunDirectory, frequency: float) -> Agent:
    """The run's agent for a test; a fresh one each time, nothing leaks from one test into the next.

    It knows the vehicle that it was made for, whatever vehicle it is tested on.
    """
    config = at_frequency(load_config(run), frequency)
    vehicle = sheet.load(config.vehicle)
    if learns(config.algo.agent):
        from auvbench.agents.learned.learners import LearnedPolicy

        return LearnedPolicy(config, run.model, len(vehicle.actuators))
    agent: Agent = resolve(CONTROLLERS[config.algo.agent])(config, vehicle)
    return agent


def evaluate(
    run: RunDirectory, protocol: schema.Protocol, report: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Tests a complete run and writes its results; returns the summary.

    Raises:
        RunError: the run is not complete, or its files are damaged.
    """
    state = run.manifest()["state"]
    if state != "complete":
        raise RunError(f"{run.path}: {state}, not complete; auvbench train finishes it")
    conditions = circumstances(protocol, run.check())
    rollouts: list[tuple[Circumstance, Rollout]] = []
    for condition in conditions:
        if report is not None:
            report(condition.name)
        agent = make_agent(run, condition.config.step.frequency)
        rollouts.append(
            (
                condition,
                roll_out(
                    condition.config,
                    agent,
                    episodes=np.arange(protocol.episodes),
                    seed=protocol.seed,
                    batch=protocol.batch,
                    trajectories=protocol.trajectories,
                    scenarios=protocol.scenarios,
                ),
            )
        )
    summary = {
        "schema_version": SCHEMA_VERSION,
        "protocol": protocol.name,
        "fingerprint": fingerprint(protocol, conditions),
        "run": run.id,
        "seed": protocol.seed,
        "conditions": [_condition_summary(c, r.records) for c, r in rollouts],
        "created": now(),
        "versions": provenance.versions(),
    }
    _write(run.evaluation(protocol.name), summary, rollouts)
    return summary


def _condition_summary(condition: Circumstance, records: list[Record]) -> dict[str, Any]:
    counts = Counter(record["outcome"] for record in records)
    n = len(records)
    rates = {f"{outcome}_rate": counts[outcome] / n for outcome in OUTCOMES}
    means = {f"mean_{name}": float(np.mean([float(r[name]) for r in records])) for name in MEANS}
    return {
        "name": condition.name,
        "frequency_hz": condition.config.step.frequency,
        "episodes": n,
        **rates,
        **means,
    }


def _write(folder: Path, summary: dict[str, Any], rollouts: list[tuple[Circumstance, Rollout]]) -> None:
    """Staged in a folder beside and renamed, so that an evaluation is there whole or not at all."""
    staged = folder.with_name(f".{folder.name}.staged")
    shutil.rmtree(staged, ignore_errors=True)
    staged.mkdir(parents=True)
    with open(staged / "episodes.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for condition, rollout in rollouts:
            for record in rollout.records:
                frequency = condition.config.step.frequency
                writer.writerow((condition.name, frequency, *(record[name] for name in RECORD_COLUMNS)))
    arrays = {
        f"{name}_{condition.name}_{episode}": array
        for condition, rollout in rollouts
        for episode, path in rollout.trajectories.items()
        for name, array in path.arrays(rollout.duration).items()
    }
    np.savez_compressed(staged / "trajectories.npz", **arrays)  # type: ignore[arg-type]
    write_json(staged / "summary.json", summary)
    shutil.rmtree(folder, ignore_errors=True)
    staged.rename(folder)
