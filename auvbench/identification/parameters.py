"""Define the numbers of a sheet that a log can determine, with their priors, and make vehicles with other values of these numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import ConfigError, closest
from auvbench.identification.inputs import has_voltage
from auvbench.vehicles.actuators import VOLTAGES, Actuator, Thruster
from auvbench.vehicles.curves import Lag
from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

FACTOR = math.log(2.0)
"""Prior standard deviation of the logarithm of most numbers: published sheets of one vehicle differ by a factor of two."""
PER_AXIS = ("added_mass", "linear_damping", "quadratic_damping")


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of a sheet with its prior.

    The fit varies x: the number is prior * exp(sd * x) if `log` is set, else prior + sd * x. The prior of x is the standard normal
    distribution.
    """

    name: str
    unit: str
    prior: float
    """Value in the sheet."""
    sd: float
    """Prior standard deviation of the number, or of its logarithm if `log` is set."""
    log: bool = True
    low: float = -math.inf
    high: float = math.inf
    axis: str = ""
    """Degree of freedom whose motion determines the number; '' if several degrees of freedom do."""

    def value(self, x: float) -> float:
        """Return the number for a normalised value."""
        value = self.prior * math.exp(self.sd * x) if self.log else self.prior + self.sd * x
        return min(max(value, self.low), self.high)

    def normalised(self, value: float) -> float:
        """Return the normalised value of a number."""
        return math.log(value / self.prior) / self.sd if self.log else (value - self.prior) / self.sd

    def range(self, reach: float = 4.0) -> tuple[float, float]:
        """Return the bounds of the normalised value in a fit."""
        low, high = -reach, reach
        if not self.log:
            low = max(low, (self.low - self.prior) / self.sd)
            high = min(high, (self.high - self.prior) / self.sd)
        return low, high


def known(vehicle: VehicleModel) -> dict[str, Parameter]:
    """Return all parameters of a vehicle by name.

    A number that the fit scales (`log`) is left out if its value in the sheet is not positive.
    """
    found = [
        # A weighing scale gives the mass to a few percent.
        Parameter("mass", "kg", vehicle.mass, 0.05),
        *(
            Parameter(f"inertia.{axis}", "kg m2", float(vehicle.inertia[k, k]), FACTOR, axis=axis)
            for k, axis in enumerate(AXES[3:])
        ),
    ]
    for k, axis in enumerate(AXES):
        linear, angular = ("kg", "N s/m", "N s2/m2"), ("kg m2", "N m s", "N m s2")
        values = (vehicle.M_A[k, k], vehicle.linear_damping[k], vehicle.quadratic_damping[k])
        for name, unit, value in zip(PER_AXIS, linear if k < 3 else angular, values, strict=True):
            found.append(Parameter(f"{name}.{axis}", unit, float(value), FACTOR, axis=axis))
    net = vehicle.buoyancy - vehicle.weight
    found.append(Parameter("net_buoyancy", "N", net, 0.02 * vehicle.weight, log=False, axis="heave"))
    found.append(
        Parameter("center_of_buoyancy.z", "m", float(vehicle.center_of_buoyancy[2]), 0.03, log=False)
    )
    thrusters = [unit for _, unit in vehicle.thrusters]
    if thrusters:
        found.append(Parameter("thrust", "1", 1.0, 0.3))
        found += [Parameter(f"gain.{unit.name}", "1", 1.0, 0.3) for unit in thrusters]
        lags = {unit.lag for unit in thrusters}
        lag = next(iter(lags)).A[0, 0] if len(lags) == 1 and thrusters[0].lag.order == 1 else 0.0
        # Bench data give 0.0125 s, sheets 0 to 0.2 s.
        found.append(Parameter("lag", "s", -1.0 / lag if lag else 0.05, 1.0, low=1e-3, high=1.0))
        found.append(Parameter("delay", "s", 0.0, 0.05, log=False, low=0.0, high=0.5))
    if has_voltage(vehicle):
        volts = next(unit.curve.voltage for unit in thrusters if unit.curve.voltage > 0.0)
        found.append(Parameter("voltage", "V", volts, 2.0, log=False, low=VOLTAGES[0], high=VOLTAGES[1]))
    return {parameter.name: parameter for parameter in found if parameter.prior > 0.0 or not parameter.log}


def choose(vehicle: VehicleModel, names: Sequence[str], measured_voltage: bool) -> tuple[Parameter, ...]:
    """Return the parameters with the given names; the name of a group, such as added_mass, selects all axes of the group.

    Args:
        vehicle: vehicle whose sheet gives the priors.
        names: names or groups; empty: the names of `usual`.
        measured_voltage: whether the logs have the supply voltage, which is then not a parameter.

    Raises:
        ConfigError: a name is unknown or has the value 0 in the sheet, or `names` contains voltage although the logs have the voltage.
    """
    present = known(vehicle)
    groups = {name.partition(".")[0] for name in present}
    chosen: dict[str, Parameter] = {}
    for name in names or usual(vehicle):
        members = [key for key in present if name in (key, key.partition(".")[0])]
        if not members and names:
            raise _unknown(vehicle, name, sorted({*present, *groups}))
        chosen |= {key: present[key] for key in members}
    if measured_voltage and "voltage" in chosen:
        raise ConfigError("parameters=voltage: the logs have the voltage; leave it out")
    return tuple(chosen.values())


def usual(vehicle: VehicleModel) -> list[str]:
    """Return the names that are fitted by default.

    Mass and inertia are left out, because a log determines only their sums with added mass. Thrust is left out, because a log
    determines the scale of the thrust only by comparison with known forces (net buoyancy, weight).
    """
    return [
        *PER_AXIS,
        "net_buoyancy",
        "center_of_buoyancy.z",
        *(["lag", "delay"] if vehicle.thrusters else []),
    ]


def _unknown(vehicle: VehicleModel, name: str, valid: Sequence[str]) -> ConfigError:
    group = name.partition(".")[0]
    if group in PER_AXIS or group == "inertia":
        axis = name.partition(".")[2]
        if not axis or axis in AXES:
            return ConfigError(
                f"parameters={name}: is 0 in the sheet of {vehicle.name}, and the fit can only scale it; write a positive"
                " value into the sheet first"
            )
    return ConfigError(f"parameters={name}: not a number that logs determine; {closest(name, valid)}")


def values_of(parameters: Sequence[Parameter], x: FloatArray) -> dict[str, float]:
    """Return the parameters' numbers by name, from their normalised values (n_p,)."""
    return {parameter.name: parameter.value(float(at)) for parameter, at in zip(parameters, x, strict=True)}


def with_values(vehicle: VehicleModel, values: dict[str, float]) -> VehicleModel:
    """Return the vehicle with the numbers in `values`, named as in `known`; thrust, gain, delay and voltage are ignored."""
    mass = values.get("mass", vehicle.mass)
    weight = vehicle.weight * mass / vehicle.mass
    net = values.get("net_buoyancy", vehicle.buoyancy - vehicle.weight)
    inertia, M_A = vehicle.inertia, vehicle.M_A
    linear, quadratic = vehicle.linear_damping.copy(), vehicle.quadratic_damping.copy()
    scale_3, scale_6 = np.ones(3), np.ones(6)
    for k, axis in enumerate(AXES):
        if (value := values.get(f"added_mass.{axis}")) is not None:
            scale_6[k] = math.sqrt(value / M_A[k, k])
        if k >= 3 and (value := values.get(f"inertia.{axis}")) is not None:
            scale_3[k - 3] = math.sqrt(value / inertia[k - 3, k - 3])
        linear[k] = values.get(f"linear_damping.{axis}", linear[k])
        quadratic[k] = values.get(f"quadratic_damping.{axis}", quadratic[k])
    center = vehicle.center_of_buoyancy.copy()
    center[2] = values.get("center_of_buoyancy.z", center[2])
    return replace(
        vehicle,
        mass=mass,
        weight=weight,
        buoyancy=max(weight + net, 0.0),
        center_of_buoyancy=center,
        # A row and its column are scaled by the same factor, so that a full matrix stays positive definite.
        inertia=inertia * np.outer(scale_3, scale_3),
        M_A=M_A * np.outer(scale_6, scale_6),
        linear_damping=linear,
        quadratic_damping=quadratic,
        units=tuple(_unit(unit, values) for unit in vehicle.units),
    )


def _unit(unit: Actuator, values: dict[str, float]) -> Actuator:
    """Return a thruster with the lag in `values`; any other actuator unchanged."""
    if "lag" not in values or not isinstance(unit, Thruster):
        return unit
    return replace(unit, lag=Lag.first_order(values["lag"]))


def gains(vehicle: VehicleModel, values: dict[str, float]) -> FloatArray:
    """Return the factors (n_u,) on the actuators' forces, from thrust and gains in `values` (names as in `known`)."""
    return np.array(
        [values.get("thrust", 1.0) * values.get(f"gain.{unit.name}", 1.0) for unit in vehicle.units]
    )
