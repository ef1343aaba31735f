"""Convert a `VehicleModel` into the arrays of the compiled kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import layout
from auvbench.dynamics.kernel import PARAMETER_ROWS
from auvbench.dynamics.rigid_body import rigid_body_mass
from auvbench.vehicles.actuators import Thruster
from auvbench.vehicles.curves import Lag, t200_power
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]


def parameter_rows(vehicle: VehicleModel, scales: FloatArray) -> FloatArray:
    """Return parameters (k, PARAMETER_ROWS) of vehicles whose properties are scaled by `scales` (k, 6)."""
    mass, buoyancy, inertia, added, damping, thrust = (scales[:, j, None] for j in range(6))
    r_g = vehicle.center_of_gravity
    no_inertia = np.zeros((3, 3))
    M_mass = rigid_body_mass(vehicle.mass, r_g, no_inertia)
    M_inertia = rigid_body_mass(0.0, r_g, vehicle.inertia)
    M_RB = mass[..., None] * M_mass + inertia[..., None] * M_inertia
    M_A = added[..., None] * vehicle.M_A
    rows = np.zeros((scales.shape[0], PARAMETER_ROWS))

    def put(row: int, values: NDArray[np.floating[Any]]) -> None:
        first = row - layout.PARAMETERS
        rows[:, first : first + values.shape[1]] = values

    upper = np.triu_indices(6)
    strict = np.triu_indices(6, 1)
    angular = M_RB[:, 3:, 3:]
    coriolis = vehicle.coriolis_sign * M_A
    put(layout.MASS, M_RB[:, :1, 0])
    put(layout.MOMENT, mass * (vehicle.mass * r_g))
    put(layout.INERTIA, angular[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    put(layout.ADDED, np.diagonal(M_A, axis1=1, axis2=2))
    put(layout.CORIOLIS, np.diagonal(coriolis, axis1=1, axis2=2))
    put(layout.LINEAR, damping * vehicle.linear_damping)
    put(layout.QUADRATIC, damping * vehicle.quadratic_damping)
    weight, lift = mass * vehicle.weight, buoyancy * vehicle.buoyancy
    put(layout.NET, lift - weight)
    put(layout.LEVER, lift * vehicle.center_of_buoyancy - weight * r_g)
    put(layout.INVERSE, np.linalg.inv(M_RB + M_A)[:, upper[0], upper[1]])
    put(layout.ADDED_OFF, M_A[:, strict[0], strict[1]])
    put(layout.CORIOLIS_OFF, coriolis[:, strict[0], strict[1]])
    put(layout.THRUST, thrust)
    displaced = lift / vehicle.gravity
    put(layout.DISPLACED, np.hstack([displaced, displaced * vehicle.center_of_buoyancy]))
    return rows


def unit_table(vehicle: VehicleModel) -> tuple[FloatArray, FloatArray]:
    """Return the table of actuators (n_u, ACTUATOR_COLUMNS) and the table of curves (1 + curves, points).

    Row 0 of the curves is electrical power over force: the largest force F, then powers at equally spaced forces
    from -F to F. The others start with their number of entries.
    """
    table = np.zeros((len(vehicle.units), layout.ACTUATOR_COLUMNS))
    largest, power = t200_power()
    curves = [np.concatenate(([largest], power))]
    state = 0
    for row, unit in zip(table, vehicle.units, strict=True):
        row[layout.KIND] = unit.code
        row[layout.CURVE] = unit.curve.code
        row[layout.LOW], row[layout.HIGH] = unit.curve.limits
        row[layout.NEUTRAL] = unit.curve.neutral
        if (values := unit.curve.entries).size:
            row[layout.TABLE] = len(curves)
            curves.append(np.concatenate(([values.size], values)))
        row[layout.ORDER] = unit.rest.size
        row[layout.FIRST_STATE] = state
        state += unit.rest.size
        row[layout.RATE] = unit.rate
        for column, value in unit.coefficients().items():
            row[column] = value
    packed = np.zeros((len(curves), max(curve.size for curve in curves)))
    for target, curve in zip(packed, curves, strict=True):
        target[: curve.size] = curve
    return table, packed


def geometry_table(vehicle: VehicleModel) -> FloatArray:
    """Return the table of geometry (n_u, GEOMETRY_COLUMNS)."""
    table = np.zeros((len(vehicle.units), layout.GEOMETRY_COLUMNS))
    table[:, :6] = vehicle.allocation.T
    for row, unit in zip(table, vehicle.units, strict=True):
        if not isinstance(unit, Thruster):
            row[layout.POSITION : layout.POSITION + 3] = unit.position
            row[layout.AXIS : layout.AXIS + 3] = unit.direction
        for column, value in unit.geometry(vehicle.density, vehicle.gravity).items():
            row[column] = value
    return table


def discretise(vehicle: VehicleModel, duration: float) -> FloatArray:
    """Return exact discretisations (n_u, DISCRETE_COLUMNS) of all actuators for one duration in s."""
    table = np.zeros((len(vehicle.units), layout.DISCRETE_COLUMNS))
    table[:, layout.HALF_STEP] = duration
    done: dict[Lag, tuple[FloatArray, FloatArray]] = {}  # a group of thrusters shares its lag
    for row, unit in zip(table, vehicle.units, strict=True):
        order = unit.lag.order
        if order == 0:
            row[layout.DISCRETE_C] = 1.0  # a rate-limited actuator's state is its output
            continue
        if unit.lag not in done:
            done[unit.lag] = unit.lag.discretise(duration)
        A, B = done[unit.lag]
        square = np.zeros((3, 3))
        square[:order, :order] = A
        row[:9] = square.ravel()
        row[layout.DISCRETE_B : layout.DISCRETE_B + order] = B
        row[layout.DISCRETE_C : layout.DISCRETE_C + order] = unit.lag.C
    return table
