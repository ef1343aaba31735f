"""The classical baseline: proportional-integral control of the velocity, proportional-derivative control of the heading.

The outer loop, the allocation and the limits are those of `cascade.py`. The drag at the wanted velocity is fed forward;
gains follow from bandwidths and the masses of the vehicle's sheet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Integers
from auvbench.agents.classical.cascade import YAW, Cascade
from auvbench.agents.classical.fins import FinController
from auvbench.config import algorithms, schema
from auvbench.vehicles.actuators import Fin
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


def controller(config: schema.TrainConfig, vehicle: VehicleModel) -> PIDController | FinController:
    """The PID baseline for a vehicle: by thrusters, or by propeller and fins."""
    fins = any(isinstance(unit, Fin) for unit in vehicle.units)
    return FinController(config, vehicle) if fins else PIDController(config, vehicle)


class PIDController(Cascade):
    """PI on velocities, PD on the heading."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, algorithms.PID)
        self.gains = gains
        super().__init__(config, vehicle)

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        self.integral: Floats = np.zeros((len(episodes), 3))

    def memory(self) -> dict[str, NDArray[Any]]:
        """As `Estimator.memory`, with the integral action."""
        return {**self.estimate.memory(), "integral": self.integral}

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        g, now = self.gains, self.estimate
        wrench = np.zeros((len(wanted), 6))
        miss = wanted - velocity
        wrench[:, :3] = self.mass[:3] * (g.bandwidth * miss + self.integral) + self._drag(wanted)
        omega = g.heading_bandwidth
        wrench[:, YAW] = self.mass[YAW] * (omega**2 * now.yaw_error - 2.0 * omega * now.yaw_rate)
        return wrench

    def after(self, miss: Floats, free: NDArray[np.bool_]) -> None:
        # Conditional integration: no wind-up while the thrusters give all they may.
        step = self.gains.bandwidth / self.gains.integral_time * self.dt
        self.integral += np.where(free[:, None], step * miss, 0.0)
