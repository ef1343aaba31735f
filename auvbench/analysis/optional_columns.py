"""Optional columns: success over all conditions, and computing time."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench.analysis import optimality
from auvbench.analysis.effects import learns
from auvbench.analysis.evaluations import LARGEST, Damage
from auvbench.analysis.formatting import listed
from auvbench.analysis.measures import measures
from auvbench.analysis.records import NO_POLICY, Agent, Problem, Ranking, RunRecord
from auvbench.errors import ReportError, closest
from auvbench.statistics import aggregate as st
from auvbench.statistics.intervals import Estimate, FloatArray


def action_time(agent: Agent, protocol: str, which: str) -> Estimate | None:
    """The ms that an action took, the mean over the agent's runs; None where a test does not say.

    Args:
        agent: whose runs were tested.
        protocol: by which.
        which: median_ms or p95_ms.
    """
    return _mean([_timed(run, protocol).get(which) for run in agent.runs if protocol in run.evaluations])


def training_time(agent: Agent) -> Estimate | None:
    """Seconds of processor cores that a training took, the mean over the agent's runs; None where a manifest does not say."""
    return _mean([run.manifest.get("cpu_time_s") or None for run in agent.runs])  # 0.0: nothing was trained


def machines(agents: Sequence[Agent], protocol: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Sentences on the columns of times, where these were taken on processors of several kinds."""
    taken: dict[str, dict[str, list[Any]]] = {}
    if any(name.startswith("action_") for name in columns):
        taken["an action"] = {a.label: [_timed(run, protocol) for run in a.runs] for a in agents}
    if "training_cpu_s" in columns:
        learners = [a for a in agents if learns(a)]
        taken["a training"] = {a.label: [run.manifest.get("host") for run in a.runs] for a in learners}
    return tuple(text for what, places in taken.items() if (text := _several(what, places)))


def _several(what: str, places: Mapping[str, Sequence[Any]]) -> str:
    """Which agents' times are of which processor, the one of most agents without their names; '' where all are of one.

    Args:
        what: took the time.
        places: by an agent's label what its files say of the machines, `cpu` among it.
    """
    holders: dict[str, list[str]] = {}
    for label, found in places.items():
        named = [place.get("cpu") for place in found if isinstance(place, Mapping)]
        for cpu in dict.fromkeys(cpu for cpu in named if isinstance(cpu, str)):
            holders.setdefault(cpu, []).append(label)
    if len(holders) < 2:
        return ""
    (most, _), *others = sorted(holders.items(), key=lambda item: (-len(item[1]), item[0]))
    parts = "; ".join(f"{cpu} ({listed(labels, 6)})" for cpu, labels in others)
    return f"Times of {what} are of {most} but for {parts}: of different processors they do not compare."


def _mean(found: Sequence[Any]) -> Estimate | None:
    """The mean of times that files state; None where one of them states none, or no time."""
    numbers = [float(v) for v in found if isinstance(v, int | float) and not isinstance(v, bool)]
    if not numbers or len(numbers) < len(found) or not all(0 <= v <= LARGEST for v in numbers):
        return None
    return Estimate(float(np.mean(numbers)), np.nan, np.nan, 0.95)


def _timed(run: RunRecord, protocol: str) -> Mapping[str, Any]:
    evaluation = run.evaluations.get(protocol)
    found = evaluation.summary.get("inference") if evaluation is not None else None
    return found if isinstance(found, Mapping) else {}


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
    # `optimality.add_optimality` sets it, for all rows at once.
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
    known = [*COLUMNS, *measures()]
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
