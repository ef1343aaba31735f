"""What commands stand for, as the compiled simulator computes it: for simulators that act elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.actuation import report, static_curves
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.layout import LANES

FloatArray = NDArray[np.float64]


@compiled()
def commanded(
    command: FloatArray,  # (n, n_u) in [-1, 1], clipped
    units: FloatArray,  # (n_u, ACTUATOR_COLUMNS)
    tables: FloatArray,  # (k, points)
    quantity: FloatArray,  # (n, n_u) out: what the curves make of the commands, N, rad/s, rad, m or m3
    force: FloatArray,  # (n, n_u) out: N of the thrusters
    power: FloatArray,  # (n,) out: electrical W
) -> None:
    """The same bits as `kernel.advance` leaves in its `force` and `power`."""
    n, n_u = command.shape
    value = np.empty((n_u, LANES))
    for block in range((n + LANES - 1) // LANES):
        first = block * LANES
        for lane in range(LANES):
            i = min(first + lane, n - 1)
            for a in range(n_u):
                value[a, lane] = command[i, a]
        static_curves(units, tables, value)
        for lane in range(min(LANES, n - first)):
            for a in range(n_u):
                quantity[first + lane, a] = value[a, lane]
        report(first, units, tables, value, force, power)
