"""Puts runs together into sections and agents.

A section has the runs that can share a table: those of one vehicle that met the same scenarios. An agent has the seeds of one
configuration, paired with all others by test scenario.

Runs of one table met the same test, so the task, noise and disturbances of their configurations only say what they were
trained with. A controller that learns nothing has no use for them: its runs that differ in nothing else are one agent.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis.formatting import counted
from auvbench.analysis.labels import OWN, is_fixed, labels, sort_key
from auvbench.analysis.measures import of_the_scenario
from auvbench.analysis.names import with_names
from auvbench.analysis.recorded import has_training
from auvbench.analysis.records import NO_POLICY, Agent, Problem, RunRecord, run_learns, task_of
from auvbench.errors import ReportError, closest
from auvbench.metrics import of_failures
from auvbench.record import OUTCOMES
from auvbench.registry import TASKS
from auvbench.runs import declared
from auvbench.runs.identity import DESCRIPTIVE, NEUTRAL

GROUPING = ("algo.name", "reward.k", "step.frequency")

NOT_METRICS = ("condition", "outcome", "episode", "environment")

OF_THE_TEST = ("vehicle.", "simulator.max_step", "simulator.name")
"""beginnings of keys of a run that a protocol takes over into its test"""
TASK = ", task "
"""between a vehicle and its task in the subject of a section"""


def agents(
    runs: Sequence[RunRecord],
    protocol: str = "test",
    condition: str = "nominal",
) -> tuple[list[Agent], list[Problem]]:
    """Group evaluated runs by the values of `GROUPING` and of all other keys that vary among them.

    A training that failed is a seed without a success (`NO_POLICY`): a user may draw one that fails.

    Args:
        runs: as `load` returns them, of one vehicle and one set of scenarios (see `sections`).
        protocol: name of the protocol.
        condition: name of the condition within it.

    Returns:
        the agents in the order of their keys, and what is missing. `Agent.metrics` has every numeric column of
        episodes.csv and `time_to_goal_s` (NaN where the episode was no success).

    Raises:
        ReportError: an unknown protocol or condition, or no run that can be reported.
    """
    known = set[str]().union(*(run.config.keys() for run in runs))
    keys = {key.removesuffix(".name"): key for key in GROUPING if key in known}
    rows, problems = _rows(runs, protocol, condition)
    reported = [run for run in runs if run.id in rows or failed_training(run)]
    fingerprint = next(run.evaluations[protocol].fingerprint for run in reported if run.id in rows)
    fixed = frequency_fixed(
        frame["frequency_hz"].to_numpy() for frame in rows.values() if "frequency_hz" in frame
    )
    finer = refined(_cells(reported, keys, fixed), keys, fixed)
    groups = [(_key(group[0], finer), group) for group in _cells(reported, finer, fixed)]
    groups.sort(key=lambda group: [sort_key(value) for value in group[0].values()])
    shown = labels([key for key, _ in groups], [trained(group[0]) for _, group in groups], fixed)
    names = with_names(shown, [group for _, group in groups])
    result = []
    for label, (key, group) in zip(names, groups, strict=True):
        group.sort(key=lambda run: (run.seed, run.id))
        tested = next(run for run in (*group, *reported) if run.id in rows).evaluations[protocol]
        limit = next(c["max_steps"] for c in tested.summary["conditions"] if c["name"] == condition)
        result.append(_agent(label, key, group, rows, fingerprint, float(limit)))
    return result, problems


def frequency_fixed(tested: Iterable[np.ndarray[Any, Any]]) -> bool:
    """Return whether all test episodes had one step frequency."""
    found = np.concatenate([np.empty(0), *map(np.ravel, tested)])
    return np.unique(found[np.isfinite(found)]).size <= 1


def _cells(runs: Iterable[RunRecord], keys: Mapping[str, str], fixed: bool) -> list[list[RunRecord]]:
    """Return the runs put together by the values of the keys that matter to them."""
    cells: dict[tuple[str, ...], list[RunRecord]] = {}
    for run in runs:
        values = (
            str(level(run.config.get(key))) if matters(key, run, fixed) else "" for key in keys.values()
        )
        cells.setdefault(tuple(values), []).append(run)
    return list(cells.values())


def _key(run: RunRecord, keys: Mapping[str, str]) -> dict[str, Any]:
    return {short: level(run.config.get(key)) for short, key in keys.items()}


def _rows(
    runs: Sequence[RunRecord], protocol: str, condition: str
) -> tuple[dict[str, pd.DataFrame], list[Problem]]:
    """The condition's episodes by run id, all of the same scenarios in the same order."""
    evaluated = [run for run in runs if protocol in run.evaluations]
    if not evaluated:
        raise ReportError(f"none of the {len(runs)} runs has a usable evaluation by protocol {protocol!r}")
    rows, problems = {}, list[Problem]()
    for run in evaluated:
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
        conditions = {
            str(name) for run in evaluated for name in run.evaluations[protocol].episodes["condition"]
        }
        raise ReportError(
            f"protocol {protocol} has no condition {condition!r}; {closest(condition, conditions)}"
        )
    # Column j of every metric must be the same scenario.
    ids = {name: tuple(frame["episode"].tolist()) for name, frame in rows.items()}
    usual = Counter(ids.values()).most_common(1)[0][0]
    problems += [
        Problem(
            name,
            "damaged",
            f"has other episodes ({len(found)}) than the rest ({len(usual)}): evaluate it again",
        )
        for name, found in ids.items()
        if found != usual
    ]
    return {name: frame for name, frame in rows.items() if ids[name] == usual}, problems


def failed_training(run: RunRecord) -> bool:
    """Whether a training ended without a policy, by divergence for example; interrupted ones have not ended."""
    return run.state == "failed" and run_learns(run)


def _agent(
    label: str,
    key: Mapping[str, Any],
    group: Sequence[RunRecord],
    rows: Mapping[str, pd.DataFrame],
    fingerprint: str,
    limit: float,
) -> Agent:
    tested = [i for i, run in enumerate(group) if run.id in rows]
    some = next(iter(rows.values()))
    table = pd.concat(
        [rows[group[i].id] for i in tested] or [some.iloc[:0]], join="inner", ignore_index=True
    )  # at once: a column by itself of each seed is slow
    words = table["outcome"].to_numpy()
    codes = np.select([words == name for name in OUTCOMES], list(range(len(OUTCOMES)))).astype(np.int8)
    outcome = np.full((len(group), len(some)), NO_POLICY, dtype=np.int8)
    outcome[tested] = codes.reshape(len(tested), len(some))
    metrics = {}
    for column, dtype in table.dtypes.items():
        if column not in NOT_METRICS and pd.api.types.is_numeric_dtype(dtype):
            metrics[str(column)] = values = np.full(outcome.shape, np.nan)
            values[tested] = np.array(table[column], dtype=np.float64).reshape(len(tested), len(some))
    _count_failures(str(group[0].config.get("task.name")), outcome, metrics, limit)
    metrics["time_to_goal_s"] = np.where(outcome == 0, metrics["duration_s"], np.nan)
    for column in of_the_scenario():  # a training that failed has those of all agents
        if column in metrics:
            # A copy's rows may lack the column.
            known = next(frame for frame in rows.values() if column in frame)
            scenario = known[column].to_numpy(dtype=np.float64)
            metrics[column] = np.where(np.isnan(metrics[column]), scenario, metrics[column])
    return Agent(label, key, tuple(group), fingerprint, outcome, metrics, limit)


def _count_failures(task: str, outcome: np.ndarray, metrics: dict[str, Any], limit: float) -> None:
    """Write what failed episodes count as; rows of earlier versions have what was measured until the failure."""
    if task not in TASKS:
        return
    failed = np.isin(outcome, [OUTCOMES.index(name) for name in TASKS[task].failures])
    seconds = {"time": limit / metrics["frequency_hz"]} if "frequency_hz" in metrics else {}
    for column, value in of_failures(metrics, seconds).items():
        metrics[column] = np.where(failed, value, metrics[column])


SEEDS = ("seed", "train.evaluate_every", *NEUTRAL)
"""keys in which the seeds of one agent may differ: they do not change what was to be learned"""

OF_LEARNING = ("train.", "reward.")
"""beginnings of keys that mean nothing to a controller that learns nothing"""


def refined(
    groups: Iterable[Sequence[RunRecord]],
    keys: Mapping[str, str],
    frequency_fixed: bool,
) -> dict[str, str]:
    """Return the keys of a grouping, and as many more as tell apart what varied within its groups, by short name.

    A folder of choices counts as one (`disturbance` for all that differs in `disturbance.*`) where its name differs.
    `groups` are the runs that `keys` put together; `frequency_fixed` says that the test has one step frequency.
    """
    excused = set(keys.values())
    found = dict(keys)
    parts = [list(group) for group in groups]
    while varying := _varying(parts, excused, frequency_fixed):
        key = min(varying, key=lambda k: (not k.endswith(".name"), -varying[k], k))
        found[key.removesuffix(".name")] = key
        excused.add(key)
        parts = [part for group in parts for part in _split(group, key)]
    return found


def _varying(groups: Iterable[Sequence[RunRecord]], excused: set[str], frequency_fixed: bool) -> Counter[str]:
    """Return in how many of the groups each key varies."""
    found = Counter[str]()
    for group in groups:
        first = group[0].config
        suspects = {
            key
            for run in group[1:]
            for key in first.keys() | run.config.keys()
            if key not in excused and run.config.get(key) != first.get(key)
        }
        for key in suspects:
            values = {str(run.config.get(key)) for run in group if matters(key, run, frequency_fixed)}
            found[key] += len(values) > 1
    return +found


def _split(group: Sequence[RunRecord], key: str) -> list[list[RunRecord]]:
    parts: dict[str, list[RunRecord]] = {}
    for run in group:
        parts.setdefault(str(run.config.get(key)), []).append(run)
    return list(parts.values())


def of_a_seed(key: str) -> bool:
    """Return whether a key may differ between the seeds of one agent (`SEEDS`)."""
    return any(f"{key}.".startswith(f"{seed}.") for seed in SEEDS)


def matters(key: str, run: RunRecord, frequency_fixed: bool) -> bool:
    """Return whether a key changes what the run's agent does in the test."""
    if of_a_seed(key):
        return False
    if not trained(run) and (key.startswith(OF_LEARNING) or is_fixed(key, frequency_fixed)):
        return False
    return not (key.startswith("vehicle.") and key.rpartition(".")[2] in DESCRIPTIVE)


def trained(run: RunRecord) -> bool:
    """Whether the run is a training; a controller has nothing to learn."""
    return run_learns(run) or has_training(run)


def level(value: Any) -> Any:
    """A value of the configuration as a level of a factor: a list (noise.sensor) as its text, to look it up by."""
    return str(value) if isinstance(value, list) else value


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Runs that can be compared with each other."""

    title: str
    """'vehicle rexrov', 'vehicle rexrov, scenarios 1a2b3c4d'"""
    folder: str
    """a name that a folder can have, no two sections the same"""
    vehicle: str
    """and the task where it is not that of waypoints: 'rexrov', 'rexrov, task docking'"""
    fingerprint: str
    runs: tuple[RunRecord, ...]
    """those that were evaluated, and the others of the vehicle in its first section"""
    problems: tuple[Problem, ...] = ()
    """why its runs are not in another section's table, where that can be mended"""


def sections(runs: Sequence[RunRecord], protocol: str) -> list[Section]:
    """Runs by vehicle, task and fingerprint, the largest section first; at least one of them was evaluated.

    A run without a usable evaluation goes to the first section of its vehicle, or else to the first of all.
    """
    found: dict[tuple[str, str], list[RunRecord]] = {}
    for run in runs:
        if protocol in run.evaluations:
            found.setdefault((subject_of(run), run.evaluations[protocol].fingerprint), []).append(run)
    order = sorted(found, key=lambda cell: (-len(found[cell]), cell))
    home = {vehicle: (vehicle, fingerprint) for vehicle, fingerprint in reversed(order)}
    members = {cell: list(found[cell]) for cell in order}
    for run in runs:
        if protocol not in run.evaluations:
            members[home.get(subject_of(run), order[0])].append(run)
    return [_section(cell, home[cell[0]], found, members[cell], protocol) for cell in order]


def subject_of(run: RunRecord) -> str:
    """Return vehicle and task of a run; the waypoint task goes without saying."""
    return declared.subject(run.config.get("vehicle.name", "vehicle"), task_of(run))


def split_problems(problems: Iterable[Problem], parts: Sequence[Section]) -> list[list[Problem]]:
    """The problems by the section whose run they are about; what is about no run stands with the first."""
    place = {run.id: i for i, part in enumerate(parts) for run in part.runs}
    found: list[list[Problem]] = [[] for _ in parts]
    for problem in problems:
        found[place.get(problem.where, 0)].append(problem)
    return found


def _section(
    cell: tuple[str, str],
    home: tuple[str, str],
    found: dict[tuple[str, str], list[RunRecord]],
    members: Sequence[RunRecord],
    protocol: str,
) -> Section:
    subject, fingerprint = cell
    alone = [other for other in found if other[0] == subject] == [cell]
    # Next to other tasks the waypoint task is named, too.
    named = subject if TASK in subject or not any(TASK in s for s, _ in found) else f"{subject}{TASK}waypoint"
    title = f"vehicle {named}" if alone else f"vehicle {named}, scenarios {fingerprint[:8]}"
    folder = re.sub(r"[^\w.-]+", "_", subject if alone else f"{subject}-{fingerprint[:8]}").lstrip(".") or "_"
    expected = cell == home or protocol == OWN
    problems = () if expected else (_other_scenarios(cell, home, found, protocol),)
    return Section(title, folder, subject, fingerprint, tuple(sorted(members, key=lambda r: r.id)), problems)


def _other_scenarios(
    cell: tuple[str, str], home: tuple[str, str], found: dict[tuple[str, str], list[RunRecord]], protocol: str
) -> Problem:
    """Why runs of one vehicle have a section of their own, and what would unite them."""
    here, there = found[cell], found[home]
    episodes = [len(runs[0].evaluations[protocol].episodes) for runs in (here, there)]
    message = (
        f"{counted(len(here), 'run')} of vehicle {cell[0]} met other scenarios (fingerprint {cell[1]}, {episodes[0]} episodes) "
        f"than {counted(len(there), 'run')} (fingerprint {home[1]}, {episodes[1]} episodes): no table can hold both"
    )
    one, other = here[0].config, there[0].config
    differing = sorted(
        key
        for key in one.keys() | other.keys()
        if key.startswith(OF_THE_TEST)
        and key.rpartition(".")[2] not in DESCRIPTIVE
        and one.get(key) != other.get(key)
    )
    if differing:
        message += f"; they differ in {', '.join(differing[:3])}"
    else:
        message += f"; auvbench evaluate FOLDER protocol={protocol} tests what is stale again"
    return Problem(f"scenarios {cell[1][:8]}", "foreign", message)
