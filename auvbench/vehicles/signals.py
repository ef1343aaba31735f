"""Compute commands that excite a vehicle for identification.

The module needs only NumPy, so that it also runs on a vehicle's own computer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

SHORT, LONG = 0.4, 3.0
"""Shortest and longest time for which a telegraph signal stays at one level, s"""
NEUTRAL = 0.5
"""Time without a command at the start of a signal, s"""
INTERVAL = 0.02
"""Time between two rows of commands, s"""


def direction(vehicle: VehicleModel, axis: str) -> FloatArray:
    """Return thruster forces (n_u,) in N along one axis, with the most loaded thruster at its limit.

    The forces and moments along all other controllable axes are zero.
    """
    B = vehicle.allocation
    wanted = np.zeros(6)
    wanted[AXES.index(axis)] = 1.0
    rows = [AXES.index(name) for name in vehicle.controllable]
    force = np.linalg.pinv(B[rows]) @ wanted[rows]
    limits = vehicle.force_limits
    reach = np.where(force >= 0.0, limits[:, 1], -limits[:, 0])
    load = np.abs(force) / np.where(reach > 0.0, reach, np.inf)
    return np.asarray(force / max(float(load.max(initial=0.0)), 1e-12))


def telegraph(
    vehicle: VehicleModel,
    axes: Sequence[str],
    duration: float,
    amplitude: float,
    generator: np.random.Generator,
    *,
    lift: float = 0.0,
) -> FloatArray:
    """Return commands (T, n_u), one row every `INTERVAL` s: random levels of force along one axis after another.

    Args:
        vehicle: vehicle that the commands excite.
        axes: axes in their order; each axis gets the same share of the time.
        duration: duration of the signal, s.
        amplitude: largest level, as a fraction of the largest force along an axis, up to 1.
        generator: source of the times and levels.
        lift: constant force along heave in N; ignored if heave is not controllable.
    """
    rows = round(duration / INTERVAL)
    force = np.zeros((rows, len(vehicle.units)))
    share = rows // len(axes)
    for number, axis in enumerate(axes):
        push = direction(vehicle, axis)
        at, sign = number * share, 1.0
        if number == 0:  # The vehicle is at rest when a log starts, so that the initial state is known.
            at = min(round(NEUTRAL / INTERVAL), rows // 2)
        while at < (number + 1) * share:
            hold = max(1, round(float(generator.uniform(SHORT, LONG)) / INTERVAL))
            end = min(at + hold, (number + 1) * share)
            # Two levels of each sign, since telling linear from quadratic damping needs two speeds.
            force[at:end] = sign * amplitude * float(generator.choice([0.4, 1.0])) * push
            at, sign = end, -sign
    if lift and "heave" in vehicle.controllable:
        push = direction(vehicle, "heave")
        force += lift / float(vehicle.allocation[2] @ push) * push
    return vehicle.action(force)
