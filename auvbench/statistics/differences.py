"""Compare agents with one run each, paired by scenario: intervals and p-values, McNemar's test and Holm's
correction.

The difference of two controllers varies only with the scenarios, and what makes a scenario hard for the two
agents cancels. typical.py compares learners.
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
    """All differences row agent - column agent, (n, n) each."""

    difference: FloatArray
    low: FloatArray
    high: FloatArray
    p: FloatArray
    """two-sided p-values of equal means, from the paired t-test; for rates, McNemar's test is better"""

    def estimate(self, i: int, j: int, confidence: float) -> Estimate:
        """Return the difference of agent i and agent j as an `Estimate`."""
        value, low, high = (float(a[i, j]) for a in (self.difference, self.low, self.high))
        return Estimate(value, low, high, confidence, covers(np.ones(2)))


def pairs(table: Crossed, confidence: float = 0.95) -> Pairs:
    """Return all differences of agents with one run each; each interval has the confidence by itself.

    For means this is the paired t interval, for rates Newcombe's square-and-add interval. `table` must have
    covariances (`crossed.crossed`).
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
    """Return the limits (n, n) of the differences of rates.

    Square-and-add: Newcombe (1998, Stat. Med. 17:873 and 17:2635), Zou & Donner (2008, Stat. Med. 27:1693).
    With limits l, u of each rate and the correlation r of the two estimates, the limits are d - sqrt((p1-l1)²
    - 2 r (p1-l1)(u2-p2) + (u2-p2)²) and d + sqrt((u1-p1)² - 2 r (u1-p1)(p2-l2) + (p2-l2)²).
    """
    mean, n = table.mean[:, None], len(table.mean)
    low, high = limits(table, np.full((n, n), quantile(confidence)))
    down, up, r = mean - low, high - mean, _correlation(table)
    below = np.sqrt(np.maximum(down**2 - 2 * r * down * up.T + up.T**2, 0.0))
    above = np.sqrt(np.maximum(up**2 - 2 * r * up * down.T + down.T**2, 0.0))
    return mean - mean.T - below, mean - mean.T + above


def _correlation(table: Crossed) -> FloatArray:
    """Return the correlation (n, n) of the estimates of two rates: Newcombe's, with continuity correction.

    Newcombe's psi (method 10) lowers a positive n11 n22 - n12 n21 by n/2, but not below 0; in covariances by
    1/(2 n).
    """
    covariance = table.between_scenarios
    n = np.minimum(table.episodes[:, None], table.episodes)
    with np.errstate(divide="ignore", invalid="ignore"):
        corrected = np.maximum(covariance - 1 / (2 * n * (n - 1)), 0.0)
        covariance = np.where(covariance > 0, corrected, covariance)
        r = covariance / np.sqrt(np.outer(table.variance, table.variance))
    return np.clip(np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0), -1.0, 1.0)


def mcnemar(b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Return McNemar's two-sided mid-p from the discordant counts b (only the first) and c (only the second).

    The value is twice the lower tail of Binomial(b + c, 1/2) at min(b, c), less the probability of min(b, c)
    itself. It keeps its level better than the exact test, which is too cautious (Fagerland, Lydersen & Laake
    2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f}"
    '0.0391'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    point = np.exp(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1) - n * np.log(2.0))
    return np.asarray(np.where(b == c, 1.0, 2 * bdtr(k, n.astype(np.int64), 0.5) - point))


def holm(p: ArrayLike) -> FloatArray:
    """Return Holm's (1979, Scand. J. Stat. 6:65) step-down adjusted p-values; NaN means no test and stays
    NaN.

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
