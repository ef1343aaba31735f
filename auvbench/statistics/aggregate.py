"""What is asked of several tasks at once, and of the next training: interquartile mean, optimality gap, tolerance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import expit, logit, ndtri

from auvbench.statistics.bootstrap import iqm
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray

FEW_SEEDS = 2
CONTENT = 0.9
"""share of trainings that a tolerance interval holds"""

Aggregate = Callable[[FloatArray], FloatArray]
"""of scores (..., n), over the last axis"""


def interquartile(scores: FloatArray) -> FloatArray:
    """Mean of the middle half of scores (..., n): Agarwal et al. (2021, NeurIPS), as rliable."""
    return np.asarray(iqm(scores))


def optimality_gap(scores: FloatArray, target: float = 1.0) -> FloatArray:
    """How far scores (..., n) stay below a target on average; what exceeds it does not count."""
    return np.asarray(target - np.minimum(scores, target).mean(axis=-1))


def stratified(
    strata: Sequence[FloatArray],
    aggregate: Aggregate,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator,
) -> Estimate:
    """An aggregate of all scores with its stratified bootstrap interval: seeds are drawn stratum by stratum.

    Percentiles, as rliable's (Agarwal et al. 2021); of S seeds S - 1 are drawn (Rao & Wu 1988), without which the
    interval is a third too short at three. With few seeds it still holds less often than it says (docs/statistics-appendix.md).

    Args:
        strata: scores (seeds, tasks) of each group of trainings that were trained for the same, such as a vehicle. The
            tasks of a stratum are those that the same policies were tested on: a seed is drawn with all of its
            scores, for they are one training's luck.
        aggregate: of the scores of all strata together.
        confidence: of the interval, which is NaN where a stratum has one seed.
        resamples: draws.
        rng: of the draws.
    """
    value = float(aggregate(np.concatenate([scores.reshape(-1) for scores in strata])))
    if min(len(scores) for scores in strata) < FEW_SEEDS:
        return Estimate(value, np.nan, np.nan, confidence)
    drawn = [
        scores[rng.integers(len(scores), size=(resamples, len(scores) - 1))].reshape(resamples, -1)
        for scores in strata
    ]
    tail = (1 - confidence) / 2
    low, high = np.quantile(aggregate(np.concatenate(drawn, axis=1)), [tail, 1 - tail])
    return Estimate(value, float(min(low, value)), float(max(high, value)), confidence, "training seeds")


def tolerance_factor(n: int, content: float = CONTENT, confidence: float = 0.95) -> float:
    """Factor k of the normal tolerance interval mean ± k s of n values, which holds `content` of all that could be.

    Howe (1969, J. Am. Stat. Assoc. 64:610): z sqrt((n - 1)(1 + 1/n) / chi2(1 - confidence; n - 1)), within 1 % of the
    exact 8.31, 4.29 and 2.86 of these examples.

    >>> [round(tolerance_factor(n), 2) for n in (3, 5, 10)]
    [8.39, 4.27, 2.84]
    """
    from scipy.stats import chi2  # half a second of imports that most reports do not need

    z = float(ndtri((1 + content) / 2))
    return z * float(np.sqrt((n - 1) * (1 + 1 / n) / chi2.ppf(1 - confidence, n - 1)))


def tolerance(
    values: FloatArray, *, episodes: int | None = None, content: float = CONTENT, confidence: float = 0.95
) -> Estimate:
    """Where the next training will end: holds at least `content` of all trainings, with this confidence.

    Args:
        values: (seeds,) a mean per training; of a rate from 0 to 1, with its `episodes`.
        episodes: test episodes behind a rate, which is then taken on the scale log((x + 1/2)/(n - x + 1/2)).
        content: share of trainings.
        confidence: that the interval holds so many.

    Trainings are taken as normal on that scale. Where some fail altogether they are not, and no few seeds tell. The
    interval is NaN with one seed.
    """
    n = len(values)
    centre = float(values.mean())
    if n < FEW_SEEDS:
        return Estimate(centre, np.nan, np.nan, confidence)
    y = values if episodes is None else logit((values * episodes + 0.5) / (episodes + 1))
    half = tolerance_factor(n, content, confidence) * float(y.std(ddof=1))
    low, high = float(y.mean()) - half, float(y.mean()) + half
    if episodes is not None:
        low, high = float(expit(low)), float(expit(high))
    return Estimate(centre, min(low, centre), max(high, centre), confidence, "the next training")
