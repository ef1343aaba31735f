"""Optional columns: success over all conditions, and computing time."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvbench.analysis import optimality
from auvbench.analysis.compute_cost import action_time, machines, training_time
from auvbench.analysis.effects import learns
from auvbench.analysis.evaluations import Damage
from auvbench.analysis.measures import MEASURES
from auvbench.analysis.records import NO_POLICY, Agent, Problem, Ranking
from auvbench.errors import ReportError, closest
from auvbench.statistics import aggregate as st
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray


def of_conditions(agent: Agent, protocol: str) -> FloatArray | None:
    """Success (seeds, conditions) under every condition of the protocol; None where runs met different ones."""
    rows: list[list[float]] = []
    names: list[str] | None = None
    for run, outcome in zip(agent.runs, agent.outcome, strict=True):
        if (outcome == NO_POLICY).all():
            rows.append([])
            continue
        if (evaluation := run.evaluations.get(protocol)) is None:
            return None
        frame = evaluation.episodes
        rates = (frame["outcome"] == "success").groupby(frame["condition"]).mean()
        if names is not None and list(rates.index) != names:
            return None
        names = list(rates.index)
        rows.append([float(rate) for rate in rates.to_numpy(dtype=np.float64)])
    if names is None:
        return None
    return np.array([row or [0.0] * len(names) for row in rows])  # a training that failed succeeds nowhere


def draws(seed: int, label: str) -> np.random.Generator:
    """Random numbers of an agent's resampling, independent of the other agents."""
    return np.random.default_rng([seed, zlib.crc32(label.encode())])


def _aggregated(aggregate: st.Aggregate) -> Callable[[Agent, str, float, int], Estimate | None]:
    def column(agent: Agent, protocol: str, confidence: float, seed: int) -> Estimate | None:
        scores = of_conditions(agent, protocol)
        if scores is None:
            return None
        return st.stratified([scores], aggregate, confidence=confidence, rng=draws(seed, agent.label))

    return column


def _action_time(which: str) -> Callable[[Agent, str, float, int], Estimate | None]:
    def column(agent: Agent, protocol: str, confidence: float, seed: int) -> Estimate | None:
        return action_time(agent, protocol, which)

    return column


COLUMNS: Mapping[str, Callable[[Agent, str, float, int], Estimate | None]] = {
    "iqm_success": _aggregated(st.interquartile),
    "optimality_gap": _aggregated(st.optimality_gap),
    "action_ms": _action_time("median_ms"),
    "action_p95_ms": _action_time("p95_ms"),
    "training_cpu_s": lambda agent, protocol, confidence, seed: (
        training_time(agent) if learns(agent) else None
    ),
    # Set beside all rows at once: `optimality.add_optimality`.
    optimality.COLUMN: lambda agent, protocol, confidence, seed: None,
}
"""by name of --columns; docs/report.md defines them. All but the times of an action, in ms, of a training, in s, and the ratio of
times are shares of 1."""


ALWAYS = "action_ms"
"""computed for every table"""


def validate_columns(names: Sequence[str]) -> None:
    """Validate the names of --columns: optional columns and measures.

    Raises:
        ReportError: there is no column of that name.
    """
    known = [*COLUMNS, *MEASURES]
    for name in names:
        if name not in known:
            raise ReportError(f"--columns {name!r} is not a column; {closest(name, known)}")


def with_columns(ranking: Ranking, agents: Sequence[Agent], names: Sequence[str], seed: int = 0) -> Ranking:
    """Return the ranking with optional columns; an agent without a value of one gets none.

    Raises:
        ReportError: there is no column of that name.
    """
    validate_columns(names)
    by_label = {agent.label: agent for agent in agents}
    rows, problems = [], list(ranking.problems)
    computed = [name for name in dict.fromkeys((ALWAYS, *names)) if name in COLUMNS]
    for row in ranking.rows:
        added = {}
        for name in computed:
            try:
                found = COLUMNS[name](by_label[row.label], ranking.protocol, ranking.confidence, seed)
            except Damage as damage:
                problems.append(Problem(row.label, "damaged", f"{name}: {damage}"))
                continue
            if found is not None:
                added[name] = found
        rows.append(replace(row, estimates={**row.estimates, **added}))
    return replace(
        ranking,
        rows=tuple(rows),
        columns=tuple(names),
        machines=machines(agents, ranking.protocol, computed),
        problems=tuple(dict.fromkeys(problems)),
    )
