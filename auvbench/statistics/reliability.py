"""Reliability: how many trainings hold up on these scenarios, and what failing trainings could do to a mean.

A median hides a failing tenth of the trainings by design, so no verdict about a typical training goes without these numbers. Once
the scenarios are given, trainings are independent, so the interval of their share is exact for any distribution
(Clopper & Pearson 1934, Biometrika 26:404).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.statistics.intervals import FloatArray, limits


@dataclass(frozen=True, slots=True)
class Reliability:
    """Share of all trainings that, tested on these scenarios, are not behind the baseline by more than the margin."""

    count: int
    """trainings that are not behind"""
    trainings: int
    low: float
    """two-sided limits of the share of all trainings that are not behind"""
    high: float
    excluded: float
    """share of failing trainings: larger ones are excluded (one-sided)"""
    mean_turns: float | None
    """share of failing trainings at which the mean would leave the verdict; None where that is not known"""


def reliability(
    gains: FloatArray,
    margin: float,
    *,
    confidence: float = 0.95,
    edge: float = math.nan,
    failure: float = math.nan,
) -> Reliability:
    """Return how many trainings hold up, and the share of failing trainings at which their mean would turn.

    Args:
        gains: (n,) what each training is better by than the baseline.
        margin: a training that is worse by more counts as failing.
        confidence: of the limits, each by itself.
        edge: gain below which the mean would leave the verdict: 0 for ahead, -margin for equivalent.
        failure: gain of a training that fails altogether.

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
