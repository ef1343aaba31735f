# ruff: noqa: E741  (l is the lane, as in the layout)
"""A vehicle's velocity through the water, one of the workspace at a time, and a force that depends on it.

The loops of `equations` have the same inside: with a call in it the one over the off-diagonal added mass takes a third longer.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import CORIOLIS, CURRENT, EXTRA, LANES, Y

FloatArray = NDArray[np.float64]
L = LANES


@njit(nogil=True)
def relative_velocity(ws: FloatArray, l: int) -> tuple[float, float, float, float, float, float]:
    """Velocity through the water (3) and the world's z axis (3), in body axes."""
    qw = ws[(Y + 3) * L + l]
    qx = ws[(Y + 4) * L + l]
    qy = ws[(Y + 5) * L + l]
    qz = ws[(Y + 6) * L + l]
    depth = (ws[(CURRENT + 6) * L + l] - ws[(Y + 2) * L + l]) * ws[(CURRENT + 7) * L + l]
    s = min(max(depth, 0.0), 1.0)
    cx = ws[CURRENT * L + l] + s * ws[(CURRENT + 3) * L + l]
    cy = ws[(CURRENT + 1) * L + l] + s * ws[(CURRENT + 4) * L + l]
    cz = ws[(CURRENT + 2) * L + l] + s * ws[(CURRENT + 5) * L + l]
    zx = 2.0 * (qx * qz - qw * qy)
    zy = 2.0 * (qy * qz + qw * qx)
    zz = 1.0 - 2.0 * (qx * qx + qy * qy)
    u = (1.0 - 2.0 * (qy * qy + qz * qz)) * cx + 2.0 * (qx * qy + qw * qz) * cy + zx * cz
    v = 2.0 * (qx * qy - qw * qz) * cx + (1.0 - 2.0 * (qx * qx + qz * qz)) * cy + zy * cz
    w = 2.0 * (qx * qz + qw * qy) * cx + 2.0 * (qy * qz - qw * qx) * cy + zz * cz
    return ws[(Y + 7) * L + l] - u, ws[(Y + 8) * L + l] - v, ws[(Y + 9) * L + l] - w, zx, zy, zz


@njit(nogil=True)
def add_early(ws: FloatArray) -> None:
    """`rigid_body.early` compiled: the wrench on each of 16 vehicles of the workspace, into the terms that `runge_kutta_stage` takes from `EXTRA`."""
    for l in range(L):
        u, v, w, _, _, _ = relative_velocity(ws, l)
        # The rows of C_A hold -M_A here, and what is taken from `EXTRA` is subtracted.
        ay = ws[(CORIOLIS + 1) * L + l] * v
        az = ws[(CORIOLIS + 2) * L + l] * w
        ws[(EXTRA + 6) * L + l] = 2.0 * ay * ws[(Y + 12) * L + l]
        ws[(EXTRA + 11) * L + l] = -(ay + az) * u
