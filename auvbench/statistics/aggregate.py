"""Aggregates over several tasks: interquartile mean and optimality gap."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from auvbench.statistics.intervals import Estimate, FloatArray

FEW_SEEDS = 2

Aggregate = Callable[[FloatArray], FloatArray]
"""of scores (..., n), over the last axis"""


def interquartile(scores: FloatArray) -> FloatArray:
    """Return the mean of the middle half of scores (..., n): Agarwal et al. (2021, NeurIPS), as rliable.

    >>> float(interquartile(np.array([0.0, 1.0, 2.0, 3.0, 100.0, 3.0, 2.0, -50.0])))
    2.0
    """
    from scipy.stats import trim_mean  # half a second of imports that most reports do not need

    return np.asarray(trim_mean(scores, 0.25, axis=-1))


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
