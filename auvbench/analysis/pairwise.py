"""Tests of all pairs of agents on one measure, and what they allow to say of each pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvbench import statistics as st
from auvbench.analysis.measures import Measure
from auvbench.analysis.records import Agent, Comparison
from auvbench.statistics.intervals import BoolArray, FloatArray

BETTER, WORSE, UNDECIDED = "better", "worse", "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Tests:
    """All pairs of n agents on one measure, (n, n) each; NaN where there is no test."""

    measure: Measure
    confidence: float
    table: st.Crossed
    p: FloatArray
    adjusted: FloatArray
    """by Holm over all pairs"""

    @property
    def resolved(self) -> BoolArray:
        """(n, n) Pairs that differ."""
        return np.asarray(self.adjusted < 1 - self.confidence)

    def verdict(self, i: int, j: int) -> str:
        """Return what may be said of agent i against agent j."""
        if not self.resolved[i, j]:
            return UNDECIDED
        return BETTER if (self.table.mean[i] - self.table.mean[j]) * self.measure.sign > 0 else WORSE

    def comparisons(
        self, agents: Sequence[Agent], listed: Sequence[tuple[int, int]]
    ) -> tuple[Comparison, ...]:
        """Return the listed pairs as a reader sees them."""
        intervals = st.pairs(self.table, self.confidence)
        return tuple(
            Comparison(
                first=agents[i].label,
                second=agents[j].label,
                metric=self.measure.name,
                difference=intervals.estimate(i, j, self.table, self.confidence),
                p_value=float(self.p[i, j]),
                p_adjusted=float(self.adjusted[i, j]),
                verdict=self.verdict(i, j),
            )
            for i, j in listed
        )


def all_pairs(agents: Sequence[Agent], m: Measure, compared: BoolArray, confidence: float) -> Tests:
    """Test all pairs of the agents (n,) that are `compared`; all verdicts hold together with the confidence."""
    table = m.table(agents)
    among = np.outer(compared, compared) & ~np.eye(len(agents), dtype=bool)
    p = np.where(among, _p_values(agents, m, table), np.nan)
    return Tests(m, confidence, table, p, _holm(p))


def _p_values(agents: Sequence[Agent], m: Measure, table: st.Crossed) -> FloatArray:
    """Return p (n, n) of no difference: McNemar's mid-p for rates of two single runs, else `st.resolution`."""
    p = st.resolution(table)
    single = [i for i, agent in enumerate(agents) if len(agent.outcome) == 1]
    if m.rate and len(single) > 1:
        ended_so = np.concatenate([m.values(agents[i]) for i in single])  # (agents, episodes) of 0 and 1
        only = ended_so @ (1 - ended_so).T  # episodes of the row's agent that are not the column's
        p[np.ix_(single, single)] = st.mcnemar(only, only.T)
    return p


def _holm(p: FloatArray) -> FloatArray:
    """Adjust the upper triangle of a symmetric matrix by Holm's procedure."""
    upper = np.triu_indices(len(p), 1)
    adjusted = np.full_like(p, np.nan)
    adjusted[upper] = st.holm(p[upper])
    adjusted.T[upper] = adjusted[upper]
    return adjusted


def rank_intervals(value: FloatArray, resolved: BoolArray) -> list[tuple[int, int]]:
    """Return for each agent the ranks from 1 + its resolved superiors to n - its resolved inferiors.

    Because the tests of all pairs hold together, so do these intervals: Mogstad, Romano, Shaikh & Wilhelm (2024,
    Rev. Econ. Stud. 91:476). Bootstrapped ranks do not have that property near ties (Xie, Singh & Zhang 2009).
    An agent that is not compared may have any rank, and leaves one open to all others.
    """
    better, worse = value[:, None] < value[None, :], value[:, None] > value[None, :]
    first = 1 + (resolved & better).sum(axis=1)
    last = len(value) - (resolved & worse).sum(axis=1)
    return list(zip(first.tolist(), last.tolist(), strict=True))
