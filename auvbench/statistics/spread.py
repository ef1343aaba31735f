"""The variance of an estimate in two parts, seeds and scenarios, and the interval and p-value it gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtr, stdtrit

from auvbench.statistics.intervals import FloatArray, quantile


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Variance of an estimate in its two parts, each with its degrees of freedom; arrays of one shape."""

    seeds: FloatArray
    seeds_df: FloatArray
    scenarios: FloatArray
    scenarios_df: FloatArray

    def take(self, index: Any) -> Spread:
        """The elements at a NumPy index."""
        return Spread(
            self.seeds[index], self.seeds_df[index], self.scenarios[index], self.scenarios_df[index]
        )

    def quantile(self, confidence: float) -> FloatArray:
        """Half width of the interval in standard errors."""
        one, other = quantile(confidence, self.seeds_df), quantile(confidence, self.scenarios_df)
        with np.errstate(divide="ignore", invalid="ignore"):
            both = np.sqrt((self.seeds * one**2 + self.scenarios * other**2) / (self.seeds + self.scenarios))
        # With one source, or none, that source's quantile; 0/0 would lose it.
        both = np.where(self.scenarios == 0, one, both)
        return np.where(self.seeds == 0, other, both)

    def p_value(self, difference: FloatArray) -> FloatArray:
        """Two-sided p-value of no difference: 1 - the confidence at which the interval just reaches 0."""
        size = np.abs(difference)
        error = np.sqrt(self.seeds + self.scenarios)
        with np.errstate(divide="ignore", invalid="ignore"):
            p = 2 * stdtr(np.where(self.seeds == 0, self.scenarios_df, self.seeds_df), -size / error)
        mixed = (self.seeds > 0) & (self.scenarios > 0) & (size > 0)
        if mixed.any():
            p[mixed] = _invert(size[mixed], self.take(mixed))
        return np.where(size == 0, 1.0, p)


def _invert(size: FloatArray, spread: Spread) -> FloatArray:
    """Two-sided p at which the half width is `size` (k,), by bisection in log p, to 1e-13 of p.

    It lies between those of the two sources alone, were each all of the variance.
    """
    reach = -size / np.sqrt(spread.seeds + spread.scenarios)
    ends = [np.log(np.maximum(2 * stdtr(df, reach), 1e-300)) for df in (spread.seeds_df, spread.scenarios_df)]
    low, high = np.minimum(*ends), np.maximum(*ends)
    for _ in range(54):
        middle = (low + high) / 2
        tail = np.exp(middle) / 2
        seeds = spread.seeds * stdtrit(spread.seeds_df, tail) ** 2
        scenarios = spread.scenarios * stdtrit(spread.scenarios_df, tail) ** 2
        wide = seeds + scenarios > size**2
        low, high = np.where(wide, middle, low), np.where(wide, high, middle)
    return np.asarray(np.exp((low + high) / 2), dtype=np.float64)


def welch(parts: FloatArray, squares: FloatArray) -> FloatArray:
    """Welch's degrees of freedom of a sum of variances; `squares` is the sum of each squared over its freedom."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(parts > 0, parts**2 / squares, np.inf)
