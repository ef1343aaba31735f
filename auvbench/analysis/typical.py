"""Compare agents on one measure; every verdict comes from these comparisons.

Learners are compared by their typical trainings (statistics/typical.py), and controllers scenario by scenario.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from auvbench import statistics as st
from auvbench.analysis.measures import Measure
from auvbench.analysis.records import Agent
from auvbench.statistics import typical
from auvbench.statistics.crossed import covers, within
from auvbench.statistics.intervals import Estimate, FloatArray
from auvbench.statistics.typical import Contrast, Sample


class Typical:
    """Typical values of n agents on a measure, their differences with intervals, and tests of no difference."""

    def __init__(self, agents: Sequence[Agent], m: Measure) -> None:
        self.measure = m
        self._data = [_with_values(m.values(agent)) for agent in agents]
        self._samples = [_sample(x) for x in self._data]
        ends = (np.zeros(len(agents)), np.ones(len(agents))) if m.rate else m.bounds(agents)
        self._least, self._most = ends
        self.worst = self._least if m.higher_is_better else self._most
        """Worst possible values (n,), as if every episode failed; infinite without a limit"""
        self.trainings = np.array([sample.n for sample in self._samples])
        """Numbers (n,) of trainings with a value; 1 for a controller"""
        self.value = np.array([float(sample.typical) for sample in self._samples])
        """Medians (n,) over trainings; NaN without a value"""
        self._controllers = cache(self._of_controllers)

    def gains(self, i: int, baseline: float) -> FloatArray:
        """Return by how much each training of agent i is better than the value `baseline`, as an array (trainings,)."""
        return np.asarray(self.measure.sign * (self._samples[i].means - baseline))

    def difference(self, i: int, j: int, level: float) -> Estimate:
        """Return the value of agent i minus the value of agent j, with the interval at confidence 1 - `level`.

        The limits are NaN if no verdict is possible.
        """
        if max(self.trainings[i], self.trainings[j]) > 1:
            return self.contrast({i: 1.0, j: -1.0}, level)
        return self._controllers(i, j, level)[0]

    def p_value(self, i: int, j: int) -> float:
        """Return the p-value of the hypothesis that two agents do not differ; NaN if no verdict is possible."""
        if max(self.trainings[i], self.trainings[j]) > 1:
            return self.p_of({i: 1.0, j: -1.0})
        return self._controllers(i, j, typical.ALPHA)[1]

    def contrast(self, weights: dict[int, float], level: float) -> Estimate:
        """Return a weighted sum of typical values with its interval at confidence 1 - `level`.

        `weights` maps the index of an agent to the agent's weight in the sum.
        """
        value, kind = self._sum(weights), covers(self.trainings[list(weights)])
        if not self._decidable(weights):
            return Estimate(value, math.nan, math.nan, 1 - level, kind)
        ends = self._contrast(weights).ends(level)
        w, at = np.array(list(weights.values())), list(weights)
        reach = np.array([w * self._least[at], w * self._most[at]])
        low, high = within(ends[0], value, ends[1], reach.min(axis=0).sum(), reach.max(axis=0).sum())
        return Estimate(value, float(low), float(high), 1 - level, kind)

    def p_of(self, weights: dict[int, float]) -> float:
        """Return the p-value of the hypothesis that a weighted sum of typical values is 0; NaN if no verdict is possible."""
        return self._contrast(weights).p_value() if self._decidable(weights) else math.nan

    def error(self, i: int, j: int) -> tuple[float, int]:
        """Return the standard error over scenarios of the difference of two agents, and the number of scenarios."""
        contrast = self._contrast({i: 1.0, j: -1.0})
        return float(contrast.error), contrast.samples[0].middle.shape[-1]

    def fewest(self, places: Sequence[int]) -> int:
        """Return the smallest number of trainings among the agents `places` (indices) with several trainings; 0 without such agents."""
        return min((int(n) for n in self.trainings[list(places)] if n > 1), default=0)

    def _sum(self, weights: dict[int, float]) -> float:
        return float(sum(w * self.value[i] for i, w in weights.items()))

    def _decidable(self, weights: dict[int, float]) -> bool:
        n = self.trainings[list(weights)]
        few = (n > 1) & (n < typical.FEWEST)
        return not few.any() and math.isfinite(self._sum(weights))

    def _contrast(self, weights: dict[int, float]) -> Contrast:
        samples = [self._samples[i] for i in weights]
        finite = np.all([np.isfinite(sample.middle) for sample in samples], axis=0)
        if not finite.all():
            samples = [Sample(sample.means, sample.middle[finite]) for sample in samples]
        return Contrast(samples, tuple(weights.values()), self.measure.rate)

    def _of_controllers(self, i: int, j: int, level: float) -> tuple[Estimate, float]:
        """Return the difference of two single runs, and its p-value: McNemar's mid-p for rates, else the paired t-test's."""
        data, at = [self._data[i], self._data[j]], [i, j]
        table = st.crossed(data, rate=self.measure.rate, bounds=(self._least[at], self._most[at]))
        pairs = st.pairs(table, 1 - level)
        estimate, p = pairs.estimate(0, 1, 1 - level), float(pairs.p[0, 1])
        if self.measure.rate:
            only = data[0][0] @ (1 - data[1][0]), data[1][0] @ (1 - data[0][0])
            p = float(st.mcnemar(*only))
        return estimate, p


def _with_values(x: FloatArray) -> FloatArray:
    """Return the rows of `x` that have a value; if no row has one, return the first row."""
    present = np.isfinite(x).any(axis=1)
    return x[present] if present.any() else x[:1]


def _sample(x: FloatArray) -> Sample:
    if np.isfinite(x).all():
        return typical.sample(x)
    means = _mean(x, 1)
    cut = len(x) // 4
    order = np.argsort(means, kind="stable")[cut : len(x) - cut]
    return Sample(means, _mean(x[order], 0))


def _mean(x: FloatArray, axis: int) -> FloatArray:
    """Return the means over an axis, ignoring NaN; a mean is NaN if all its values are NaN."""
    count = np.isfinite(x).sum(axis=axis)
    total: ArrayLike = np.nansum(x, axis=axis)
    return np.asarray(np.divide(total, count, out=np.full(count.shape, np.nan), where=count > 0))
