"""Model aiding: compute the velocity through the water with the dynamic model of the vehicle's sheet, also without bottom lock.

The model integrates the equations of motion, with the sheet's numbers, under the agent's commands. It takes attitude and rates from the
estimate but integrates its own velocity, so that this velocity's errors do not depend on the estimate's errors (Hegrenaes and Hallingstad,
"Model-aided INS with sea current estimation for robust underwater navigation", IEEE Journal of Oceanic Engineering 36, 2011). A DVL
measures the velocity over ground, and the model gives the velocity through the water. Their difference is the current,
whose two horizontal components are states of the filter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import called
from auvbench.dynamics.layout import Vector
from auvbench.dynamics.vectors import cross, dot, product, rotation_matrix, subtract, transposed_product
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.navigation import ekf
from auvbench.tasks.navigation.dvl import through_water
from auvbench.tasks.navigation.state import ATTITUDE, CURRENT, MODEL, MODEL_STATES, VELOCITY, is_due
from auvbench.tasks.navigation.turns import attitude_of
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row
from auvbench.vehicles.inspect import shortest_time_constant

if TYPE_CHECKING:
    from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Sheet:
    """Models of N vehicles with the properties of their sheet, without the simulation's drawn properties, faults, currents or waves.

    Args:
        vehicle: model of the sheet.
        n: number of vehicles.
        max_step: longest step of the integration, s.
    """

    def __init__(self, vehicle: VehicleModel, n: int, max_step: float) -> None:
        self.simulator = FossenSimulator(vehicle, n, min(max_step, shortest_time_constant(vehicle)))

    @property
    def velocity(self) -> Floats:
        """Velocities (n, 6) through the water, m/s and rad/s, body axes."""
        return self.simulator.velocity

    def begin(self, indices: Integers, pose: Floats, velocity: Floats) -> None:
        """Restart the models of episodes at their first estimates: poses (n, 7) and velocities (n, 6)."""
        self.simulator.reset(indices, pose[indices], velocity[indices])

    def follow(
        self, action: Floats, pose: Floats, velocity: Floats, duration: float, start: int, stop: int
    ) -> None:
        """Move the vehicles start .. stop - 1 by their commands for `duration` s, from the last estimates of attitude and rates."""
        own, rows = self.simulator, slice(start, stop)
        own.pose[rows] = pose[rows]
        own.velocity[rows, 3:] = velocity[rows, 3:]
        own.advance(action, duration, start, stop)


@row
def predicted(d: Record) -> Vector:
    """Return the estimated velocity through the water in m/s, body axes."""
    return transposed_product(rotation_matrix(attitude_of(d.attitude)), through_water(d))


@row
def put_derivatives(d: Record, way: Vector, work: ekf.Work) -> None:
    """Write the derivatives of the velocity through the water along a direction in body axes: h = way . R^T (v - c)."""
    x, y, _ = along = product(rotation_matrix(attitude_of(d.attitude)), way)
    work.slope[:] = 0.0
    ekf.put_row(work, VELOCITY, along)
    ekf.put_row(work, ATTITUDE, cross(along, through_water(d)))
    work.slope[CURRENT], work.slope[CURRENT + 1] = -x, -y


@called
def correct(d: Record, p: Record, P: Floats, work: ekf.Work, velocity: Vector) -> None:
    """Correct the estimate by `velocity`, the velocity of the sheet's model in m/s, body axes, if a correction is due."""
    if not is_due(d, MODEL):
        return
    d.due[MODEL] = d.time + 1.0 / p.model_rate
    ekf.propagate(d, p, P)
    error = subtract(velocity, predicted(d))
    sd = math.sqrt(p.model_noise**2 + p.model_share**2 * dot(velocity, velocity))
    work.change[:] = 0.0
    for k in range(3):
        way = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
        put_derivatives(d, way, work)
        ekf.update(d, p, P, work, MODEL, k, dot(way, error), sd, VELOCITY, MODEL_STATES)
    ekf.inject(d, p, P, work)
