"""Test a run by a protocol; write `evaluations/<protocol>/{episodes.csv, summary.json, trajectories.npz}`."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from auvbench import registry
from auvbench.agents import base as agents
from auvbench.agents.base import Agent
from auvbench.config import complete, schema
from auvbench.config.algorithms import learns
from auvbench.envs.simulator_factory import at_frequency
from auvbench.errors import AgentError, AuvbenchError, AuvbenchWarning, RunError
from auvbench.evaluation import parts, sealed
from auvbench.evaluation.protocol import (
    ResolvedCondition,
    as_played,
    fingerprint,
    fingerprint_parts,
    left_out,
    resolve_conditions,
)
from auvbench.evaluation.rollout import Rollout, roll_out, time_actions
from auvbench.runs import history, identity, integrity, lock, provenance
from auvbench.runs.atomic_io import as_json, make_folder, storage, write_atomic
from auvbench.runs.directory import RunDirectory, now
from auvbench.runs.plan import load_config
from auvbench.untrusted import path_safety
from auvbench.vehicles import sheet


def read_summary(run: RunDirectory, protocol: str) -> dict[str, Any] | None:
    """Return summary.json of an evaluation; None if it is missing or damaged."""
    try:
        return integrity.read(run.evaluation(protocol) / "summary.json", integrity.Summary)
    except (OSError, ValueError):
        return None


def is_done(run: RunDirectory, protocol: schema.Protocol) -> bool:
    """Return whether the run has a valid evaluation by this protocol (see `stale`)."""
    return stale(run, protocol) == ""


def stale(run: RunDirectory, protocol: schema.Protocol) -> str | None:
    """Return why an evaluation must be repeated; '' if it is valid, None if it is missing.

    Raises:
        RunError, ConfigError: see `evaluate`.
    """
    folder = run.evaluation(protocol.name)
    if not (folder / "summary.json").exists():
        return None
    summary = read_summary(run, protocol.name)
    if summary is None:
        return "its summary is damaged"
    if summary["run"] != run.id:
        return f"its summary belongs to the run {summary['run']}"
    if lost := integrity.lacking(folder, summary):
        return lost
    if (
        isinstance(protocol, sealed.Protocol)
        and (summary.get("sealed") or {}).get("sha256") != protocol.sha256
    ):
        return "the files of its sealed protocol differ"
    if summary["model"] != integrity.digests(run.manifest(), "model/"):
        return "the run's model has changed since the test"
    played = as_played(resolve_conditions(protocol, run.check()), summary.get("clocks") or {})
    with _named_packages(run):
        current = fingerprint_parts(protocol, played)
    recorded = summary["fingerprint_parts"]
    if recorded["scenarios"] != current["scenarios"]:
        return "its scenarios differ: the protocol, the vehicle or the code that draws scenarios has changed since the test"
    if recorded["outcomes"] != current["outcomes"]:
        return (
            "the same commands now have other outcomes: the simulator or the task has changed since the test"
        )
    return ""


def refuse_incomplete(run: RunDirectory) -> None:
    """Raise RunError if a run is incomplete."""
    if (state := run.manifest()["state"]) != "complete":
        raise RunError(f"{run.path}: the run is {state}, not complete; finish it with auvbench train")


def make_agent(run: RunDirectory, frequency: float, trained: schema.TrainConfig | None = None) -> Agent:
    """Return a new agent of a run for a test.

    The agent is made for the run's vehicle, even if the test has a different vehicle.

    Args:
        run: complete run.
        frequency: step frequency of the test, Hz.
        trained: the run's configuration, if it is already loaded.
    """
    config = at_frequency(trained or load_config(run), frequency)
    vehicle = sheet.load(config.vehicle)
    agent = agents.make(config, vehicle)
    load = getattr(agent, "load", None)
    if load is not None:
        _check_model(
            run, again="repeats its training from the last checkpoint" if learns(config.algo) else ""
        )
        load(run.model)
    return agent


def _check_model(run: RunDirectory, again: str) -> None:
    """Check the files of a run's model against their digests.

    Args:
        run: run of the model.
        again: text for the error message on how `auvbench resume` restores lost files; '' if it cannot restore them.

    Raises:
        RunError: a file is missing or damaged.
    """
    if lost := integrity.lacking(run.path, run.manifest(), "model/"):
        hint = (
            f"auvbench resume {run.path} {again}"
            if again
            else "repeat the run's auvbench train command to restore the file"
        )
        raise RunError(f"{run.path}: {lost}; {hint}")


Report = Callable[[str, int], None]
"""function called with a condition's name and the number of its episodes that have just ended; 0 at the condition's start"""

Roll = Callable[[RunDirectory, schema.Protocol, ResolvedCondition, Report], Rollout]
"""function that rolls out one condition of a test"""


def in_process(trained: schema.TrainConfig) -> Roll:
    """Return a function that rolls out all episodes of a condition as batches in this process.

    `trained` is the configuration of the run.
    """

    def roll(
        run: RunDirectory, protocol: schema.Protocol, condition: ResolvedCondition, report: Report
    ) -> Rollout:
        return roll_out(
            condition.config,
            make_agent(run, condition.config.step.frequency, trained),
            episodes=np.arange(protocol.episodes),
            seed=protocol.seed,
            batch=protocol.batch,
            trajectories=protocol.trajectories,
            scenarios=protocol.scenarios,
            report=lambda count: report(condition.name, count),
        )

    return roll


def evaluate(
    run: RunDirectory,
    protocol: schema.Protocol,
    report: Report = lambda *_: None,
    *,
    unless_done: bool = False,
    roll: Roll | None = None,
    conditions: list[ResolvedCondition] | None = None,
) -> dict[str, Any] | None:
    """Test a complete run, write its results and return the summary.

    A lock prevents two processes from testing a run by the same protocol at the same time.

    Args:
        run: run to test.
        protocol: protocol of the test.
        report: function called when a condition starts or episodes end.
        unless_done: whether to return None if the test is already finished, and to reuse the saved parts of an
            interrupted test (`parts`).
        roll: function that rolls out each condition; it must give the same rows as `in_process`, the default.
        conditions: result of `resolve_conditions`, if the caller has it already.

    Raises:
        RunError: the run is incomplete, its files are damaged, or another process is testing it.
        TrainingError: the disk is full, read-only or failing.
    """
    refuse_incomplete(run)
    path_safety.refuse_links(run.path)
    with _locked(run, protocol.name):
        if unless_done and is_done(run, protocol):
            return None
        saved = parts.SavedParts(_own_folder(run, protocol.name) / "parts", run, protocol)
        if not unless_done:
            saved.forget()
        with _named_packages(run):
            return _evaluate(run, protocol, report, roll, saved, conditions)


def _own_folder(run: RunDirectory, protocol: str) -> Path:
    """Return the folder of a test's lock and parts, `evaluations/.<protocol>`.

    The lock and the parts are not in `evaluations/<protocol>`, because that folder is replaced as a whole.
    """
    return run.evaluation(protocol).with_name(f".{protocol}")


def _locked(run: RunDirectory, protocol: str) -> lock.RunLock:
    """Lock one evaluation."""
    place = _own_folder(run, protocol)
    try:
        make_folder(place)
        return lock.acquire(place)
    except lock.RunHeldError as error:
        raise lock.RunHeldError(
            place,
            error.holder,
            f"{run.id}: skipped, because {error.holder} is testing it by the protocol {protocol}",
        ) from error
    except OSError as error:
        raise RunError(f"{place} cannot be written: {error.strerror or error}") from error


def _evaluate(
    run: RunDirectory,
    protocol: schema.Protocol,
    report: Report,
    roll: Roll | None,
    saved: parts.SavedParts,
    conditions: list[ResolvedCondition] | None,
) -> dict[str, Any]:
    roll = roll or in_process(load_config(run))
    if conditions is None:
        conditions = resolve_conditions(protocol, run.check())
    results: list[parts.Part] = []
    clocks: dict[str, str] = {}
    for number, condition in enumerate(conditions):
        report(condition.name, 0)
        served = registry.SIMULATORS[condition.config.simulator.name].served
        # Rows from a server's simulation depend on the server's clock. This clock is known only after the rollout, so
        # saved parts of such a condition are not reused.
        part = None if served else saved.read(number, condition)
        if part is None:
            begun = time.monotonic()
            part = parts.of(condition, roll(run, protocol, condition, report))
            if not served and number + 1 < len(conditions) and time.monotonic() - begun >= parts.SLOW:
                saved.write(number, condition, part)
        else:
            report(condition.name, protocol.episodes)
        results.append(part)
        if served:
            clocks[condition.name] = registry.resolve(served).clock()
    conditions = as_played(conditions, clocks)
    summary: dict[str, Any] = {
        "schema_version": identity.SCHEMA_VERSION,
        "protocol": protocol.name,
        "fingerprint": fingerprint(protocol, conditions),
        "fingerprint_parts": fingerprint_parts(protocol, conditions),
        "run": run.id,
        # The digests of the model's files link a test to the weights that were tested.
        "model": integrity.digests(run.manifest(), "model/"),
        "seed": protocol.seed,
        "scenarios": protocol.scenarios,
        # The results of a served simulation depend on the clock that timed its steps, so each clock is recorded.
        **({"clocks": clocks} if clocks else {}),
        **({"sealed": _seal(run, protocol, conditions)} if isinstance(protocol, sealed.Protocol) else {}),
        "conditions": [part.summary for part in results],
        "inference": None,
        "created": now(),
        "versions": provenance.versions() | complete.releases(conditions[0].config),
    }
    folder = run.evaluation(protocol.name)
    files = {"episodes.csv": parts.rows_of(results), "trajectories.npz": parts.arrays_of(results)}
    summary[integrity.FILES] = integrity.replace_sealed(folder, "summary.json", summary, files)
    saved.forget()
    history.append(run.path.absolute().parent, _tested(run, summary))
    # Write the rows before timing the actions: computing the rows may have taken hours, and the timing may fail.
    summary["inference"] = _time(run, conditions[0].config)
    with storage(f"cannot write {folder}"):
        write_atomic(folder / "summary.json", as_json(integrity.sealed(summary)))
    return summary


def _seal(
    run: RunDirectory, protocol: sealed.Protocol, conditions: list[ResolvedCondition]
) -> dict[str, Any]:
    """Return the digests of a sealed protocol's files, and the conditions that were not tested."""
    left_out_conditions = left_out(protocol, conditions, run.config())
    return {"sha256": protocol.sha256, "not_tested": [*protocol.not_tested, *left_out_conditions]}


def _tested(run: RunDirectory, summary: dict[str, Any]) -> history.Line:
    """Return the history line of a test."""
    manifest = run.manifest()
    return history.Line(
        summary["created"],
        history.TESTED,
        run.id,
        manifest["algo"],
        manifest["seed"],
        manifest["steps"],
        summary["protocol"],
        summary["fingerprint"],
        sum(condition["episodes"] for condition in summary["conditions"]),
    )


def _time(run: RunDirectory, config: schema.TrainConfig) -> dict[str, Any] | None:
    """Time the actions of the run's agent; on failure, warn and return None."""
    try:
        agent = make_agent(run, config.step.frequency)
        # An agent with its own simulator also computes outside its actions, so its actions are not timed.
        return None if hasattr(agent, "simulator") else time_actions(agent, config)
    except Exception as error:  # an installed agent may raise any exception
        reason = f"{run.id}: could not time the agent's actions: {registry.describe_error(error)}"
        warnings.warn(AuvbenchWarning(reason), stacklevel=2)
        return None


@contextmanager
def _named_packages(run: RunDirectory) -> Iterator[None]:
    """Add the run's id, and the names of its packages, to an error in a package's code.

    Raises:
        AgentError: code of an installed package fails.
    """
    try:
        yield
    except AgentError as error:
        raise AgentError(f"{run.id}: {error}") from error
    except AuvbenchError:
        raise
    except Exception as error:
        releases = [f"{name}=={version}" for name, version in complete.releases(run.config()).items()]
        if not releases:
            raise
        raise AgentError(
            f"{run.id}, with {' and '.join(releases)}: {registry.describe_error(error)}"
        ) from error
