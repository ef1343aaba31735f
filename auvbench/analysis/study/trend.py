"""Does a number per run rise with a factor, among runs that are equal in the rest? A permutation test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.statistics import quantile, score_interval
from auvbench.statistics.intervals import Estimate

PERMUTATIONS = 10_000


@dataclass(frozen=True, slots=True)
class Trend:
    """Probability that, of two runs of a stratum, the one of the higher level has the higher value; ties half."""

    estimate: Estimate
    """low and high are NaN where a cell has one run only"""
    pairs: int
    p_up: float
    """one-sided: values do not rise with the level"""
    p_down: float
    """one-sided: values do not fall with it"""


Point = tuple[str, float, float]
"""(stratum, level, value) of a run"""


def trend(points: Sequence[Point], confidence: float = 0.95, seed: int = 0) -> Trend | None:
    """Jonckheere and Terpstra's statistic within strata, as a share of pairs, with a permutation test.

    Values are permuted among the runs of a stratum, 10,000 times: exact in level for any distribution, and
    with one run per cell of two strata no smaller than 1/4, as it should be. The interval is Wilson's with the
    variance of the jackknife over runs. None where no stratum has two levels.
    """
    strata = [_Stratum(points, name) for name in sorted({point[0] for point in points})]
    strata = [stratum for stratum in strata if stratum.pairs]
    if not strata:
        return None
    pairs = sum(stratum.pairs for stratum in strata)
    value = sum(stratum.wins(stratum.values[None])[0] for stratum in strata) / pairs
    rng = np.random.default_rng(seed)
    permuted = np.zeros(PERMUTATIONS)
    for stratum in strata:
        permuted += stratum.wins(rng.permuted(np.tile(stratum.values, (PERMUTATIONS, 1)), axis=1))
    permuted /= pairs
    p_up = (1 + (permuted >= value - 1e-12).sum()) / (1 + PERMUTATIONS)
    p_down = (1 + (permuted <= value + 1e-12).sum()) / (1 + PERMUTATIONS)
    low, high = _interval(strata, float(value), pairs, confidence)
    estimate = Estimate(float(value), low, high, confidence, "training seeds")
    return Trend(estimate, pairs, float(p_up), float(p_down))


class _Stratum:
    def __init__(self, points: Sequence[Point], name: str) -> None:
        mine = [point for point in points if point[0] == name]
        self.levels = np.array([point[1] for point in mine])
        self.values = np.array([point[2] for point in mine])
        self.low, self.high = np.nonzero(self.levels[:, None] < self.levels[None, :])
        self.pairs = len(self.low)

    def wins(
        self, values: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    ) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """(m,) wins of the higher level, for m rows of values."""
        low, high = values[:, self.low], values[:, self.high]
        # A tie is half a win: the mean of those that are no loss and those that are a win.
        result: np.ndarray[tuple[int], np.dtype[np.float64]] = (
            (high > low).sum(axis=1) + (high >= low).sum(axis=1)
        ) / 2
        return result

    def without(self, i: int) -> tuple[float, int]:
        """Wins and pairs when run i is left out."""
        keep = (self.low != i) & (self.high != i)
        low, high = self.values[self.low[keep]], self.values[self.high[keep]]
        return float(((high > low) + 0.5 * (high == low)).sum()), int(keep.sum())


def _interval(strata: Sequence[_Stratum], value: float, pairs: int, confidence: float) -> tuple[float, float]:
    variance, df, runs = 0.0, 0, 0
    wins = value * pairs
    for stratum in strata:
        mine = float(stratum.wins(stratum.values[None])[0])
        for level in np.unique(stratum.levels):
            cell = np.flatnonzero(stratum.levels == level)
            n = len(cell)
            if n < 2:
                return float("nan"), float("nan")
            left = []
            for i in cell:
                others, count = stratum.without(int(i))
                left.append((wins - mine + others) / (pairs - stratum.pairs + count))
            variance += (n - 1) / n * float(((np.array(left) - np.mean(left)) ** 2).sum())
            df += n - 1
            runs += n
    n_effective = min(value * (1 - value) / variance, runs) if variance > 0 else runs
    low, high = score_interval(value, max(n_effective, 1.0), quantile(confidence, df))
    return float(low), float(high)
