"""Solve small dense quadratic programmes: the point nearest to a target that meets linear constraints.

    minimise 1/2 (x - x0)' H (x - x0) + PENALTY/2 |s|^2   with   A x >= b - s,   low <= x <= high

A dual active-set method (Lawson and Hanson, "Solving least squares problems", 1974, chapter 23): the multipliers of the active
constraints solve a linear system; the most violated constraint enters, and a constraint with a negative multiplier leaves. The method ends
after finitely many steps with the exact solution.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

PENALTY = 1e6
"""Cost of the squared slack; the cost of x is of order 1"""
TOLERANCE = 1e-9
"""Tolerance of a constraint, in units of its own scale"""
MOST_STEPS = 200
"""Largest number of changes of the active set; the limit ends cycles that rounding may cause"""


@njit(nogil=True)
def factorise(Q: Floats, n: int) -> bool:
    """Replace the lower triangle of Q[:n, :n] by the Cholesky factor; return whether Q[:n, :n] is positive definite."""
    for i in range(n):
        for j in range(i + 1):
            total = Q[i, j]
            for k in range(j):
                total -= Q[i, k] * Q[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                Q[i, i] = math.sqrt(total)
            else:
                Q[i, j] = total / Q[j, j]
    return True


@njit(nogil=True)
def solve(L: Floats, n: int, z: Floats) -> None:
    """Replace z[:n] by the solution y of L L' y = z."""
    for i in range(n):
        for k in range(i):
            z[i] -= L[i, k] * z[k]
        z[i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            z[i] -= L[k, i] * z[k]
        z[i] /= L[i, i]


@compiled()
def nearest(
    A: Floats, b: Floats, count: int, inverse: Floats, low: Floats, high: Floats, target: Floats, x: Floats
) -> float:
    """Write the solution into `x` (n,); return the largest slack, or infinity if the method does not end.

    Args:
        A: (m, n); its first `count` rows are constraints.
        b: (m,) right-hand sides of the constraints.
        count: number of constraints.
        inverse: (n, n) inverse of H.
        low: (n,) lowest x.
        high: (n,) highest x.
        target: (n,) x0, within the limits.
        x: (n,) array for the solution.
    """
    n = target.shape[0]
    most = count + n
    # For each constraint a x >= c: gain = H^-1 a, and scale = a' H^-1 a. Constraints from `count` on are limits, a = side e_j.
    gain = np.empty((most, n))
    scale = np.empty(most)
    side = np.ones(n)
    for r in range(count):
        total = 0.0
        for j in range(n):
            value = 0.0
            for k in range(n):
                value += inverse[j, k] * A[r, k]
            gain[r, j] = value
            total += value * A[r, j]
        scale[r] = total + 1.0 / PENALTY
    for j in range(n):
        for k in range(n):
            gain[count + j, k] = inverse[j, k]
        scale[count + j] = inverse[j, j]
    active = np.empty(most, np.int64)
    is_active = np.zeros(most, np.bool_)
    multiplier, z = np.zeros(most), np.empty(most)
    L = np.empty((most, most))
    size = 0
    for j in range(n):
        x[j] = target[j]
    for _ in range(MOST_STEPS):
        worst, entering = TOLERANCE, -1
        for r in range(count):
            if is_active[r]:
                continue
            missing = b[r]
            for j in range(n):
                missing -= A[r, j] * x[j]
            missing /= math.sqrt(scale[r])
            if missing > worst:
                worst, entering = missing, r
        for j in range(n):
            if is_active[count + j]:
                continue
            below, above = low[j] - x[j], x[j] - high[j]
            missing = max(below, above) / math.sqrt(scale[count + j])
            if missing > worst:
                worst, entering = missing, count + j
                side[j] = 1.0 if below > above else -1.0
        if entering < 0:
            slack = 0.0
            for i in range(size):
                if active[i] < count:
                    slack = max(slack, multiplier[i] / PENALTY)
            for j in range(n):
                x[j] = min(max(x[j], low[j]), high[j])
            return slack
        active[size], multiplier[size], is_active[entering] = entering, 0.0, True
        size += 1
        while size > 0:
            for i in range(size):
                p = active[i]
                z[i] = residual(A, b, count, low, high, side, target, p)
                for k in range(i + 1):
                    L[i, k] = coupling(A, gain, count, side, p, active[k])
                if p < count:
                    L[i, i] += 1.0 / PENALTY
            if not factorise(L, size):
                return np.inf
            solve(L, size, z)
            share = 1.0
            for i in range(size):
                if z[i] <= 0.0:
                    share = min(share, multiplier[i] / (multiplier[i] - z[i]) if multiplier[i] > 0.0 else 0.0)
            if share == 1.0:
                for i in range(size):
                    multiplier[i] = z[i]
                break
            size_kept = 0
            for i in range(size):
                value = multiplier[i] + share * (z[i] - multiplier[i])
                if z[i] <= 0.0 and value <= 1e-14 * (multiplier[i] - z[i]):
                    is_active[active[i]] = False
                    continue
                active[size_kept], multiplier[size_kept] = active[i], value
                size_kept += 1
            size = size_kept
        for j in range(n):
            x[j] = target[j]
        for i in range(size):
            p = active[i]
            factor = multiplier[i] * (1.0 if p < count else side[p - count])
            for j in range(n):
                x[j] += factor * gain[p, j]
    for j in range(n):
        x[j] = min(max(x[j], low[j]), high[j])
    return np.inf


@njit(nogil=True)
def residual(
    A: Floats, b: Floats, count: int, low: Floats, high: Floats, side: Floats, target: Floats, p: int
) -> float:
    """Return the amount by which the target violates constraint p; negative if the target meets it."""
    if p >= count:
        j = p - count
        return float(low[j] - target[j] if side[j] > 0.0 else target[j] - high[j])
    missing = float(b[p])
    for j in range(target.shape[0]):
        missing -= A[p, j] * target[j]
    return missing


@njit(nogil=True)
def coupling(A: Floats, gain: Floats, count: int, side: Floats, p: int, q: int) -> float:
    """Return a_p' H^-1 a_q of two constraints."""
    factor = 1.0 if q < count else float(side[q - count])
    if p >= count:
        return float(factor * side[p - count] * gain[q, p - count])
    total = 0.0
    for j in range(side.shape[0]):
        total += A[p, j] * gain[q, j]
    return float(factor * total)
