"""Tests of all pairs of agents on one measure, and what they allow to say of each pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench import statistics as st
from auvbench.analysis.measures import Measure
from auvbench.analysis.model import Agent, Comparison
from auvbench.statistics.intervals import FloatArray

BETTER, WORSE, EQUIVALENT, UNDECIDED = "better", "worse", "equivalent", "undecided"

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Tests:
    """All pairs of n agents on one measure, (n, n) each; NaN where there is no test."""

    measure: Measure
    confidence: float
    table: st.Crossed
    pairs: st.Pairs
    p: FloatArray
    adjusted: FloatArray
    """by Holm over all pairs"""
    equivalence: FloatArray
    """that the difference is no smaller than the margin, by Holm over all pairs; NaN without a margin"""
    p_equivalence: FloatArray
    """the same, one by one"""

    @property
    def resolved(self) -> BoolArray:
        """(n, n) Pairs that differ."""
        return np.asarray(self.adjusted < 1 - self.confidence)

    def against(self, baseline: int) -> Tests:
        """The same tests, with those against one agent corrected as a family of their own.

        Naming a baseline is asking n - 1 questions beforehand, as in Dunnett's comparisons with a control. Letters
        and ranks stay with the family of all pairs.
        """
        return replace(
            self,
            adjusted=_family(self.adjusted, self.p, baseline),
            equivalence=_family(self.equivalence, self.p_equivalence, baseline),
        )

    def verdict(self, i: int, j: int) -> str:
        """What may be said of agent i against agent j.

        A difference that is certainly smaller than the margin is none of interest, resolved or not.
        """
        if self.equivalence[i, j] < 1 - self.confidence:
            return EQUIVALENT
        if self.adjusted[i, j] < 1 - self.confidence:
            ahead = self.pairs.difference[i, j] * self.measure.sign > 0
            return BETTER if ahead else WORSE
        return UNDECIDED

    def comparison(self, agents: Sequence[Agent], i: int, j: int, scores: Sequence[FloatArray]) -> Comparison:
        """The pair as a reader sees it; `scores` (S, E) of each agent, higher is better."""
        small = float(self.equivalence[i, j])
        return Comparison(
            first=agents[i].label,
            second=agents[j].label,
            metric=self.measure.name,
            difference=self.pairs.estimate(i, j, self.table, self.confidence),
            p_value=float(self.p[i, j]),
            p_adjusted=float(self.adjusted[i, j]),
            probability_of_improvement=st.improvement(scores[i], scores[j], self.confidence),
            verdict=self.verdict(i, j),
            p_equivalence=None if np.isnan(small) else small,
        )


def all_pairs(
    agents: Sequence[Agent], m: Measure, compared: BoolArray, confidence: float, margin: float | None = None
) -> Tests:
    """Tests all pairs of the agents that are compared.

    Args:
        agents: of one table.
        m: what they are compared by.
        compared: (n,) False for an agent that is one policy of an algorithm.
        confidence: of the intervals; all verdicts hold together with it.
        margin: smallest difference of interest, in the measure's unit.
    """
    plain = m.table(agents)
    # Only what is compared lends its variance: a policy among algorithms has none, and tells nothing of theirs.
    table = st.pooled(plain)
    pairs = st.pairs(table, confidence, plain)
    among = np.outer(compared, compared) & ~np.eye(len(agents), dtype=bool)
    p = np.where(among, _p_values(agents, m, plain), np.nan)
    nothing = np.full_like(p, np.nan)
    raw = nothing if margin is None else np.where(among, st.equivalence(table, margin), np.nan)
    return Tests(m, confidence, table, pairs, p, _holm(p), _holm(raw), raw)


def _p_values(agents: Sequence[Agent], m: Measure, table: st.Crossed) -> FloatArray:
    """P (n, n) of no difference. Rates of two agents with one run each: McNemar's mid-p; else `st.resolution`."""
    p = st.resolution(table)
    single = [i for i, agent in enumerate(agents) if len(agent.outcome) == 1]
    if m.rate and len(single) > 1:
        only = st.discordant(np.concatenate([m.values(agents[i]) for i in single]))
        p[np.ix_(single, single)] = st.mcnemar(only, only.T)
    return p


def _holm(p: FloatArray) -> FloatArray:
    """Holm over the upper triangle of a symmetric matrix."""
    upper = np.triu_indices(len(p), 1)
    adjusted = np.full_like(p, np.nan)
    adjusted[upper] = st.holm(p[upper])
    adjusted.T[upper] = adjusted[upper]
    return adjusted


def _family(adjusted: FloatArray, p: FloatArray, baseline: int) -> FloatArray:
    others = [j for j in range(len(p)) if j != baseline]
    result = adjusted.copy()
    result[baseline, others] = result[others, baseline] = st.holm(p[baseline, others])
    return result


def letters(resolved: BoolArray, compared: BoolArray) -> list[str]:
    """Group letters of the agents that are compared; '' for the others."""
    here = np.flatnonzero(compared)
    names = [""] * len(compared)
    for i, name in zip(here, st.letters(resolved[np.ix_(here, here)]), strict=True):
        names[i] = name
    return names


def rank_intervals(value: FloatArray, resolved: BoolArray) -> list[tuple[int, int]]:
    """From 1 + the agents that are resolved to be better, to n - those that are resolved to be worse.

    Because the tests of all pairs hold together, so do these intervals: Mogstad, Romano, Shaikh & Wilhelm (2024,
    Rev. Econ. Stud. 91:476). Bootstrapped ranks do not have that property near ties (Xie, Singh & Zhang 2009).
    An agent that is not compared may have any rank, and leaves one open to all others.
    """
    better, worse = value[:, None] < value[None, :], value[:, None] > value[None, :]
    first = 1 + (resolved & better).sum(axis=1)
    last = len(value) - (resolved & worse).sum(axis=1)
    return [(int(a), int(b)) for a, b in zip(first, last, strict=True)]
