"""Optional columns: computing time of actions and trainings, and any measure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench.analysis import optimality
from auvbench.analysis.effects import learns
from auvbench.analysis.measures import measures
from auvbench.analysis.records import Agent, Ranking
from auvbench.errors import ReportError, closest
from auvbench.statistics.intervals import Estimate

ACTION, TRAINING = "action_ms", "training_cpu_s"
COLUMNS = (ACTION, TRAINING, optimality.COLUMN)
"""names of --columns, in addition to the measures; `optimality.add_optimality` computes the last"""


def action_time(agent: Agent, protocol: str) -> Estimate | None:
    """Return the processor time of an action in ms, the mean over runs; None where a test does not say."""
    return _mean([timed.get("median_ms") for timed in _timed(agent, protocol)])


def training_time(agent: Agent) -> Estimate | None:
    """Return the processor time of a training in s, the mean over runs; None where a manifest does not say."""
    return _mean([run.manifest.get("cpu_time_s") or None for run in agent.runs]) if learns(agent) else None


def _timed(agent: Agent, protocol: str) -> list[Mapping[str, Any]]:
    """Return what the tests of an agent's runs say of the time of an action."""
    evaluations = [run.evaluations[protocol] for run in agent.runs if protocol in run.evaluations]
    found = [evaluation.summary.get("inference") for evaluation in evaluations]
    return [timed if isinstance(timed, Mapping) else {} for timed in found]


def _mean(found: Sequence[Any]) -> Estimate | None:
    """Return the mean of times that files state; None where one of them states none, or no time."""
    numbers = [float(v) for v in found if isinstance(v, int | float) and not isinstance(v, bool)]
    if not numbers or len(numbers) < len(found) or not all(0 <= v < np.inf for v in numbers):
        return None
    return Estimate(float(np.mean(numbers)), np.nan, np.nan, 0.95)


def machines(agents: Sequence[Agent], protocol: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Return a caution for each column of times that were taken on several kinds of processor."""
    tests = (timed.get("cpu") for agent in agents for timed in _timed(agent, protocol))
    hosts = (run.manifest.get("host") for agent in agents if learns(agent) for run in agent.runs)
    trainings = (host.get("cpu") for host in hosts if isinstance(host, Mapping))
    return (
        *_several("an action", tests),
        *(_several("a training", trainings) if TRAINING in columns else ()),
    )


def _several(what: str, processors: Iterable[Any]) -> tuple[str, ...]:
    names = sorted({cpu for cpu in processors if isinstance(cpu, str)})
    if len(names) < 2:
        return ()
    return (f"Times of {what} are of different processors and do not compare: {', '.join(names)}.",)


def validate_columns(names: Sequence[str]) -> None:
    """Validate the names of --columns: optional columns and measures.

    Raises:
        ReportError: there is no column of that name.
    """
    known = [*COLUMNS, *measures()]
    for name in names:
        if name not in known:
            raise ReportError(f"--columns {name!r} is not a column; {closest(name, known)}")


def with_columns(ranking: Ranking, agents: Sequence[Agent], names: Sequence[str]) -> Ranking:
    """Return the ranking with the time of an action and further columns; an agent without a value of one gets none.

    Raises:
        ReportError: there is no column of that name.
    """
    validate_columns(names)
    by_label = {agent.label: agent for agent in agents}
    rows = []
    for row in ranking.rows:
        agent = by_label[row.label]
        times = {ACTION: action_time(agent, ranking.protocol)}
        if TRAINING in names:
            times[TRAINING] = training_time(agent)
        found = {name: time for name, time in times.items() if time is not None}
        rows.append(replace(row, estimates={**row.estimates, **found}))
    return replace(
        ranking, rows=tuple(rows), columns=tuple(names), machines=machines(agents, ranking.protocol, names)
    )
