"""Compute an interval of the typical training: the median over trainings, with the error from few trainings
and the error from few scenarios.

A learner is n independent trainings, each tested on the same E scenarios as its baseline. With x[s, e] the
measure of training s in scenario e, and y[e] the measure of a controller,

    delta(s) = mean of x[s, e] - y[e] over all scenarios that the protocol could draw
    theta    = median of delta(s) over all trainings of the configuration: the typical training

The sample's median m differs from theta by two independent errors:

* few trainings: [l, u] is an interval of the median from order statistics, for any shape of the tails;
* few scenarios, shared by all trainings: s = t g, with Student's quantile t. g is the paired standard error over
  scenarios, computed from the middle half of the trainings.

With d the difference of the medians,

    low = d - join(m - l, s)        high = d + join(u - m, s)        join(a, s) = max(sqrt(a² + s²), a + (sqrt(2) - 1) s)

This is square-and-add (Newcombe 1998, Stat. Med. 17:873; Zou & Donner 2008, Stat. Med. 27:1693). If a few failed
trainings make m - l or u - m large, the second part of `join` prevents this distance from hiding the error of the
scenarios. With several learners, the squares of their distances m - l (or u - m) add up; a controller has l = m = u.
docs/statistics-appendix.md has the measured error rates.

All functions accept leading axes, to compute many simulated tables at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, stdtrit

from auvbench.statistics.intervals import FloatArray

ALPHA = 0.05
FEWEST = 5
"""Smallest number of trainings for a verdict. Four successful trainings cannot exclude (95 %, one-sided) that
most trainings fail, because 0.5^4 > 0.05.
"""
KEPT = math.sqrt(2) - 1
"""Share of the scenarios' error that `join` adds if the error of the trainings is larger. With this share, the two expressions in
`join` are equal if both errors are equal
"""
LEAST = 1e-30
"""smallest p-value"""


def trainings_needed(family: int = 1, alpha: float = ALPHA) -> int:
    """Return the smallest number n of trainings whose whole range is an interval of the median: 2 (1/2)^n <=
    alpha / family.

    Args:
        family: number of simultaneous comparisons (Bonferroni).
        alpha: error rate of all comparisons.

    >>> [trainings_needed(k) for k in (1, 2, 5, 12, 29)]
    [6, 7, 8, 9, 11]
    """
    n = 1
    while 2.0 ** (1 - n) > alpha / family:
        n += 1
    return n


@cache
def _levels(n: int) -> FloatArray:
    """Return the levels (n // 2 + 2,) of the intervals from the r-th smallest to the r-th largest of n values.

    Entry r is the level for r; entry 0 is 0, the level of an unlimited interval.
    """
    below = np.concatenate([[0.0], bdtr(np.arange(n // 2 + 1, dtype=np.float64), n, 0.5)])
    return np.asarray(2 * below)


def median_interval(values: ArrayLike, level: ArrayLike = ALPHA) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the lower limit, the median and the upper limit of an interval of a population's median.

    The interval runs from the r-th smallest to the r-th largest value, with the largest r for which P(fewer
    than r of n on one side) <= level / 2. Only a few confidences are possible (10 values: 99.8, 97.9, 89.1 %),
    so the limits are interpolated towards the next inner values, linearly in the level.

    With 2 to `FEWEST` - 1 values the limits are infinite. With more values, but fewer than `trainings_needed`,
    the interval is the whole range of the values, widened at each end by c = level^(-1/(n-1)) / 2 - 1 times the
    range. This is valid if the distribution of trainings has a single peak, at the median. All n values are on
    one side of the median with probability 2 (1/2)^n. In this case, the distance from the median to the nearest
    value exceeds c times the range with probability at most (1 + c)^-(n-1).

    Args:
        values: (..., n), one per training; n = 1 is a controller, whose value is exact.
        level: (...), 1 - confidence.

    >>> low, median, high = median_interval(np.arange(1.0, 11.0), 0.01)
    >>> f"{low:.3f} {median:.1f} {high:.3f}"
    '1.412 5.5 9.588'
    """
    v = np.sort(np.asarray(values, dtype=np.float64), axis=-1)
    n = v.shape[-1]
    median = np.median(v, axis=-1)
    shape = np.broadcast_shapes(median.shape, np.shape(level))
    level = np.broadcast_to(np.asarray(level, dtype=np.float64), shape)
    middle = np.broadcast_to(median, shape)
    if n == 1:
        return middle, middle, middle
    if n < FEWEST:
        return np.full(shape, -np.inf), middle, np.full(shape, np.inf)
    levels = _levels(n)
    rank = np.searchsorted(levels[1 : n // 2 + 1], level, side="right")
    outer, inner = np.maximum(rank, 1) - 1, np.minimum(rank, n - 1)
    share = (level - levels[rank]) / (levels[rank + 1] - levels[rank])
    share = np.where((rank == 0) | (rank >= n // 2), 0.0, share)
    wide = np.broadcast_to(v, (*shape, n))

    def at(place: FloatArray) -> FloatArray:
        return np.asarray(np.take_along_axis(wide, np.asarray(place, dtype=np.intp)[..., None], -1)[..., 0])

    low, high = at(outer), at(n - 1 - outer)
    beyond = np.where(rank == 0, np.maximum(0.5 * level ** (-1 / (n - 1)) - 1, 0.0), 0.0) * (high - low)
    return (
        low + share * (at(inner) - low) - beyond,
        middle,
        high + share * (at(n - 1 - inner) - high) + beyond,
    )


def middle_half(x: FloatArray) -> FloatArray:
    """Return the mean (..., E) in each scenario over the middle half of the trainings (..., n, E).

    The middle half are the trainings that remain when the quarter with the best means and the quarter with the worst are removed.
    """
    n = x.shape[-2]
    cut = n // 4
    if not cut:
        return np.asarray(x.mean(axis=-2))
    order = np.argsort(x.mean(axis=-1), axis=-1, kind="stable")[..., cut : n - cut]
    return np.asarray(np.take_along_axis(x, order[..., None], axis=-2).mean(axis=-2))


def scenario_error(difference: FloatArray, rate: bool = False) -> FloatArray:
    """Return the standard error (...) over scenarios of the mean of differences (..., E); NaN for means over one scenario.

    For rates, two scenarios are added: one with the difference 1, and one with -1 (Bonett & Price 2012, J.
    Educ. Behav. Stat. 37:479). Without these two, the standard error would be 0 if no scenario has a difference.
    """
    E = difference.shape[-1]
    if not rate:
        unknown = np.full(difference.shape[:-1], np.nan)
        return np.asarray(difference.std(axis=-1, ddof=1) / math.sqrt(E)) if E > 1 else unknown
    mean, square = difference.sum(axis=-1) / (E + 2), ((difference**2).sum(axis=-1) + 2) / (E + 2)
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0) / (E + 2)))


def join(trainings: ArrayLike, scenarios: ArrayLike) -> FloatArray:
    """Return the distance of an interval's limit from the estimate, given the parts due to the trainings and to the scenarios."""
    a, s = np.asarray(trainings, dtype=np.float64), np.asarray(scenarios, dtype=np.float64)
    return np.maximum(np.hypot(a, s), a + KEPT * s)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The trainings of one agent in one measure; leading axes are for many simulated agents."""

    means: FloatArray  # (..., n) mean of each training over the scenarios
    middle: FloatArray  # (..., E) mean of the middle half of the trainings in each scenario

    @property
    def n(self) -> int:
        """Return the number of trainings; 1 for a controller."""
        return int(self.means.shape[-1])

    @property
    def typical(self) -> FloatArray:
        """Return the median (...) of the trainings' means."""
        return np.asarray(np.median(self.means, axis=-1))


def sample(x: FloatArray) -> Sample:
    """Return the sample of values (..., n, E); no value may be missing."""
    return Sample(np.asarray(x.mean(axis=-1)), middle_half(x))


@dataclass(frozen=True, eq=False)
class Contrast:
    """Weighted sum of agents' typical values, with its interval (`ends`) and its p-value."""

    samples: Sequence[Sample]
    """one sample per agent, with the same scenarios"""
    weights: Sequence[float]
    """one weight per agent: 1 and -1 for a difference"""
    rate: bool = False
    """whether values are 0 and 1"""

    @cached_property
    def value(self) -> FloatArray:
        """Return the sum (...) of the medians."""
        return np.asarray(
            sum(w * sample.typical for sample, w in zip(self.samples, self.weights, strict=True))
        )

    @cached_property
    def error(self) -> FloatArray:
        """Return the standard error (...) over scenarios. All trainings have this error in common, because their scenarios are the same."""
        total = sum(w * sample.middle for sample, w in zip(self.samples, self.weights, strict=True))
        return scenario_error(np.asarray(total), self.rate)

    def ends(self, level: ArrayLike = ALPHA) -> tuple[FloatArray, FloatArray]:
        """Return the lower and the upper limit (...) of the interval with confidence 1 - `level`.

        The limits are infinite if a learner has fewer than `FEWEST` trainings.
        """
        below, above = np.zeros(()), np.zeros(())
        for sample, w in zip(self.samples, self.weights, strict=True):
            low, median, high = median_interval(sample.means, level)
            down, up = (median - low, high - median) if w > 0 else (high - median, median - low)
            below, above = below + (w * down) ** 2, above + (w * up) ** 2
        E = self.samples[0].middle.shape[-1]
        t = -stdtrit(E - 1.0 if E > 1 else np.nan, np.asarray(level, dtype=np.float64) / 2)
        value, error = self.value, t * self.error
        return value - join(np.sqrt(below), error), value + join(np.sqrt(above), error)

    def p_value(self) -> float:
        """Return the p-value of the sum being 0: the smallest level whose interval excludes 0.

        It is 1 if every interval contains 0, and NaN without an interval. Intervals of different levels are
        nested, so an interval excludes 0 if and only if p is below its level. The search refines a logarithmic
        grid of levels from `LEAST` to 1.
        """
        if np.isnan(self.ends()[0]):
            return math.nan
        low, high = math.log(LEAST), 0.0
        for _ in range(4):
            levels = np.linspace(low, high, 129)
            below, above = self.ends(np.exp(levels))
            excludes = np.flatnonzero((below > 0) | (above < 0))
            if excludes.size == 0:
                return 1.0
            first = int(excludes[0])
            if first == 0:
                return math.exp(low)
            low, high = float(levels[first - 1]), float(levels[first])
        return math.exp(high)


def difference(first: Sample, second: Sample, rate: bool = False) -> Contrast:
    """Return the difference first - second of two typical values."""
    return Contrast((first, second), (1.0, -1.0), rate)
