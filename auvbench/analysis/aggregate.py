"""Agents over several tasks at once: all conditions of a protocol, all vehicles of a report. One row per agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.analysis.effects import learns
from auvbench.analysis.grouping import frequency_fixed
from auvbench.analysis.labels import labels
from auvbench.analysis.optional_columns import draws, of_conditions
from auvbench.analysis.records import Agent
from auvbench.statistics import aggregate as st
from auvbench.statistics.intervals import Estimate, FloatArray


@dataclass(frozen=True, slots=True)
class Over:
    """One agent over the tasks that it was tested on."""

    label: str
    key: Mapping[str, Any]
    trainings: tuple[int, ...]
    """training seeds in each section; 0 where it was not tested there"""
    tasks: int
    """conditions that it was tested under, over all sections"""
    trained: bool
    iqm: Estimate
    """interquartile mean of success over trainings and tasks; without ends where a section has one training"""
    gap: Estimate
    """how far success stays below 1 on average over them (optimality gap)"""


@dataclass(frozen=True, slots=True)
class Across:
    """The table: agents that were tested on every task first, by their interquartile mean."""

    sections: tuple[str, ...]
    tasks: int
    """that any agent was tested on"""
    protocol: str
    confidence: float
    rows: tuple[Over, ...]

    @property
    def uneven(self) -> bool:
        """Whether some trained agent has more trainings in one section than in another, and weighs them by that."""
        return any(len({n for n in row.trainings if n}) > 1 for row in self.rows)


def across(
    sections: Sequence[tuple[str, Sequence[Agent]]], protocol: str, confidence: float, seed: int = 0
) -> Across:
    """Success of each agent over all conditions of all sections.

    An agent of one section is that of another where they agree in everything that tells agents apart within a section.

    Args:
        sections: title and agents of each; the runs of an agent hold the evaluations.
        protocol: whose conditions are the tasks of a section.
        confidence: of the intervals.
        seed: of the resampling.
    """
    found: dict[tuple[tuple[str, str], ...], list[Agent | None]] = {}
    for i, (_, agents) in enumerate(sections):
        for agent in agents:
            name = tuple(sorted((k, str(v)) for k, v in agent.key.items()))
            found.setdefault(name, [None] * len(sections))[i] = agent
    members = list(found.values())
    firsts = [next(agent for agent in row if agent is not None) for row in members]
    names = list(dict.fromkeys(name for agent in firsts for name in agent.key))
    keys = [{name: agent.key.get(name) for name in names} for agent in firsts]
    tested = (a.metrics["frequency_hz"] for a in firsts if "frequency_hz" in a.metrics)
    shown = labels(keys, [learns(agent) for agent in firsts], frequency_fixed(tested))
    scores = [[None if a is None else of_conditions(a, protocol) for a in row] for row in members]
    tasks = sum(
        max((x.shape[1] for x in column if x is not None), default=0) for column in zip(*scores, strict=True)
    )
    rows = [
        _row(label, agent, part, confidence, seed)
        for label, agent, part in zip(shown, firsts, scores, strict=True)
        if any(x is not None for x in part)
    ]
    rows.sort(key=lambda row: (-row.tasks, -row.iqm.value, row.gap.value, row.label))
    return Across(tuple(title for title, _ in sections), tasks, protocol, confidence, tuple(rows))


def _row(label: str, agent: Agent, scores: Sequence[FloatArray | None], confidence: float, seed: int) -> Over:
    strata = [x for x in scores if x is not None]
    rng = draws(seed, label)
    iqm, gap = (
        st.stratified(strata, aggregate, confidence=confidence, rng=rng)
        for aggregate in (st.interquartile, st.optimality_gap)
    )
    return Over(
        label,
        agent.key,
        tuple(0 if x is None else len(x) for x in scores),
        sum(x.shape[1] for x in strata),
        learns(agent),
        iqm,
        gap,
    )
