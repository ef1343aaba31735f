"""Group runs into sections and agents.

A section contains the runs that can share a table: they were tested in the same scenarios with the same
physics, which includes the tested vehicle. An agent contains the seeds of one configuration, paired with all
other agents by test scenario.

All runs of a table had the same test, so the task, noise and disturbances in their configurations only
describe their training. A controller has no training: its runs that differ only in these keys are one agent.
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
"""prefixes of configuration keys: the run's values of these keys also apply in its test"""
TASK = ", task "
"""text between the vehicle and the task in a section's subject"""
SEVERAL = "several sheets"
"""text that replaces the vehicle in a section's subject if its agents have the sheets of several vehicles"""


def agents(
    runs: Sequence[RunRecord],
    protocol: str = "test",
    condition: str = "nominal",
) -> tuple[list[Agent], list[Problem]]:
    """Group tested runs by their values of the keys in `GROUPING` and of all other keys that vary among the runs.

    A failed training counts as a seed without a success (`NO_POLICY`), since a user's training may fail, too.

    Args:
        runs: result of `load`, for one vehicle and one set of scenarios (see `sections`).
        protocol: name of the protocol.
        condition: name of a condition of the protocol.

    Returns:
        Agents in the order of their keys, and the problems. `Agent.metrics` has every numeric column of
        episodes.csv and `time_to_goal_s` (NaN for a failed episode).

    Raises:
        ReportError: the protocol or condition is unknown, or no run can be reported.
    """
    config_keys = set[str]().union(*(run.config.keys() for run in runs))
    keys = {key.removesuffix(".name"): key for key in GROUPING if key in config_keys}
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
    """Return whether all test episodes had the same step frequency."""
    frequencies = np.concatenate([np.empty(0), *map(np.ravel, tested)])
    return np.unique(frequencies[np.isfinite(frequencies)]).size <= 1


def _cells(runs: Iterable[RunRecord], keys: Mapping[str, str], fixed: bool) -> list[list[RunRecord]]:
    """Return the runs grouped by the values of `keys`; a key that has no effect on a run (`matters`) is ignored."""
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
    """Return the condition's episodes by run id, all with the same scenarios in the same order."""
    evaluated = [run for run in runs if protocol in run.evaluations]
    if not evaluated:
        raise ReportError(f"none of the {len(runs)} runs has a usable evaluation by protocol {protocol!r}")
    rows, problems = {}, list[Problem]()
    for run in evaluated:
        frame = run.evaluations[protocol].episodes
        in_condition = frame["condition"].to_numpy() == condition
        if in_condition.any():
            part_of = frame if in_condition.all() else frame[in_condition]
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
            f"was tested in other episodes ({len(episodes)}) than most runs ({len(usual)}): evaluate it again",
        )
        for name, episodes in ids.items()
        if episodes != usual
    ]
    return {name: frame for name, frame in rows.items() if ids[name] == usual}, problems


def failed_training(run: RunRecord) -> bool:
    """Return whether a training ended without a policy, for example by divergence. An interrupted training has not ended."""
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
    example = next(iter(rows.values()))
    table = pd.concat(
        [rows[group[i].id] for i in tested] or [example.iloc[:0]], join="inner", ignore_index=True
    )  # at once: adding the columns one by one is slow
    words = table["outcome"].to_numpy()
    codes = np.select([words == name for name in OUTCOMES], list(range(len(OUTCOMES)))).astype(np.int8)
    outcome = np.full((len(group), len(example)), NO_POLICY, dtype=np.int8)
    outcome[tested] = codes.reshape(len(tested), len(example))
    metrics = {}
    for column, dtype in table.dtypes.items():
        if column not in NOT_METRICS and pd.api.types.is_numeric_dtype(dtype):
            metrics[str(column)] = values = np.full(outcome.shape, np.nan)
            values[tested] = np.array(table[column], dtype=np.float64).reshape(len(tested), len(example))
    _count_failures(str(group[0].config.get("task.name")), outcome, metrics, limit)
    metrics["time_to_goal_s"] = np.where(outcome == 0, metrics["duration_s"], np.nan)
    for column in of_the_scenario():  # A failed training has no rows, so its scenarios come from another run.
        if column in metrics:
            # The rows of some runs may lack the column.
            source = next(frame for frame in rows.values() if column in frame)
            scenario = source[column].to_numpy(dtype=np.float64)
            metrics[column] = np.where(np.isnan(metrics[column]), scenario, metrics[column])
    return Agent(label, key, tuple(group), fingerprint, outcome, metrics, limit)


def _count_failures(task: str, outcome: np.ndarray, metrics: dict[str, Any], limit: float) -> None:
    """Replace the measured values of failed episodes by the fixed values of a failure (`of_failures`).

    Rows that earlier versions of auvbench wrote still have the values measured until the failure.
    """
    if task not in TASKS:
        return
    failed = np.isin(outcome, [OUTCOMES.index(name) for name in TASKS[task].failures])
    seconds = {"time": limit / metrics["frequency_hz"]} if "frequency_hz" in metrics else {}
    for column, value in of_failures(metrics, seconds).items():
        metrics[column] = np.where(failed, value, metrics[column])


SEEDS = ("seed", "train.evaluate_every", *NEUTRAL)
"""keys in which the seeds of one agent may differ, because these keys do not change the task to learn"""

OF_LEARNING = ("train.", "reward.")
"""prefixes of keys without meaning for a controller"""


def refined(
    groups: Iterable[Sequence[RunRecord]],
    keys: Mapping[str, str],
    frequency_fixed: bool,
) -> dict[str, str]:
    """Return the keys of a finer grouping, by short name: `keys`, and the keys that vary within `groups`.

    If the chosen option of a configuration group varies (`disturbance.name`), the runs are first split by this
    option, under the short name `disturbance`. Other keys of the configuration group are added only if they vary
    within a part of the split.

    Args:
        groups: runs grouped by `keys`.
        keys: keys of the grouping, by short name.
        frequency_fixed: whether the test has one step frequency.
    """
    excused = set(keys.values())
    grouping = dict(keys)
    parts = [list(group) for group in groups]
    while varying := _varying(parts, excused, frequency_fixed):
        key = min(varying, key=lambda k: (not k.endswith(".name"), -varying[k], k))
        grouping[key.removesuffix(".name")] = key
        excused.add(key)
        parts = [part for group in parts for part in _split(group, key)]
    return grouping


def _varying(groups: Iterable[Sequence[RunRecord]], excused: set[str], frequency_fixed: bool) -> Counter[str]:
    """Return the number of groups in which each key varies."""
    counts = Counter[str]()
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
            counts[key] += len(values) > 1
    return +counts


def _split(group: Sequence[RunRecord], key: str) -> list[list[RunRecord]]:
    parts: dict[str, list[RunRecord]] = {}
    for run in group:
        parts.setdefault(str(run.config.get(key)), []).append(run)
    return list(parts.values())


def of_a_seed(key: str) -> bool:
    """Return whether a key is one of `SEEDS`, in which the seeds of one agent may differ."""
    return any(f"{key}.".startswith(f"{seed}.") for seed in SEEDS)


def matters(key: str, run: RunRecord, frequency_fixed: bool) -> bool:
    """Return whether a key changes what the run's agent does in the test."""
    if of_a_seed(key):
        return False
    if not trained(run) and (key.startswith(OF_LEARNING) or is_fixed(key, frequency_fixed)):
        return False
    return not (key.startswith("vehicle.") and key.rpartition(".")[2] in DESCRIPTIVE)


def trained(run: RunRecord) -> bool:
    """Return whether the run is a training, not a controller."""
    return run_learns(run) or run.source.has_training()


def level(value: Any) -> Any:
    """Return a configuration value as a level of a factor; a list (noise.sensor) becomes text, which is hashable."""
    return str(value) if isinstance(value, list) else value


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Runs that can be compared with each other."""

    title: str
    """Title: 'vehicle rexrov', 'vehicle rexrov, scenarios 1a2b3c4d', 'several sheets, task docking'"""
    folder: str
    """Name of the section's folder, valid and unique"""
    vehicle: str
    """vehicle, and the task unless it is the waypoint task: 'rexrov', 'rexrov, task docking'"""
    fingerprint: str
    runs: tuple[RunRecord, ...]
    """tested runs; the largest section of a vehicle and task also has the runs that were not tested"""
    problems: tuple[Problem, ...] = ()
    """reasons why the runs are in a separate section, with the way to unite the sections"""


def sections(runs: Sequence[RunRecord], protocol: str) -> list[Section]:
    """Return sections of runs by vehicle, task and fingerprint, the largest first.

    Each section has at least one tested run. If a protocol fixes the vehicle of its test, agents with the
    sheets of several vehicles share a section. A run without a usable evaluation goes to the largest section
    of its vehicle and task, or else to the largest of all sections.
    """
    tested: dict[tuple[str, str], list[RunRecord]] = {}
    for run in runs:
        if protocol in run.evaluations:
            tested.setdefault((task_of(run), run.evaluations[protocol].fingerprint), []).append(run)
    cells = {(_subject(task, met), fingerprint): met for (task, fingerprint), met in tested.items()}
    order = sorted(cells, key=lambda cell: (-len(cells[cell]), cell))
    home = {subject: (subject, fingerprint) for subject, fingerprint in reversed(order)}
    of_vehicle = {subject_of(run): cell for cell in reversed(order) for run in cells[cell]}
    members = {cell: list(cells[cell]) for cell in order}
    for run in runs:
        if protocol not in run.evaluations:
            members[of_vehicle.get(subject_of(run), order[0])].append(run)
    return [_section(cell, home[cell[0]], cells, members[cell], protocol) for cell in order]


def _subject(task: str, runs: Sequence[RunRecord]) -> str:
    """Return the subject of the runs of one section."""
    own = {subject_of(run) for run in runs}
    return own.pop() if len(own) == 1 else declared.subject(SEVERAL, task)


def subject_of(run: RunRecord) -> str:
    """Return a run's subject: 'rexrov, task docking', but only 'rexrov' for the waypoint task."""
    return declared.subject(run.config.get("vehicle.name", "vehicle"), task_of(run))


def split_problems(problems: Iterable[Problem], parts: Sequence[Section]) -> list[list[Problem]]:
    """Return the problems of each section; a problem that names no run of a section goes to the first section."""
    place = {run.id: i for i, part in enumerate(parts) for run in part.runs}
    split: list[list[Problem]] = [[] for _ in parts]
    for problem in problems:
        split[place.get(problem.where, 0)].append(problem)
    return split


def _section(
    cell: tuple[str, str],
    home: tuple[str, str],
    cells: dict[tuple[str, str], list[RunRecord]],
    members: Sequence[RunRecord],
    protocol: str,
) -> Section:
    subject, fingerprint = cell
    is_only_cell = [other for other in cells if other[0] == subject] == [cell]
    # If there are other tasks, the title also names the waypoint task.
    named = subject if TASK in subject or not any(TASK in s for s, _ in cells) else f"{subject}{TASK}waypoint"
    title = named if named.startswith(SEVERAL) else f"vehicle {named}"
    title += "" if is_only_cell else f", scenarios {fingerprint[:8]}"
    folder = (
        re.sub(r"[^\w.-]+", "_", subject if is_only_cell else f"{subject}-{fingerprint[:8]}").lstrip(".")
        or "_"
    )
    expected = cell == home or protocol == OWN
    problems = () if expected else (_other_scenarios(cell, home, cells, protocol),)
    return Section(title, folder, subject, fingerprint, tuple(sorted(members, key=lambda r: r.id)), problems)


def _other_scenarios(
    cell: tuple[str, str], home: tuple[str, str], cells: dict[tuple[str, str], list[RunRecord]], protocol: str
) -> Problem:
    """Return why some runs of one vehicle are in a separate section, and how to unite them."""
    runs, home_runs = cells[cell], cells[home]
    episodes = [len(members[0].evaluations[protocol].episodes) for members in (runs, home_runs)]
    message = (
        f"{counted(len(runs), 'run')} of vehicle {cell[0]} met other scenarios (fingerprint {cell[1]}, {episodes[0]} episodes) "
        f"than {counted(len(home_runs), 'run')} (fingerprint {home[1]}, {episodes[1]} episodes): they cannot share a table"
    )
    config, home_config = runs[0].config, home_runs[0].config
    differing = sorted(
        key
        for key in config.keys() | home_config.keys()
        if key.startswith(OF_THE_TEST)
        and key.rpartition(".")[2] not in DESCRIPTIVE
        and config.get(key) != home_config.get(key)
    )
    if differing:
        message += f"; they differ in {', '.join(differing[:3])}"
    else:
        message += f"; auvbench evaluate FOLDER protocol={protocol} repeats each outdated test"
    return Problem(f"scenarios {cell[1][:8]}", "foreign", message)
