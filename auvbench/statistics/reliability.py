"""Compute reliability: how many trainings are not behind the baseline, and how many failing trainings would
change the verdict on the mean.

A median does not show that a tenth of the trainings fail, so every verdict about a typical training comes with these
numbers. On fixed scenarios trainings are independent, so the interval of a share of trainings is exact for
any distribution (Clopper & Pearson 1934, Biometrika 26:404).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.statistics.intervals import FloatArray, limits


@dataclass(frozen=True, slots=True)
class Reliability:
    """Reliability of an agent on the test's scenarios: a training is behind if it loses to the baseline by more than the margin."""

    count: int
    """Number of trainings that are not behind"""
    trainings: int
    low: float
    """Lower limit of the two-sided interval of the share of all trainings that are not behind; `high` is its upper limit"""
    high: float
    excluded: float
    """Upper one-sided limit of the share of trainings that are behind"""
    mean_turns: float | None
    """Smallest share of completely failing trainings that would change the verdict on the mean; None if unknown"""


def reliability(
    gains: FloatArray,
    margin: float,
    *,
    confidence: float = 0.95,
    edge: float = math.nan,
    failure: float = math.nan,
) -> Reliability:
    """Return how many trainings are not behind, and the smallest share of completely failing trainings
    that would change the verdict on the mean.

    Args:
        gains: (n,) gain of each training over the baseline.
        margin: largest loss to the baseline with which a training is not behind.
        confidence: confidence of each interval and of the one-sided limit.
        edge: mean gain below which the verdict on the mean changes: 0 for the verdict ahead, -margin for equivalent.
        failure: gain of a training that fails completely.

    >>> import numpy as np
    >>> found = reliability(np.array([-9.0, *[1.0] * 19]), 0.5)
    >>> f"{found.count} of {found.trainings} [{found.low:.2f}, {found.high:.2f}], {found.excluded:.2f}"
    '19 of 20 [0.75, 1.00], 0.22'
    """
    n, alpha = len(gains), 1 - confidence
    good = int((gains >= -margin).sum())
    low, high = limits(good, n, alpha / 2)
    mean = float(gains.mean())
    turns = max((mean - edge) / (mean - failure), 0.0) if mean > failure and math.isfinite(edge) else None
    return Reliability(good, n, low, high, limits(n - good, n, alpha)[1], turns)
