"""What actions stand for, by a vehicle's sheet: without the compiler."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.model import VehicleModel
from auvbench.vehicles.physical import PhysicalCommands

Floats = NDArray[np.float64]


class SheetThrust:
    """Actions of one vehicle as what its topics take.

    Args:
        vehicle: the model.

    Attributes:
        actuators: names, in the order of the action.
        neutral: (n_u,) what a command of 0 stands for.

    """

    def __init__(self, vehicle: VehicleModel) -> None:
        self._vehicle = vehicle
        self._physical = PhysicalCommands(vehicle)
        self.actuators = vehicle.actuators
        self.neutral = self._physical.neutral

    def quantities(self, action: Floats) -> Floats:
        """N of thrusters, rad, m or m3 of others (n_u,) for an action (n_u,) in [-1, 1]."""
        values = np.array([float(unit.curve(a)) for unit, a in zip(self._vehicle.units, action, strict=True)])
        return np.asarray(self._physical.quantities(values[None])[0])

    def force(self, action: Floats) -> Floats:
        """N (n_u,) of the thrusters; 0 of others."""
        return self._vehicle.force(action)

    def power(self, action: Floats) -> float:
        """Electrical power in W."""
        return float(self._vehicle.power(action))
