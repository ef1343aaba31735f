"""Optional columns: computing time of actions and trainings, and any measure."""

from __future__ import annotations

from collections.abc import Sequence
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
    """Return the processor time of an action in ms, the mean over runs; None where one was not timed."""
    timed = _timed(agent, protocol)
    return _mean([found["median_ms"] for found in timed]) if all(timed) else None


def training_time(agent: Agent) -> Estimate | None:
    """Return the processor time of a training in s, the mean over runs; None where one is unknown."""
    times = [run.manifest.get("cpu_time_s") for run in agent.runs]
    return _mean([time for time in times if time]) if learns(agent) and all(times) else None


def _timed(agent: Agent, protocol: str) -> list[Any]:
    """Return the time of an action in the test of each run; None where it failed."""
    return [r.evaluations[protocol].summary["inference"] for r in agent.runs if protocol in r.evaluations]


def _mean(found: Sequence[float]) -> Estimate | None:
    return Estimate(float(np.mean(found)), np.nan, np.nan, 0.95) if found else None


def machines(agents: Sequence[Agent], protocol: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Return a caution for each column of times that were taken on several kinds of processor."""
    found = {"an action": {t["cpu"] for agent in agents for t in _timed(agent, protocol) if t}}
    if TRAINING in columns:
        hosts = (run.manifest.get("host") for agent in agents if learns(agent) for run in agent.runs)
        found["a training"] = {str(host.get("cpu")) for host in hosts if host}
    return tuple(
        f"Times of {what} are of different processors and do not compare: {', '.join(sorted(names))}."
        for what, names in found.items()
        if len(names) > 1
    )


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
