"""Puts runs together into agents: the seeds of one configuration, paired with all others by test scenario."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis.labels import labels, part, sort_key
from auvbench.analysis.model import Agent, Problem, RunRecord
from auvbench.errors import ReportError, closest
from auvbench.tasks.record import OUTCOMES

DEFAULT_GROUPING = ("algo.name", "reward.k", "step.frequency")

NEUTRAL = ("seed", "name", "output", "launcher.", "simulator.threads", "train.checkpoint.", "train.progress")
"""keys in which the runs of one agent may differ: they do not change what it can do"""

NOT_METRICS = ("condition", "outcome", "episode", "environment")


def agents(
    runs: Sequence[RunRecord],
    by: Sequence[str] = DEFAULT_GROUPING,
    protocol: str = "test",
    condition: str = "nominal",
) -> tuple[list[Agent], list[Problem]]:
    """Groups evaluated runs by the values of some configuration keys.

    Args:
        runs: as `load` returns them.
        by: configuration keys; a group's short name stands for its choice (`algo` for `algo.name`).
        protocol: name of the protocol.
        condition: name of the condition within it.

    Returns:
        the agents in the order of their keys, and what is missing, foreign or mixed. `Agent.metrics` has
        every numeric column of episodes.csv and `time_to_goal_s` (NaN where the episode was no success).

    Raises:
        ReportError: an unknown key, protocol or condition, or no run that can be reported.
    """
    keys = {_short(name): _resolve(name, runs) for name in by}
    rows, problems = _rows(runs, protocol, condition)
    cells: dict[tuple[str, ...], list[RunRecord]] = {}
    for run in runs:
        cells.setdefault(_cell(run, keys), []).append(run)
    groups = [[run for run in cell if run.id in rows] for cell in cells.values()]
    groups = sorted(filter(None, groups), key=lambda group: sort_key(_key(group[0], keys)))
    names = labels([_key(group[0], keys) for group in groups], [_learns(group[0]) for group in groups])
    result = []
    for label, group in zip(names, groups, strict=True):
        group.sort(key=lambda run: (run.seed, run.id))
        problems += _mixed(label, group, set(keys.values()))
        result.append(_agent(label, _key(group[0], keys), group, [rows[run.id] for run in group], protocol))
    return result, problems + _missing_cells(runs, keys)


def _short(name: str) -> str:
    return name.removesuffix(".name")


def _resolve(name: str, runs: Sequence[RunRecord]) -> str:
    """The configuration key that a name of --group-by stands for."""
    known: set[str] = set().union(*(run.config.keys() for run in runs))
    for candidate in (name, f"{name}.name"):
        if candidate in known:
            return candidate
    raise ReportError(f"no run has the configuration key {name!r}; {closest(name, known | {'algo'})}")


def _key(run: RunRecord, keys: Mapping[str, str]) -> dict[str, Any]:
    return {short: _level(run, key) for short, key in keys.items()}


def _level(run: RunRecord, key: str) -> Any:
    """A value of the configuration as a level of a factor: a list (noise.sensor) as its text, to look it up by."""
    value = run.config.get(key)
    return str(value) if isinstance(value, list) else value


def _cell(run: RunRecord, keys: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(str(value) for value in _key(run, keys).values())


def _learns(run: RunRecord) -> bool:
    return bool(run.manifest.get("steps")) or (run.directory / "train" / "episodes.csv").is_file()


def _rows(
    runs: Sequence[RunRecord], protocol: str, condition: str
) -> tuple[dict[str, pd.DataFrame], list[Problem]]:
    """The condition's episodes by run id, all of the same scenarios in the same order."""
    evaluated = [run for run in runs if protocol in run.evaluations]
    if not evaluated:
        raise ReportError(f"none of the {len(runs)} runs has a usable evaluation by protocol {protocol!r}")
    kept, problems = _one_fingerprint(evaluated, protocol)
    rows = {}
    for run in kept:
        frame = run.evaluations[protocol].episodes
        here = frame["condition"].to_numpy() == condition
        if here.any():
            part_of = frame if here.all() else frame[here]
            in_order = part_of["episode"].is_monotonic_increasing
            rows[run.id] = part_of if in_order else part_of.sort_values("episode", kind="stable")
        else:
            problems.append(
                Problem(run.id, "missing", f"evaluation {protocol} has no condition {condition!r}")
            )
    if not rows:
        conditions = {str(name) for run in kept for name in run.evaluations[protocol].episodes["condition"]}
        raise ReportError(
            f"protocol {protocol} has no condition {condition!r}; {closest(condition, conditions)}"
        )
    return _same_episodes(rows, problems), problems


def _one_fingerprint(runs: Sequence[RunRecord], protocol: str) -> tuple[list[RunRecord], list[Problem]]:
    """The runs that met the same scenarios as most did; the others are named, never mixed in."""
    prints = {run.id: run.evaluations[protocol].fingerprint for run in runs}
    votes = Counter(prints.values())
    size = {prints[run.id]: len(run.evaluations[protocol].episodes) for run in runs}
    chosen = max(votes, key=lambda fingerprint: (votes[fingerprint], size[fingerprint], fingerprint))
    problems = [
        Problem(
            run.id,
            "foreign",
            f"evaluation {protocol} met other scenarios (fingerprint {prints[run.id]}, "
            f"{size[prints[run.id]]} episodes; the table's is {chosen}, {size[chosen]}): evaluate it again",
        )
        for run in runs
        if prints[run.id] != chosen
    ]
    return [run for run in runs if prints[run.id] == chosen], problems


def _same_episodes(rows: Mapping[str, pd.DataFrame], problems: list[Problem]) -> dict[str, pd.DataFrame]:
    """Only runs with the same episode ids: column j of every metric must be the same scenario."""
    ids = {run: tuple(frame["episode"].tolist()) for run, frame in rows.items()}
    chosen = Counter(ids.values()).most_common(1)[0][0]
    kept = {}
    for run, frame in rows.items():
        if ids[run] == chosen:
            kept[run] = frame
        else:
            message = f"has other episodes ({len(frame)}) than the rest ({len(chosen)}): evaluate it again"
            problems.append(Problem(run, "damaged", message))
    return kept


def _agent(
    label: str,
    key: Mapping[str, Any],
    group: Sequence[RunRecord],
    frames: Sequence[pd.DataFrame],
    protocol: str,
) -> Agent:
    table = pd.concat(
        frames, join="inner", ignore_index=True
    )  # at once: a column by itself of each seed is slow
    words = table["outcome"].to_numpy()
    codes = np.select([words == name for name in OUTCOMES], list(range(len(OUTCOMES)))).astype(np.int8)
    outcome = codes.reshape(len(frames), -1)
    metrics = {
        str(column): np.array(table[column], dtype=np.float64).reshape(len(frames), -1)
        for column, dtype in table.dtypes.items()
        if column not in NOT_METRICS and pd.api.types.is_numeric_dtype(dtype)
    }
    metrics["time_to_goal_s"] = np.where(outcome == 0, metrics["duration_s"], np.nan)
    fingerprint = group[0].evaluations[protocol].fingerprint
    return Agent(label, dict(key), tuple(group), fingerprint, outcome, metrics)


def _mixed(label: str, group: Sequence[RunRecord], grouped: set[str]) -> list[Problem]:
    """Names the keys in which runs pooled into one row differ, when they change what was trained."""
    first = group[0].config
    differing: dict[str, set[str]] = {}
    for run in group[1:]:
        for key in first.keys() | run.config.keys():
            if first.get(key) != run.config.get(key) and key not in grouped and not key.startswith(NEUTRAL):
                differing.setdefault(key, {str(first.get(key))}).add(str(run.config.get(key)))
    if not differing:
        return []
    shown = [f"{key} ({', '.join(sorted(values))})" for key, values in sorted(differing.items())]
    more = f" and {len(shown) - 3} more" if len(shown) > 3 else ""
    hint = f"--group-by ...,{min(differing)} separates them"
    message = f"pools {len(group)} runs that differ in {', '.join(shown[:3])}{more}; {hint}"
    return [Problem(label, "mixed", message)]


def _missing_cells(runs: Iterable[RunRecord], keys: Mapping[str, str]) -> list[Problem]:
    """Cells of each algorithm's grid, and seeds of its cells, that exist elsewhere in the grid and not here."""
    by_algo: dict[str, list[RunRecord]] = {}
    for run in runs:
        by_algo.setdefault(str(run.config.get("algo.name")), []).append(run)
    problems = []
    others = [short for short in keys if short != "algo"]
    for algo, members in sorted(by_algo.items()):
        seeds = {run.seed for run in members}
        present: dict[tuple[Any, ...], set[int]] = {}
        for run in members:
            present.setdefault(tuple(_level(run, keys[s]) for s in others), set()).add(run.seed)
        levels = [
            sorted({cell[i] for cell in present}, key=lambda v: sort_key({"": v})) for i in range(len(others))
        ]
        cells = list(itertools.islice(itertools.product(*levels), 10 * len(present) + 1))
        if len(cells) > 4 * len(present):
            continue  # drawn at random (tuning), not a grid
        for cell in cells:
            absent = seeds - present.get(cell, set())
            if absent:
                varying = {n: v for n, v, all_ in zip(others, cell, levels, strict=True) if len(all_) > 1}
                key = ({"algo": algo} if "algo" in keys else {}) | varying
                name = " ".join(part(n, v) for n, v in key.items())
                every = (
                    "no run" if absent == seeds else f"no run with seed {', '.join(map(str, sorted(absent)))}"
                )
                problems.append(Problem(name, "missing", every))
    return problems
