"""Probabilities from few trials: which trainings succeeded, and exact limits (Clopper & Pearson)."""

from __future__ import annotations

import math

from scipy.special import bdtr, betaincinv

from auvbench.statistics.intervals import FloatArray

SUCCEEDED = 0.5
"""share of the test episodes that a training that succeeded reaches at least"""


def succeeded(success: FloatArray) -> int:
    """Return how many trainings succeeded, from their test episodes (S, E) of 0 and 1.

    >>> import numpy as np
    >>> succeeded(np.array([[1, 1, 0], [1, 0, 0], [0, 0, 0]]))
    1
    """
    return int((success.mean(axis=1) >= SUCCEEDED).sum())


def limits(successes: float, n: float, alpha: float) -> tuple[float, float]:
    """Return the one-sided lower and upper limit of a probability, each wrong with at most `alpha`.

    Clopper & Pearson (1934, Biometrika 26:404). Numbers need not be whole: the limits are those of the beta distribution.

    >>> low, high = limits(0, 5, 0.05)
    >>> f"{low:.3f} {high:.3f}"
    '0.000 0.451'
    """
    low = 0.0 if successes <= 0 else float(betaincinv(successes, n - successes + 1, alpha))
    high = 1.0 if successes >= n else float(betaincinv(successes + 1, n - successes, 1 - alpha))
    return low, high


def trials_that_bound(rate: float, confidence: float = 0.95) -> int:
    """Return how many trials without a failure show that less than `rate` of all fail.

    The exact form of the "rule of three", 3 / rate at 95 %.

    >>> trials_that_bound(0.1), trials_that_bound(0.05)
    (29, 59)
    """
    return math.ceil(math.log1p(-confidence) / math.log1p(-rate))


def p_more_than_half(successes: int, n: int) -> float:
    """Return the p-value of "the probability is at most 1/2" for so many successes of n, or more."""
    return float(1 - bdtr(successes - 1, n, 0.5)) if successes > 0 else 1.0
