"""Tests and effect sizes between agents that met the same scenarios."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtr, gammaln

from auvbench.statistics.crossed import covers
from auvbench.statistics.intervals import Estimate, FloatArray, quantile, score_interval


def mcnemar(b: ArrayLike, c: ArrayLike, *, mid: bool = True) -> FloatArray:
    """Two-sided p-value of McNemar's test from the discordant counts b (only the first) and c (only the second).

    Exact: twice the lower tail of Binomial(b + c, 1/2) at min(b, c), at most 1. Mid-p: less the probability of
    min(b, c) itself; it keeps its level better than the exact test, which is too cautious, and is the default on
    the advice of Fagerland, Lydersen & Laake (2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f} {float(mcnemar(1, 7, mid=False)):.4f}"
    '0.0391 0.0703'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    exact = np.minimum(2 * bdtr(k, n.astype(np.int64), 0.5), 1.0)
    if not mid:
        return np.asarray(exact)
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


def probability_of_improvement(x: ArrayLike, y: ArrayLike) -> float:
    """P(X > Y) + P(X = Y)/2 of two independent samples: Mann & Whitney's U / (n m).

    >>> probability_of_improvement([1, 2, 3], [1, 2])
    0.6666666666666666
    """
    x, y = np.asarray(x, dtype=np.float64).ravel(), np.asarray(y, dtype=np.float64).ravel()
    from scipy.stats import rankdata  # half a second of imports that most reports do not need

    ranks = rankdata(np.concatenate([x, y]))[: len(x)]
    return float((ranks.sum() - len(x) * (len(x) + 1) / 2) / (len(x) * len(y)))


def wins(first: FloatArray, second: FloatArray) -> FloatArray:
    """(S1, S2, E) 1, 1/2 or 0: does this seed of the first beat that seed of the second on the scenario?"""
    x, y = first[:, None, :], second[None, :, :]
    return np.asarray((x > y) + 0.5 * (x == y), dtype=np.float64)


def improvement(first: FloatArray, second: FloatArray, confidence: float = 0.95) -> Estimate:
    """Probability that the first agent does better than the second on a scenario, ties counted half.

    The arrays (S, E) hold scores, higher is better, column by column the same scenario: the mean of `wins` over
    both agents' seeds and the scenarios. Its variance is the sum of those of the means by seed of the first, by
    seed of the second and by scenario, each over its number; what two of them share is counted twice, so that the
    interval errs on the long side. Wilson's form with the effective number of trials, quantiles as in `crossed`.
    """
    table = wins(first, second)
    value = float(table.mean())
    S1, S2, E = table.shape
    variance, wide = 0.0, 0.0
    for axis, n in ((0, S1), (1, S2), (2, E)):
        if n > 1:
            share = float(table.mean(axis=tuple({0, 1, 2} - {axis})).var(ddof=1)) / n
            variance += share
            wide += share * float(quantile(confidence, n - 1)) ** 2
    most, fewest = float(max(S1, S2) * E), min((n for n in (S1, S2) if n > 1), default=0)
    if fewest == 0:
        q = float(quantile(confidence))
    elif variance > 0:
        q = float(np.sqrt(wide / variance))
    else:
        q = float(quantile(confidence, fewest - 1))
    # Won, lost or tied throughout: no more is known than that so many trials agreed.
    n_effective = min(max(value * (1 - value) / variance, 1.0), most) if variance > 0 else most
    low, high = score_interval(value, n_effective, q)
    return Estimate(value, float(low), float(high), confidence, covers(np.array([S1, S2])))


def improvement_matrix(scores: Sequence[FloatArray]) -> FloatArray:
    """(agents, agents) probability that the row's agent does better than the column's on a scenario.

    `scores` are arrays (S_i, E), higher is better; the mean over all pairs of seeds and the scenarios they share.
    """
    stacked = np.concatenate(list(scores))
    E = stacked.shape[1]
    # Ranks within a scenario order like the scores and compare faster; equal scores get equal ranks.
    ranks = np.empty(stacked.shape, dtype=np.uint16)
    for e in range(E):
        ranks[:, e] = np.unique(stacked[:, e], return_inverse=True)[1]
    n = len(ranks)
    better = np.empty((n, n))
    for i in range(n):
        above = (ranks[i] > ranks[i:]).sum(axis=1)
        below = (ranks[i] < ranks[i:]).sum(axis=1)
        better[i, i:] = (E + above - below) / (2 * E)
        better[i:, i] = 1 - better[i, i:]
    member = np.repeat(np.arange(len(scores)), [len(s) for s in scores])
    average = np.equal.outer(np.arange(len(scores)), member).astype(np.float64)
    average /= average.sum(axis=1, keepdims=True)
    result = average @ better @ average.T
    np.fill_diagonal(result, 0.5)
    return np.asarray(result)


def score(good: NDArray[np.bool_], finer: FloatArray) -> FloatArray:
    """Scores that put every good episode above every other, order the good ones by `finer`, tie the others.

    With good = success and finer = -steps: a success beats a failure, of two successes the quicker one is better,
    two failures are equal (an early collision is no better than a late timeout). NaN in `finer` is the worst.
    """
    span = np.nan_to_num(finer, nan=-np.inf)
    return np.where(good, np.maximum(span, -np.finfo(np.float64).max), -np.inf)
