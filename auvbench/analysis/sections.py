"""Which runs can share a table: those of one vehicle that met the same scenarios. A report has a section for each."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from auvbench.analysis.formatting import counted
from auvbench.analysis.labels import OWN
from auvbench.analysis.records import Problem, RunRecord
from auvbench.runs.identity import DESCRIPTIVE

OF_THE_TEST = ("vehicle.", "simulator.max_step", "simulator.name")
"""beginnings of keys of a run that a protocol takes over into its test"""
TASK = ", task "
"""between a vehicle and its task in the subject of a section"""


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
            found.setdefault((_subject(run), run.evaluations[protocol].fingerprint), []).append(run)
    order = sorted(found, key=lambda cell: (-len(found[cell]), cell))
    home = {vehicle: (vehicle, fingerprint) for vehicle, fingerprint in reversed(order)}
    members = {cell: list(found[cell]) for cell in order}
    for run in runs:
        if protocol not in run.evaluations:
            members[home.get(_subject(run), order[0])].append(run)
    return [_section(cell, home[cell[0]], found, members[cell], protocol) for cell in order]


def _subject(run: RunRecord) -> str:
    """Return vehicle and task of a run; the waypoint task goes without saying."""
    task = str(run.config.get("task.name", "waypoint"))
    return vehicle_of(run) if task == "waypoint" else f"{vehicle_of(run)}{TASK}{task}"


def vehicle_of(run: RunRecord) -> str:
    return str(run.config.get("vehicle.name", "vehicle"))


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
    if keys := _of_the_test(here[0], there[0]):
        message += f"; they differ in {', '.join(keys[:3])}"
    else:
        message += f"; auvbench evaluate FOLDER protocol={protocol} tests what is stale again"
    return Problem(f"scenarios {cell[1][:8]}", "foreign", message)


def _of_the_test(one: RunRecord, other: RunRecord) -> list[str]:
    """The keys in which two runs differ that enter the scenarios of a protocol."""
    keys = (key for key in one.config.keys() | other.config.keys() if key.startswith(OF_THE_TEST))
    return sorted(
        key
        for key in keys
        if key.rpartition(".")[2] not in DESCRIPTIVE and one.config.get(key) != other.config.get(key)
    )
