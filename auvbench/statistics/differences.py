"""Compare agents with one run each, paired by scenario: intervals and p-values, McNemar's test and Holm's
correction.

The difference of two controllers varies only with the scenarios. The difficulty that a scenario has for both
controllers cancels in the difference. typical.py compares learners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, gammaln, stdtr

from auvbench.statistics.crossed import Crossed, covers, limits, within
from auvbench.statistics.intervals import Estimate, FloatArray, quantile


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Differences of all pairs of n agents, as (n, n) arrays: the row's agent minus the column's agent."""

    difference: FloatArray
    low: FloatArray
    high: FloatArray
    p: FloatArray
    """(n, n) two-sided p-values of the paired t-test that two means are equal; for rates, use `mcnemar` instead"""

    def estimate(self, i: int, j: int, confidence: float) -> Estimate:
        """Return the difference of agent i and agent j as an `Estimate`."""
        value, low, high = (float(a[i, j]) for a in (self.difference, self.low, self.high))
        return Estimate(value, low, high, confidence, covers(np.ones(2)))


def pairs(table: Crossed, confidence: float = 0.95) -> Pairs:
    """Return all differences of agents with one run each. The intervals are not corrected for multiple comparisons.

    The interval is the paired t interval for means, and Newcombe's square-and-add interval for rates. `table`
    must have covariances (`crossed.crossed` with `paired`).
    """
    cov = table.between_scenarios
    diagonal = np.diagonal(cov)
    error = np.sqrt(np.maximum(diagonal[:, None] + diagonal - 2 * cov, 0.0))
    df = np.minimum(table.episodes[:, None], table.episodes) - 1
    difference = table.mean[:, None] - table.mean
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.where(difference == 0, 1.0, 2 * stdtr(df, -np.abs(difference) / error))
    half = quantile(confidence, df) * error
    low, high = _of_rates(table, confidence) if table.rate else (difference - half, difference + half)
    least, most = table.least[:, None] - table.most, table.most[:, None] - table.least
    low, high = within(low, difference, high, least, most)
    return Pairs(difference, low, high, p)


def _of_rates(table: Crossed, confidence: float) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper limits (n, n) of the differences of rates.

    Square-and-add: Newcombe (1998, Stat. Med. 17:873 and 17:2635), Zou & Donner (2008, Stat. Med. 27:1693).
    With the limits l, u of each rate p, the difference d = p1 - p2 and the correlation r of the two estimates,

        low  = d - sqrt((p1-l1)² - 2 r (p1-l1)(u2-p2) + (u2-p2)²)
        high = d + sqrt((u1-p1)² - 2 r (u1-p1)(p2-l2) + (p2-l2)²)
    """
    mean, n = table.mean[:, None], len(table.mean)
    low, high = limits(table, np.full((n, n), quantile(confidence)))
    down, up, r = mean - low, high - mean, _correlation(table)
    below = np.sqrt(np.maximum(down**2 - 2 * r * down * up.T + up.T**2, 0.0))
    above = np.sqrt(np.maximum(up**2 - 2 * r * up * down.T + down.T**2, 0.0))
    return mean - mean.T - below, mean - mean.T + above


def _correlation(table: Crossed) -> FloatArray:
    """Return the correlations (n, n) of the estimates of two rates, with Newcombe's continuity correction.

    Newcombe (method 10) lowers a positive n11 n22 - n12 n21 of the 2 x 2 table of n scenarios by n/2, but not
    below 0. For the covariance of two means over n scenarios, this is 1/(2 n (n - 1)).
    """
    covariance = table.between_scenarios
    n = np.minimum(table.episodes[:, None], table.episodes)
    with np.errstate(divide="ignore", invalid="ignore"):
        corrected = np.maximum(covariance - 1 / (2 * n * (n - 1)), 0.0)
        covariance = np.where(covariance > 0, corrected, covariance)
        r = covariance / np.sqrt(np.outer(table.variance, table.variance))
    return np.clip(np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0), -1.0, 1.0)


def mcnemar(b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Return McNemar's two-sided mid-p value from the discordant counts: b scenarios in which only the first
    agent succeeds, and c in which only the second does.

    With k = min(b, c) and X from Binomial(b + c, 1/2), the value is 2 P(X <= k) - P(X = k). The error rate of this test
    is closer to the nominal level than the error rate of the exact test, which is too low (Fagerland, Lydersen & Laake
    2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f}"
    '0.0391'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    point = np.exp(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1) - n * np.log(2.0))
    return np.asarray(np.where(b == c, 1.0, 2 * bdtr(k, n.astype(np.int64), 0.5) - point))


def holm(p: ArrayLike) -> FloatArray:
    """Return step-down adjusted p-values (Holm 1979, Scand. J. Stat. 6:65); NaN marks a missing test and stays NaN.

    >>> holm([0.01, 0.04, 0.03, 0.005]).tolist()
    [0.03, 0.06, 0.06, 0.02]
    """
    p = np.asarray(p, dtype=np.float64)
    adjusted = np.full_like(p, np.nan)
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted
