"""Tests of many pairs: McNemar's and Holm's correction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, gammaln

from auvbench.statistics.intervals import FloatArray


def mcnemar(b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Return McNemar's two-sided mid-p from the discordant counts b (only the first) and c (only the second).

    Twice the lower tail of Binomial(b + c, 1/2) at min(b, c), less the probability of min(b, c) itself; it keeps its level
    better than the exact test, which is too cautious (Fagerland, Lydersen & Laake 2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f}"
    '0.0391'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    point = np.exp(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1) - n * np.log(2.0))
    return np.asarray(np.where(b == c, 1.0, 2 * bdtr(k, n.astype(np.int64), 0.5) - point))


def discordant(success: FloatArray) -> FloatArray:
    """(agents, agents) scenarios in which the row's agent succeeds and the column's does not; (agents, E) of 0, 1."""
    return np.asarray(success @ (1 - success).T, dtype=np.float64)


def holm(p: ArrayLike) -> FloatArray:
    """Holm's (1979, Scand. J. Stat. 6:65) step-down adjusted p-values; NaN is no test and stays NaN.

    >>> holm([0.01, 0.04, 0.03, 0.005]).tolist()
    [0.03, 0.06, 0.06, 0.02]
    """
    p = np.asarray(p, dtype=np.float64)
    adjusted = np.full_like(p, np.nan)
    there = np.flatnonzero(np.isfinite(p))
    order = there[np.argsort(p[there], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted
