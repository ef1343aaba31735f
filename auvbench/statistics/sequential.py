"""Looking more than once, planned: bounds of group-sequential tests.

Who adds seeds until a difference is resolved at 5 % finds one far more often where there is none. A
planned design fixes beforehand after how many seeds one looks, and asks for more at each look, so that all looks
together err as often as one test does: Pocock (1977, Biometrika 64:191) asks for the same at each, O'Brien & Fleming
(1979, Biometrics 35:549) for much at first and for hardly more than a single test at last.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from auvbench.statistics.intervals import FloatArray

SHAPES = ("pocock", "obrien-fleming")
_GRID = 1201


def crossing(fractions: ArrayLike, bounds: FloatArray) -> float:
    """Probability that a standard normal statistic without effect exceeds a bound in size at some look.

    Args:
        fractions: share of the information at each look, rising to 1.
        bounds: (looks,) of the size of the statistic.

    The statistics Z_k are those of a Brownian motion at these fractions (Jennison & Turnbull 2000, Group Sequential
    Methods, ch. 3): Z_k sqrt(t_k) gains independent normal increments. Integrated look by look over where no bound
    was crossed (Armitage, McPherson & Rowe 1969, J. R. Stat. Soc. A 132:235), by Simpson's rule.
    """
    t = np.asarray(fractions, dtype=np.float64)
    ends = bounds * np.sqrt(t)
    weights = np.ones(_GRID)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    points = np.linspace(-ends[0], ends[0], _GRID)
    density = np.exp(-(points**2) / (2 * t[0])) / np.sqrt(2 * np.pi * t[0])
    for k in range(1, len(t)):
        inside = weights * (points[1] - points[0]) / 3 * density
        following = np.linspace(-ends[k], ends[k], _GRID)
        step = t[k] - t[k - 1]
        kernel = np.exp(-((following[:, None] - points[None, :]) ** 2) / (2 * step)) / np.sqrt(
            2 * np.pi * step
        )
        points, density = following, kernel @ inside
    return float(1 - (weights * density).sum() * (points[1] - points[0]) / 3)


def levels(fractions: Sequence[float], alpha: float = 0.05, shape: str = "pocock") -> FloatArray:
    """Two-sided p-value (looks,) below which each look may stop, so that all together err with `alpha`.

    Args:
        fractions: share of the last look's seeds at each look, rising to 1.
        alpha: of all looks together.
        shape: "pocock" or "obrien-fleming".

    >>> [round(float(p), 4) for p in levels([1 / 3, 2 / 3, 1.0])]
    [0.0221, 0.0221, 0.0221]
    """
    t = np.asarray(fractions, dtype=np.float64)
    if shape not in SHAPES or t.size == 0 or t[-1] != 1 or (np.diff(t) <= 0).any() or t[0] <= 0:
        raise ValueError(f"levels needs rising fractions that end at 1 and one of {SHAPES}")
    form = np.ones_like(t) if shape == "pocock" else 1 / np.sqrt(t)
    from scipy.optimize import brentq  # a tenth of a second of imports that most commands do not need

    low = float(-ndtri(alpha / 2))
    factor = low if len(t) == 1 else brentq(lambda c: crossing(t, c * form) - alpha, low, low + 3, xtol=1e-8)
    return np.asarray(2 * ndtr(-factor * form))
