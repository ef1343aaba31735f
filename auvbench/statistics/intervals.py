"""The score interval of a rate, and the quantiles that all intervals are built with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri, stdtrit


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its interval."""

    value: float
    low: float
    high: float
    confidence: float = 0.95
    covers: str = "test episodes"
    """what the interval covers: 'test episodes' (one training seed) or 'training seeds and test episodes'"""


FloatArray = NDArray[np.float64]


def quantile(confidence: float, df: ArrayLike = np.inf) -> FloatArray:
    """Two-sided quantile: Student's t with `df` degrees of freedom, the normal where df is infinite."""
    if not 0 < confidence < 1:
        raise ValueError(f"confidence {confidence} is not between 0 and 1")
    upper = 0.5 + confidence / 2
    df = np.asarray(df, dtype=np.float64)
    finite = np.where(np.isfinite(df), df, 1.0)
    return np.where(np.isfinite(df), stdtrit(finite, upper), np.where(np.isnan(df), np.nan, ndtri(upper)))


def score_interval(rate: ArrayLike, n: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Wilson's score interval for a rate seen in n trials, at the quantile z.

    (p + z²/2n ± z sqrt(p(1-p)/n + z²/4n²)) / (1 + z²/n): Wilson (1927), JASA 22:209. n need not be whole: with
    an effective n and Student's quantile it serves clustered data (Dean & Pagano 2015, J. Surv. Stat. Meth. 3:484).
    """
    p, n, z = (np.asarray(value, dtype=np.float64) for value in (rate, n, z))
    with np.errstate(divide="ignore", invalid="ignore"):
        center = p + z**2 / (2 * n)
        half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        low, high = (center - half) / (1 + z**2 / n), (center + half) / (1 + z**2 / n)
    # The ends are exact at the edges; rounding must not leave 1e-18 there. What is unknown stays NaN.
    low = np.where((p <= 0) & np.isfinite(low), 0.0, np.clip(low, 0, 1))
    return low, np.where((p >= 1) & np.isfinite(high), 1.0, np.clip(high, 0, 1))


def wilson(successes: ArrayLike, n: ArrayLike, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Wilson's interval (low, high) for `successes` of `n` independent trials.

    >>> low, high = wilson(81, 263)
    >>> f"{low:.4f} {high:.4f}"
    '0.2553 0.3662'
    """
    successes, n = np.asarray(successes, dtype=np.float64), np.asarray(n, dtype=np.float64)
    if np.any(n <= 0) or np.any(successes < 0) or np.any(successes > n):
        raise ValueError("wilson needs 0 <= successes <= n and n > 0")
    return score_interval(successes / n, n, quantile(confidence))
