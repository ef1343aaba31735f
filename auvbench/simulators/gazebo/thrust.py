"""Thrusters of N vehicles between the command and Gazebo: the sheet's curves, lags and limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]


class Thrust:
    """Forces of N vehicles' thrusters under a held command.

    Gazebo's Thruster plugin gives newtons at once, so curves and lags act before it. The linear dynamics are discretised
    exactly; the force of a physics step is that of its middle.

    Args:
        vehicle: whose thrusters.
        n: how many vehicles.
    """

    def __init__(self, vehicle: VehicleModel, n: int) -> None:
        self.vehicle = vehicle
        self._rest = np.concatenate([np.zeros(0), *(unit.rest for unit in vehicle.units)])
        self.states: FloatArray = np.tile(self._rest, (n, 1))
        """(n, n_actuator_states)"""
        self._exact: dict[float, list[tuple[FloatArray, FloatArray]]] = {}

    def reset(self, indices: NDArray[np.integer]) -> None:
        """Put the thrusters of vehicles `indices` (k,) at rest."""
        self.states[indices] = self._rest

    def forces(self, command: FloatArray, steps: int, step: float) -> FloatArray:
        """Advance the states; return forces (steps, n, n_u) in N of the next physics steps of `step` seconds.

        Args:
            command: (n, n_u) in [-1, 1].
            steps: number of physics steps.
            step: s.
        """
        forces = np.empty((steps, *command.shape))
        exact = self._discretised(step / 2.0)
        first = 0
        for a, unit in self.vehicle.thrusters:
            value = unit.curve(command[:, a])
            order = unit.lag.order
            if order == 0:
                forces[:, :, a] = value
            else:
                Ad, Bd = exact[a]
                x = self.states[:, first : first + order]
                for k in range(steps):
                    x = _moved(x, Ad) + value[:, None] * Bd
                    forces[k, :, a] = _moved(x, unit.lag.C[None])[:, 0]
                    x = _moved(x, Ad) + value[:, None] * Bd
                self.states[:, first : first + order] = x
            first += order
            if unit.rotor_constant:
                forces[:, :, a] *= unit.rotor_constant * np.abs(forces[:, :, a])
        return forces

    def _discretised(self, step: float) -> list[tuple[FloatArray, FloatArray]]:
        if step not in self._exact:
            self._exact.clear()
            self._exact[step] = [
                unit.lag.discretise(step) if unit.lag.order else (np.zeros((0, 0)), np.zeros(0))
                for unit in self.vehicle.units
            ]
        return self._exact[step]


def _moved(x: FloatArray, A: FloatArray) -> FloatArray:
    """Return A x for each row of `x` (n, order); the last bits of a matrix product would depend on n."""
    return np.asarray(np.einsum("nj,ij->ni", x, A))
