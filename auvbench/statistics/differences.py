"""Differences and weighted sums of agents' rates and means, paired by scenario: intervals and p-values.

The variance is that of crossed.py, with the part of the training seeds as `moderation.seed_variance` has it. What makes
a scenario hard for both agents cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from auvbench.statistics.crossed import Crossed, covers, limits, within
from auvbench.statistics.intervals import Estimate, FloatArray, Spread, quantile, welch
from auvbench.statistics.moderation import seed_variance


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All differences row agent - column agent, (n, n) each."""

    difference: FloatArray
    low: FloatArray
    high: FloatArray
    p_value: FloatArray  # two-sided; of equal means

    def estimate(self, i: int, j: int, table: Crossed, confidence: float) -> Estimate:
        """The difference of agent i and agent j as an `Estimate`."""
        value, low, high = (float(a[i, j]) for a in (self.difference, self.low, self.high))
        return Estimate(value, low, high, confidence, covers(table.seeds[[i, j]]))


def pairs(table: Crossed, confidence: float = 0.95) -> Pairs:
    """Return all differences of two agents, paired by scenario, with intervals and t-type p-values.

    Means: t interval of the module's formula. Rates: `_of_rates`. Each interval by itself has the confidence.
    """
    spread = pair_spread(table)
    difference = table.mean[:, None] - table.mean[None, :]
    q = spread.quantile(confidence)
    half = q * np.sqrt(spread.seeds + spread.scenarios)
    low, high = difference - half, difference + half
    if table.rate:
        low, high = _of_rates(table, q, confidence, (low, high))
    least, most = table.least[:, None] - table.most[None, :], table.most[:, None] - table.least[None, :]
    low, high = within(low, difference, high, least, most)
    # The p-values are symmetric: half of them, by bisection, are enough.
    p = np.ones_like(difference)
    upper = np.triu_indices(len(p), 1)
    p[upper] = spread.take(upper).p_value(difference[upper])
    p.T[upper] = p[upper]
    return Pairs(difference, low, high, p)


def _of_rates(
    table: Crossed, q: FloatArray, confidence: float, t: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the ends (n, n) of the differences of rates, `t` being those of the t interval.

    Square-and-add, Newcombe (1998, Stat. Med. 17:873 and 17:2635) and Zou & Donner (2008, Stat. Med. 27:1693): with
    limits l, u of each rate and r the correlation of the two estimates,
    d - sqrt((p1-l1)² - 2 r (p1-l1)(u2-p2) + (u2-p2)²), d + sqrt((u1-p1)² - 2 r (u1-p1)(p2-l2) + (p2-l2)²).
    The limits of an agent with several seeds are those of its own interval, extended to p ± q sd where the squeezed
    variance is larger: as an effective number of trials p (1 - p) / variance it would be less than one trial for a
    rate near its end. Where an agent has several seeds, the ends are extended to the t interval as far as the two
    rates' limits allow, l1 - u2 to u1 - l2: a rate at 1 has no u - p, so square-and-add excludes 0 however
    uncertain the other's seeds are. So the interval contains 0 where the t interval does.
    """
    single = np.maximum(table.seeds[:, None], table.seeds[None, :]) <= 1
    q = np.where(single, quantile(confidence), q)
    low, high = limits(table, q)  # (n, n): agent i at the quantile of (i, j)
    mean, several = table.mean[:, None], table.seeds[:, None] > 1
    reach = q * np.sqrt(seed_variance(table)[0] + table.scenarios)[:, None]
    low = np.where(several, np.maximum(np.minimum(low, mean - reach), 0.0), low)
    high = np.where(several, np.minimum(np.maximum(high, mean + reach), 1.0), high)
    down, up, r = mean - low, high - mean, _correlation(table)
    below = np.sqrt(np.maximum(down**2 - 2 * r * down * up.T + up.T**2, 0.0))
    above = np.sqrt(np.maximum(up**2 - 2 * r * up * down.T + down.T**2, 0.0))
    least, most = mean - mean.T - below, mean - mean.T + above
    farther = (
        np.minimum(least, np.maximum(t[0], low - high.T)),
        np.maximum(most, np.minimum(t[1], high - low.T)),
    )
    return np.where(single, least, farther[0]), np.where(single, most, farther[1])


def pair_spread(table: Crossed, seeds: tuple[FloatArray, FloatArray] | None = None) -> Spread:
    """Return the variance of all differences (n, n); the table's arrays may have leading axes.

    `seeds` is the part of the training seeds (n,) with its degrees of freedom, `seed_variance(table)` if it is absent.
    """
    between, df = seed_variance(table) if seeds is None else seeds
    cov, diagonal = table.between_scenarios, np.diagonal(table.between_scenarios, axis1=-2, axis2=-1)
    scenarios = np.maximum(_sums(diagonal) - 2 * cov - _sums(table.residual), 0.0)
    fewer = np.minimum(table.episodes[..., :, None], table.episodes[..., None, :]) - 1
    both = _sums(between)
    return Spread(both, welch(both, _sums(between**2 / df)), scenarios, fewer)


def _sums(x: FloatArray) -> FloatArray:
    """(n, n) x[i] + x[j]."""
    return np.asarray(x[..., :, None] + x[..., None, :], dtype=np.float64)


def _correlation(table: Crossed) -> FloatArray:
    """Correlation (n, n) of the estimates of two rates; with one seed each Newcombe's, corrected for continuity.

    His psi of method 10 lowers a positive n11 n22 - n12 n21 by n/2, to 0 at most: in covariances by 1/(2 n).
    """
    covariance = table.between_scenarios.copy()
    single = np.maximum(table.seeds[:, None], table.seeds[None, :]) <= 1
    n = np.minimum(table.episodes[:, None], table.episodes[None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        corrected = np.maximum(covariance - 1 / (2 * n * (n - 1)), 0.0)
        covariance = np.where(single & (covariance > 0), corrected, covariance)
        r = covariance / np.sqrt(np.outer(table.variance, table.variance))
    return np.clip(np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0), -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Contrast:
    """A weighted sum of agents' means with its interval and two-sided p-value of zero."""

    estimate: Estimate
    p_value: float


def contrast(table: Crossed, weights: FloatArray, confidence: float = 0.95) -> Contrast:
    """Return the weighted sum (n,) of the means, such as an effect averaged over matched cells, with a t interval.

    The interval ends where the sum of what is possible does. A rate's contrast has the t interval too: sums of several
    agents' rates are seldom near an end.
    """
    used = np.asarray(weights) != 0
    w = np.where(used, weights, 0.0)[used]
    seeds, df = (part[used] for part in seed_variance(table))
    between = float(w**2 @ seeds)
    noise = float(w**2 @ table.residual[used])
    scenarios = max(float(w @ table.between_scenarios[np.ix_(used, used)] @ w) - noise, 0.0)
    value = float(w @ table.mean[used])
    spread = Spread(
        np.array([between]),
        welch(np.array([between]), np.array([w**4 @ (seeds**2 / df)])),
        np.array([scenarios]),
        np.array([table.episodes[used].min() - 1]),
    )
    half = float(spread.quantile(confidence)[0] * np.sqrt(between + scenarios))
    p = float(spread.p_value(np.array([value]))[0])
    ends = np.array([w * table.least[used], w * table.most[used]])
    least, most = ends.min(axis=0).sum(), ends.max(axis=0).sum()
    low, high = (float(end) for end in within(value - half, value, value + half, least, most))
    return Contrast(Estimate(value, low, high, confidence, covers(table.seeds[used])), p)
