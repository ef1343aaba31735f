# ruff: noqa: E741  (l is the lane, as in the layout)
"""`plugin.early` compiled: apart from it, because a pilot knows its vehicle without a compiler."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import CORIOLIS, EXTRA, LANES, Y
from auvbench.dynamics.water import relative_velocity

FloatArray = NDArray[np.float64]
L = LANES


@njit(nogil=True)
def add_early(ws: FloatArray) -> None:
    """The wrench on each of 16 vehicles of the workspace, into the terms that `runge_kutta_stage` takes from `EXTRA`."""
    for l in range(L):
        u, v, w, _, _, _ = relative_velocity(ws, l)
        # The rows of C_A hold -M_A here, and what is taken from `EXTRA` is subtracted.
        ay = ws[(CORIOLIS + 1) * L + l] * v
        az = ws[(CORIOLIS + 2) * L + l] * w
        ws[(EXTRA + 6) * L + l] = 2.0 * ay * ws[(Y + 12) * L + l]
        ws[(EXTRA + 11) * L + l] = -(ay + az) * u
