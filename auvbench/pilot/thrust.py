"""Convert actions by a vehicle's sheet, without compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.physical import PhysicalCommands
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class SheetThrust:
    """Converts the actions of one vehicle into the commands of its topics.

    Args:
        vehicle: the model.

    Attributes:
        actuators: names, in the order of the action.
        neutral: (n_u,) the commands of action 0.

    """

    def __init__(self, vehicle: VehicleModel) -> None:
        self._vehicle = vehicle
        self._physical = PhysicalCommands(vehicle)
        self.actuators = vehicle.actuators
        self.neutral = self._physical.neutral

    def quantities(self, action: Floats) -> Floats:
        """Return commands (n_u,), N of thrusters, rad, m or m3 of others, for an action (n_u,) in [-1, 1]."""
        values = np.array([float(unit.curve(a)) for unit, a in zip(self._vehicle.units, action, strict=True)])
        return np.asarray(self._physical.quantities(values[None])[0])

    def force(self, action: Floats) -> Floats:
        """Return forces (n_u,) in N, 0 for actuators that are not thrusters."""
        return self._vehicle.force(action)

    def power(self, action: Floats) -> float:
        """Return the electrical power in W."""
        return float(self._vehicle.power(action))
