"""Limits of probabilities from few runs, exact whatever the probability: Clopper & Pearson."""

from __future__ import annotations

import numpy as np
from scipy.special import bdtr, betaincinv


def limits(successes: float, n: float, alpha: float) -> tuple[float, float]:
    """One-sided lower and upper limit of a probability, each wrong with at most `alpha` (Clopper & Pearson 1934).

    Numbers need not be whole: the limits are those of the beta distribution.

    >>> low, high = limits(0, 5, 0.05)
    >>> f"{low:.3f} {high:.3f}"
    '0.000 0.451'
    """
    low = 0.0 if successes <= 0 else float(betaincinv(successes, n - successes + 1, alpha))
    high = 1.0 if successes >= n else float(betaincinv(successes + 1, n - successes, 1 - alpha))
    return low, high


def p_more_than_half(successes: int, n: int) -> float:
    """P-value of "the probability is at most 1/2": as many successes of n, or more, with one half."""
    return float(1 - bdtr(successes - 1, n, 0.5)) if successes > 0 else 1.0


def superiority(
    x: np.ndarray[tuple[int], np.dtype[np.float64]], y: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> float:
    """P(X > Y) + P(X = Y)/2 of two samples."""
    return float(((x[:, None] > y) + 0.5 * (x[:, None] == y)).mean())
