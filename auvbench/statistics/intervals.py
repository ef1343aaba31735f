"""Compute intervals of rates, limits of probabilities from few trials, and the quantiles for all intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import bdtrc, betaincinv, ndtri, stdtrit


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its interval."""

    value: float
    low: float
    high: float
    confidence: float = 0.95
    covers: str = "test episodes"
    """Source of the interval's uncertainty: `EPISODES_ONLY`, `SEEDS_AND_EPISODES` or `MIXED` of `crossed`; 'agents' for a correlation"""


FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SUCCEEDED = 0.5
"""share of test episodes in which a training must succeed to count as a successful training"""


def quantile(confidence: float, df: ArrayLike = np.inf) -> FloatArray:
    """Return the two-sided quantile of Student's t with `df` degrees of freedom; infinite `df` gives the normal
    distribution.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1, got {confidence}")
    upper = 0.5 + confidence / 2
    df = np.asarray(df, dtype=np.float64)
    finite = np.where(np.isfinite(df), df, 1.0)
    return np.where(np.isfinite(df), stdtrit(finite, upper), np.where(np.isnan(df), np.nan, ndtri(upper)))


def score_interval(rate: ArrayLike, n: ArrayLike, z: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return Wilson's score interval for a rate in n trials, at the quantile z.

    The interval is (p + z²/2n ± z sqrt(p(1-p)/n + z²/4n²)) / (1 + z²/n): Wilson (1927), JASA 22:209. n may be
    a fraction: for clustered data, use an effective n and Student's quantile (Dean & Pagano 2015, J. Surv.
    Stat. Meth. 3:484).
    """
    p, n, z = (np.asarray(value, dtype=np.float64) for value in (rate, n, z))
    with np.errstate(divide="ignore", invalid="ignore"):
        center = p + z**2 / (2 * n)
        half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        low, high = (center - half) / (1 + z**2 / n), (center + half) / (1 + z**2 / n)
    # For a rate of 0 the lower limit is exactly 0, and for a rate of 1 the upper limit is exactly 1, without rounding errors
    # such as 1e-18. Unknown values stay NaN.
    low = np.where((p <= 0) & np.isfinite(low), 0.0, np.clip(low, 0, 1))
    return low, np.where((p >= 1) & np.isfinite(high), 1.0, np.clip(high, 0, 1))


def wilson(successes: ArrayLike, n: ArrayLike, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Return Wilson's interval (low, high) for `successes` of `n` independent trials.

    >>> low, high = wilson(81, 263)
    >>> f"{low:.4f} {high:.4f}"
    '0.2553 0.3662'
    """
    successes, n = np.asarray(successes, dtype=np.float64), np.asarray(n, dtype=np.float64)
    if np.any(n <= 0) or np.any(successes < 0) or np.any(successes > n):
        raise ValueError("wilson needs 0 <= successes <= n and n > 0")
    return score_interval(successes / n, n, quantile(confidence))


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Two parts of the variance of estimates, from seeds and from scenarios, each with its degrees of freedom; arrays of equal shape."""

    seeds: FloatArray
    seeds_df: FloatArray
    scenarios: FloatArray
    scenarios_df: FloatArray

    def quantile(self, confidence: float) -> FloatArray:
        """Return the half width of each estimate's interval, as a multiple of the estimate's standard error."""
        over_seeds, over_scenarios = (quantile(confidence, df) for df in (self.seeds_df, self.scenarios_df))
        with np.errstate(divide="ignore", invalid="ignore"):
            combined = np.sqrt(
                (self.seeds * over_seeds**2 + self.scenarios * over_scenarios**2)
                / (self.seeds + self.scenarios)
            )
        # If one part of the variance is 0, use the quantile of the other part. If both are 0, 0/0 above has given NaN.
        combined = np.where(self.scenarios == 0, over_seeds, combined)
        return np.where(self.seeds == 0, over_scenarios, combined)


def welch(parts: FloatArray, squares: FloatArray) -> FloatArray:
    """Return Welch's degrees of freedom of sums of variances.

    Args:
        parts: sums of the variances.
        squares: sums of variance² / degrees of freedom.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(parts > 0, parts**2 / squares, np.inf)


def succeeded(success: FloatArray) -> int:
    """Return the number of trainings that succeed in at least `SUCCEEDED` of their test episodes.

    `success` (S, E) has 1 for a successful episode, else 0.

    >>> import numpy as np
    >>> succeeded(np.array([[1, 1, 0], [1, 0, 0], [0, 0, 0]]))
    1
    """
    return int((success.mean(axis=1) >= SUCCEEDED).sum())


def limits(successes: float, n: float, alpha: float) -> tuple[float, float]:
    """Return the one-sided lower and upper limit of a probability, each with an error rate of at most `alpha`.

    Clopper & Pearson (1934, Biometrika 26:404). `successes` and `n` may be fractions: the limits are quantiles
    of the beta distribution.

    >>> low, high = limits(0, 5, 0.05)
    >>> f"{low:.3f} {high:.3f}"
    '0.000 0.451'
    """
    low = 0.0 if successes <= 0 else float(betaincinv(successes, n - successes + 1, alpha))
    high = 1.0 if successes >= n else float(betaincinv(successes + 1, n - successes, 1 - alpha))
    return low, high


def trials_that_bound(rate: float, confidence: float = 0.95) -> int:
    """Return the smallest number of trials that shows a failure rate below `rate` if no trial fails.

    This is the exact form of the "rule of three": about 3 / rate trials at 95 % confidence.

    >>> trials_that_bound(0.1), trials_that_bound(0.05)
    (29, 59)
    """
    return math.ceil(math.log1p(-confidence) / math.log1p(-rate))


def p_more_than_half(successes: int, n: int) -> float:
    """Return the one-sided p-value of the hypothesis that the success probability is at most 1/2."""
    return float(bdtrc(successes - 1, n, 0.5))
