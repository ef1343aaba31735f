"""Test all pairs of agents on one measure, and derive a verdict for each pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auvbench import statistics as st
from auvbench.analysis.measures import Measure
from auvbench.analysis.records import Agent, Comparison
from auvbench.analysis.typical import Typical
from auvbench.statistics.intervals import BoolArray, FloatArray
from auvbench.statistics.typical import trainings_needed

BETTER, WORSE, UNDECIDED = "better", "worse", "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Tests:
    """Tests of all pairs of n agents on one measure. Each array is (n, n), with NaN for a pair without a test."""

    typical: Typical
    confidence: float
    p: FloatArray
    adjusted: FloatArray
    """p-values with Holm's correction over all pairs"""

    @property
    def measure(self) -> Measure:
        """Return the measure on which the agents are compared."""
        return self.typical.measure

    @property
    def resolved(self) -> BoolArray:
        """Return, for each pair of agents, whether they differ significantly after Holm's correction: (n, n)."""
        return np.asarray(self.adjusted < 1 - self.confidence)

    def verdict(self, i: int, j: int) -> str:
        """Return the verdict on agent i against agent j."""
        if not self.resolved[i, j]:
            return UNDECIDED
        value = self.typical.value
        return BETTER if (value[i] - value[j]) * self.measure.sign > 0 else WORSE

    def comparisons(
        self, agents: Sequence[Agent], listed: Sequence[tuple[int, int]]
    ) -> tuple[Comparison, ...]:
        """Return a comparison for the report for each pair (i, j) of agent indices in `listed`."""
        tested = int(np.isfinite(self.p[np.triu_indices(len(self.p), 1)]).sum())
        needed = trainings_needed(max(tested, 1), 1 - self.confidence)
        return tuple(
            Comparison(
                first=agents[i].label,
                second=agents[j].label,
                metric=self.measure.name,
                difference=self.typical.difference(i, j, 1 - self.confidence),
                p_value=float(self.p[i, j]),
                p_adjusted=float(self.adjusted[i, j]),
                verdict=self.verdict(i, j),
                trainings=self.typical.fewest((i, j)),
                needed=needed,
            )
            for i, j in listed
        )


def all_pairs(agents: Sequence[Agent], m: Measure, compared: BoolArray, confidence: float) -> Tests:
    """Test all pairs of compared agents; the verdicts hold simultaneously.

    Args:
        agents: n agents with the same scenarios.
        m: measure of the tests.
        compared: (n,) whether an agent is compared.
        confidence: simultaneous confidence of all verdicts.
    """
    typical = Typical(agents, m)
    p = np.full((len(agents), len(agents)), np.nan)
    for i, j in combinations(np.flatnonzero(compared).tolist(), 2):
        p[i, j] = p[j, i] = typical.p_value(i, j)
    return Tests(typical, confidence, p, _holm(p))


def _holm(p: FloatArray) -> FloatArray:
    """Apply Holm's correction to a symmetric matrix of p-values, and count each pair once."""
    upper = np.triu_indices(len(p), 1)
    adjusted = np.full_like(p, np.nan)
    adjusted[upper] = st.holm(p[upper])
    adjusted.T[upper] = adjusted[upper]
    return adjusted


def rank_intervals(value: FloatArray, resolved: BoolArray) -> list[tuple[int, int]]:
    """Return the rank interval of each of n agents.

    The interval is from 1 + (number of resolved better agents) to n - (number of resolved worse agents). The
    tests of all pairs hold simultaneously, so the intervals do as well (Mogstad, Romano, Shaikh & Wilhelm 2024,
    Rev. Econ. Stud. 91:476); intervals of bootstrapped ranks are wrong near ties (Xie, Singh & Zhang 2009). An
    agent that is not compared may have any rank, which widens the interval of each other agent by one rank.

    Args:
        value: (n,) values; higher is better.
        resolved: (n, n) whether two agents differ.
    """
    better, worse = value[:, None] < value[None, :], value[:, None] > value[None, :]
    first = 1 + (resolved & better).sum(axis=1)
    last = len(value) - (resolved & worse).sum(axis=1)
    return list(zip(first.tolist(), last.tolist(), strict=True))
