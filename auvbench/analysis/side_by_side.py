"""Compare two agents: differences of all measures with intervals, and differences of their configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from auvbench import statistics as st
from auvbench.analysis.conditions import default
from auvbench.analysis.grouping import agents, of_a_seed, sections
from auvbench.analysis.load import load, require
from auvbench.analysis.measures import RANKED_AS, Measure, all_measures, measure, metric_of
from auvbench.analysis.primary import find_baseline, reliability_of
from auvbench.analysis.records import Agent, task_of
from auvbench.analysis.typical import Typical
from auvbench.errors import ReportError
from auvbench.registry import TASKS
from auvbench.runs.directory import missing
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.reliability import Reliability
from auvbench.untrusted.text import plain, short

USUAL = ("success_rate", "par1_time_s", "mean_energy_J", "mean_path_efficiency", "mean_smoothness_per_s")
"""measures to show after the task's primary measure"""


@dataclass(frozen=True, slots=True)
class Difference:
    """Comparison of two agents on one measure."""

    measure: Measure
    first: Estimate
    second: Estimate
    difference: Estimate
    """Value of the second agent minus value of the first, paired by scenario. The value of a learner with several trainings
    is the value of its typical training
    """
    trainings: int = 0
    """smallest number of trainings among the agents with several trainings; 0 if neither agent has several"""
    reliability: Reliability | None = None
    """Reliability of the second agent against the first. If only the first agent has several trainings: reliability of the
    first agent against the second
    """

    @property
    def better(self) -> int:
        """Return 0 or 1, the index of the better agent; -1 if the interval of the difference contains 0."""
        if not (self.difference.low > 0 or self.difference.high < 0):
            return -1
        return int(self.difference.value * self.measure.sign > 0)


def find_agent(
    name: str, folder: Path, protocol: str, condition: str | None, where: Sequence[str] = ()
) -> Agent:
    """Return the agent that `name` means.

    Args:
        name: path of a run or of a folder with one agent; or label or algorithm of an agent in `folder`.
        folder: folder of the agents, if `name` is not a path.
        protocol: name of the protocol.
        condition: test condition; None: the default condition.
        where: terms that the runs must match, as in `load`.

    Raises:
        ReportError: the path has several agents or tests, or the name is unknown.
    """
    path = Path(name)
    source = path if path.exists() else folder
    if not source.exists():
        raise ReportError(
            f"{name}: is not a run or folder; an agent's name must be one of the agents in --in FOLDER; {missing(folder)}"
        )
    runs, problems = load([source], protocol, where)
    require(runs, problems, protocol)
    parts = sections(runs, protocol)
    if len(parts) > 1:
        titles = ", ".join(part.title for part in parts)
        raise ReportError(
            f"{source}: has several tests ({titles}); name a folder with one, or select with --where"
        )
    matches, _ = agents(
        parts[0].runs, protocol=protocol, condition=condition or default(parts[0].runs, protocol)
    )
    if source != path:
        return find_baseline(matches, name, f"compare: {name!r}")
    if len(matches) > 1:
        labels = ", ".join(agent.label for agent in matches)
        raise ReportError(
            f"{path}: has {len(matches)} agents ({labels}); name two of them: auvbench compare "
            f"'{matches[0].label}' '{matches[1].label}' --in {path}"
        )
    return matches[0]


def with_distinct_labels(pair: Sequence[Agent], names: Sequence[str]) -> list[Agent]:
    """Return two agents with different labels: equal labels are followed by the names of the agents' folders.

    Raises:
        ReportError: the two agents are the same runs.
    """
    first, second = pair
    if first.label != second.label:
        return [first, second]
    if {run.directory.resolve() for run in first.runs} & {run.directory.resolve() for run in second.runs}:
        raise ReportError(f"{names[0]} and {names[1]} contain the same runs; name two agents")
    folders = [Path(name).name for name in names]
    parts = folders if folders[0] != folders[1] else list(names)
    return [
        replace(agent, label=f"{agent.label} ({plain(part)})")
        for agent, part in zip(pair, parts, strict=True)
    ]


def differences(pair: Sequence[Agent], confidence: float, every: bool = False) -> list[Difference]:
    """Return the differences of two agents; the intervals are not corrected for the number of measures.

    Args:
        pair: two agents that were tested in the same scenarios.
        confidence: confidence of each interval.
        every: whether to compare all measures that both agents have, not only the usual measures.

    Raises:
        ReportError: the agents have different tasks or scenarios.
    """
    first, second = pair
    tasks = [task_of(agent.runs[0]) for agent in pair]
    if tasks[0] != tasks[1]:
        raise ReportError(
            f"{first.label} has task={tasks[0]} and {second.label} has task={tasks[1]}: name two agents of one task"
        )
    if first.fingerprint != second.fingerprint or first.outcome.shape[1] != second.outcome.shape[1]:
        raise ReportError(
            f"{first.label} and {second.label} met different scenarios ({first.fingerprint} and "
            f"{second.fingerprint}): evaluate both with the same protocol"
        )
    task = TASKS.get(tasks[0], TASKS[DEFAULT_TASK])
    # Quick failures improve the means in `RANKED_AS`. Leave out these means, and compare their penalised measures instead.
    by_name = {
        m.name: m
        for m in all_measures(pair)
        if m.name not in RANKED_AS and (m.column == "outcome" or metric_of(m.column))
    }
    names = dict.fromkeys([task.primary, *(by_name if every else USUAL)])
    result = []
    for m in (measure(name) for name in names if name in by_name):
        table = m.table(pair)
        if not all(count > 0 for count in table.values):
            continue
        means = st.means(table, confidence)
        typical = Typical(pair, m)
        reliable = reliability_of(pair, typical, 1, 0, 0.0, confidence)
        change = typical.difference(1, 0, 1 - confidence)
        result.append(Difference(m, means[0], means[1], change, typical.fewest((0, 1)), reliable))
    return result


def settings(pair: Sequence[Agent]) -> list[tuple[str, str, str]]:
    """Return the configuration keys in which two agents differ, with their two values.

    A configuration group with different options is one row: two vehicles differ in `vehicle`, not in each key.
    """
    values: list[dict[str, list[str]]] = []
    for agent in pair:
        keys_of_agent = {key for run in agent.runs for key in run.config}
        values.append(
            {k: sorted({str(run.config[k]) for run in agent.runs if k in run.config}) for k in keys_of_agent}
        )
    keys = sorted(
        key
        for key in values[0].keys() | values[1].keys()
        if values[0].get(key) != values[1].get(key) and not of_a_seed(key)
    )
    groups = {key.removesuffix(".name") for key in keys if key.endswith(".name")}
    shown = [key for key in keys if key.endswith(".name") or key.partition(".")[0] not in groups]
    first, second = (
        [short(", ".join(side[key]), 60) if key in side else "–" for key in shown] for side in values
    )
    return list(zip([key.removesuffix(".name") for key in shown], first, second, strict=True))
