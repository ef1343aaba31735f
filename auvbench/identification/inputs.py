"""Convert a log's inputs to the quantities that the actuators' curves give, such as thrust, before the actuators' dynamics."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import closest
from auvbench.identification.log import KINDS, Log, LogError
from auvbench.vehicles.actuators import VOLTAGES, Thruster
from auvbench.vehicles.curves import t200_at
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

NEUTRAL, SPAN = 1500.0, 400.0
"""Pulse width at command 0, and increase of the pulse width from command 0 to command 1, us."""
_NUMBERED = re.compile(r"(?:pwm|motor|servo|thruster|c|m|t)?_?(\d+)", re.IGNORECASE)


def columns(log: Log, vehicle: VehicleModel) -> list[int]:
    """Return, for each actuator of a vehicle, the index of the log's column that is its input.

    Columns are matched by the autopilot's motors if the log has `motors`, else by name or by number.

    Raises:
        LogError: an actuator has no column, or a column has no actuator.
    """
    names = vehicle.actuators
    if log.motors is not None:
        order = log.motors(vehicle).order
        outputs = [f"C{motor + 1}" for motor in range(len(order))]
        if missing := [name for name in outputs if name not in log.actuators]:
            raise LogError(
                f"{log.name}: has no output {missing[0]}; {vehicle.name} has {len(names)} thrusters, as motors C1 to {outputs[-1]}"
            )
        return [log.actuators.index(outputs[order.index(a)]) for a in range(len(names))]
    by_name = {name.casefold(): index for index, name in enumerate(names)}
    place: dict[int, int] = {}
    for column, given in enumerate(log.actuators):
        index, match = by_name.get(given.casefold()), _NUMBERED.fullmatch(given)
        if index is None and match:
            index = int(match[1]) - 1
        if match and index is not None and index >= len(names) and np.ptp(log.inputs[:, column]) == 0.0:
            continue  # A constant output without a thruster is allowed, such as an autopilot's output for lights.
        if index is None or not 0 <= index < len(names):
            raise LogError(
                f"{log.name}: {vehicle.name} has no actuator {given!r}; {closest(given, names)}, or numbers from 1 to"
                f" {len(names)}"
            )
        place[index] = column
    missing = [name for index, name in enumerate(names) if index not in place]
    if missing:
        raise LogError(
            f"{log.name}: has no input for {missing[0]} of {vehicle.name}; record {KINDS[log.kind]} of all"
            f" {len(names)} actuators"
        )
    return [place[index] for index in range(len(names))]


def quantities(log: Log, vehicle: VehicleModel, voltage: float | None = None) -> FloatArray:
    """Return the quantities (T, n_u) of the actuators in the units of their curves: N, rad/s, rad, m or m3.

    A T200's thrust is computed for the supply voltage in the log; if the log has no voltage, for `voltage`.

    Raises:
        LogError: the inputs do not fit the vehicle.
    """
    inputs = log.inputs[:, columns(log, vehicle)]
    if log.kind == "pwm":
        inputs = np.clip((inputs - NEUTRAL) / SPAN, -1.0, 1.0)
    values = np.empty_like(inputs)
    supply = log.voltage if log.voltage is not None else voltage
    for index, unit in enumerate(vehicle.units):
        if log.kind == "force":
            if not isinstance(unit, Thruster):
                raise LogError(
                    f"{log.name}: {unit.name} of {vehicle.name} is not a thruster and has no force; record commands"
                )
            force = inputs[:, index]
            rotor = unit.rotor_constant
            values[:, index] = np.sign(force) * np.sqrt(np.abs(force) / rotor) if rotor else force
        elif supply is not None and unit.curve.voltage > 0.0:
            factor = unit.curve.limits[1] / t200_at(unit.curve.voltage).limits[1]
            values[:, index] = factor * at_voltage(inputs[:, index], supply)
        else:
            values[:, index] = unit.curve(inputs[:, index])
    if log.motors is not None:
        motors = log.motors(vehicle)
        values[:, motors.order] *= np.array(motors.signs)
    return values


def at_voltage(command: FloatArray, voltage: FloatArray | float) -> FloatArray:
    """Return the thrust (T,) in N of a T200 at commands (T,) in [-1, 1]; the supply voltage (T,) in V is clipped to the table."""
    supply = np.clip(np.broadcast_to(voltage, command.shape), *VOLTAGES)
    grid = np.arange(VOLTAGES[0], VOLTAGES[1] + 0.1, 2.0)
    table = np.stack([t200_at(float(at))(command) for at in grid])
    position = np.clip((supply - grid[0]) / 2.0, 0.0, grid.size - 1.0)
    below = np.minimum(position.astype(int), grid.size - 2)
    rows = np.arange(command.size)
    share = position - below
    return np.asarray((1.0 - share) * table[below, rows] + share * table[below + 1, rows])


def has_voltage(vehicle: VehicleModel) -> bool:
    """Return whether the thrust of a vehicle depends on the supply voltage."""
    return any(unit.curve.voltage > 0.0 for unit in vehicle.units)


def wrench(log: Log, vehicle: VehicleModel) -> FloatArray:
    """Return the commanded wrench (T, 6) in N and N m, without the actuators' dynamics.

    Raises:
        LogError: the inputs do not fit the vehicle.
    """
    if log.kind == "wrench":
        return log.inputs
    values = quantities(log, vehicle)
    for index, unit in vehicle.thrusters:
        if unit.rotor_constant:
            values[:, index] = unit.rotor_constant * values[:, index] * np.abs(values[:, index])
    return values @ vehicle.allocation.T


def check(logs: Sequence[Log], vehicle: VehicleModel) -> None:
    """Raise LogError if the inputs of a log do not fit a vehicle."""
    for log in logs:
        wrench(log, vehicle)
