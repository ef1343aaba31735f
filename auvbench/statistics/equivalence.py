"""Equivalence: is a difference smaller than the smallest one of interest? Two one-sided tests."""

from __future__ import annotations

import numpy as np

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.differences import pair_spread
from auvbench.statistics.intervals import FloatArray


def equivalence(table: Crossed, margin: float) -> FloatArray:
    """P (n, n) that the differences of all pairs of agents are no smaller than `margin`, which is in their unit.

    Two one-sided tests (Schuirmann 1987, J. Pharmacokinet. Biopharm. 15:657): the larger p of "the difference is
    -margin or less" and "it is margin or more", by the t-type test of `differences.pairs`. A p below alpha is the
    same as an interval of confidence 1 - 2 alpha inside ± margin.

    Raises:
        ValueError: the margin is not positive.
    """
    if not margin > 0:
        raise ValueError(f"margin {margin} is not positive")
    spread = pair_spread(table)
    difference = table.mean[:, None] - table.mean[None, :]
    p = np.full_like(difference, np.nan)
    upper = np.triu_indices(len(p), 1)
    sides = []
    for distance in (margin + difference[upper], margin - difference[upper]):
        two_sided = spread.take(upper).p_value(distance)
        sides.append(np.where(distance > 0, two_sided / 2, 1 - two_sided / 2))
    p[upper] = np.maximum(*sides)
    p.T[upper] = p[upper]
    return p
