"""Draw vehicles from the joint covariance of an identified sheet: which numbers are drawn, and how a vehicle differs from its sheet.

A draw is a difference from the estimates, which are the sheet's numbers. A difference of 0 leaves the vehicle unchanged to
the last bit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import layout
from auvbench.errors import ConfigError, closest
from auvbench.vehicles.actuators import VOLTAGES, Thruster
from auvbench.vehicles.curves import t200_at
from auvbench.vehicles.identified import Identified
from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

REACH = 3.0
"""Largest distance of a drawn number from its estimate, in standard deviations; draws farther away are clipped"""
PLACES: dict[str, int] = {
    name: place
    for place, name in enumerate(
        (
            "mass",
            *(f"inertia.{axis}" for axis in AXES[3:]),
            *(
                f"{group}.{axis}"
                for group in ("added_mass", "linear_damping", "quadratic_damping")
                for axis in AXES
            ),
            "lag",
            "net_buoyancy",
            "center_of_buoyancy.z",
        )
    )
}
"""Position of a parameter's value in a record of `layout.CHANGE`; other parameters of an identification have no such value."""
HELD = ("delay",)
"""Parameters of an identification that vehicle models do not have."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnVehicles:
    """Distribution of the vehicles that are drawn from an identification; `of` creates it."""

    vehicle: VehicleModel
    identified: Identified
    root: FloatArray
    """`Identified.root` (n_p, n_p), multiplied by the spread"""
    reach: FloatArray
    """Largest difference (n_p,) of a normalised value from its estimate"""

    @classmethod
    def of(cls, vehicle: VehicleModel, identified: Identified, spread: float) -> DrawnVehicles:
        """Return the distribution for a vehicle.

        Args:
            vehicle: vehicle of the sheet.
            identified: identification of the vehicle.
            spread: factor on the standard deviations.

        Raises:
            ConfigError: the identification names a parameter that vehicles do not have.
        """
        thrusters = [f"gain.{unit.name}" for _, unit in vehicle.thrusters]
        known = [*PLACES, *HELD, "thrust", "voltage", *thrusters]
        for name in identified.parameters:
            if name not in known:
                raise ConfigError(
                    f"disturbance.identified: vehicle={vehicle.name} has no number {name!r}, which its identification names;"
                    f" {closest(name, known)}"
                )
        root = spread * identified.root(held(vehicle))
        return cls(vehicle, identified, root, REACH * np.sqrt(np.sum(root**2, axis=1)))

    def changes(self, x: FloatArray) -> tuple[NDArray[Any], FloatArray]:
        """Return how k drawn vehicles differ from the sheet: records (k,) of `layout.CHANGE`, and factors (k, n_u) on the forces.

        Args:
            x: (k, n_p) differences of the normalised values from the estimates.
        """
        own = self.identified
        moved = own.sd * x
        numbers = np.where(own.logarithmic, np.exp(moved), moved)
        changes = layout.unchanged(len(x))
        table = changes.view(np.float64).reshape(len(x), -1)
        gains = np.ones((len(x), len(self.vehicle.units)))
        names = [unit.name for unit in self.vehicle.units]
        for name, column in zip(own.parameters, numbers.T, strict=True):
            if name in PLACES:
                table[:, PLACES[name]] = column
            elif name == "thrust":
                gains *= column[:, None]
            elif name.startswith("gain."):
                gains[:, names.index(name.partition(".")[2])] *= column
            elif name == "voltage":
                gains *= self._supplied(column)
        return changes, gains

    def _supplied(self, volts: FloatArray) -> FloatArray:
        """Return factors (k, n_u) on the forces if the supply voltage differs from the sheet's by `volts` (k,)."""
        supplies = np.array([unit.curve.voltage for unit in self.vehicle.units])
        gains = np.ones((len(volts), supplies.size))
        for supply in {float(supply) for supply in supplies if supply > 0.0}:
            other = np.clip(supply + volts, *VOLTAGES)
            gains[:, supplies == supply] = (strength(other, supply) / strength(np.array(supply), supply))[
                :, None
            ]
        return gains

    def extreme(self, damping: float) -> VehicleModel:
        """Return a vehicle at the limits of all draws, with the strongest thrusters and the net buoyancy farthest from 0.

        Args:
            damping: 1 gives the smallest mass and the most damping, for the shortest time constant. -1 gives the sheet's mass
                and the least damping, for the highest speed.
        """
        names = self.identified.parameters
        net = 1.0 if self.vehicle.buoyancy >= self.vehicle.weight else -1.0
        signs = {"linear_damping": damping, "quadratic_damping": damping, "net_buoyancy": net}
        signs |= dict.fromkeys(("mass", "inertia", "added_mass"), -max(damping, 0.0))
        signs |= dict.fromkeys(("thrust", "gain", "voltage"), 1.0)
        # Moving the centre of buoyancy away from the origin gives the largest righting moment.
        signs["center_of_buoyancy"] = 1.0 if self.vehicle.center_of_buoyancy[2] >= 0.0 else -1.0
        x = np.array([signs.get(name.partition(".")[0], 0.0) for name in names]) * self.reach
        changes, gains = self.changes(x[None])
        return changed(self.vehicle, changes[0], gains[0])


def held(vehicle: VehicleModel) -> tuple[str, ...]:
    """Return the names of the parameters that stay at their estimates.

    The delay always stays at its estimate. The lag stays unless all thrusters have a first-order lag. The voltage stays unless
    the curve of at least one thruster depends on the voltage.
    """
    thrusters = [unit for _, unit in vehicle.thrusters]
    lagged = all(unit.lag.order == 1 and unit.rate == 0.0 for unit in thrusters)
    supplied = any(unit.curve.voltage > 0.0 for unit in thrusters)
    return (*HELD, *(() if lagged else ("lag",)), *(() if supplied else ("voltage",)))


def strength(volts: FloatArray, supply: float) -> FloatArray:
    """Return the ratios of a T200's thrust at the voltages `volts` to its thrust at `supply` V, by least squares over commands.

    Like the thrust tables, the ratios are interpolated linearly between the measured voltages.
    """
    return np.interp(volts, *_strengths(supply))


@cache
def _strengths(supply: float) -> tuple[FloatArray, FloatArray]:
    """Return the measured voltages, and the values of `strength` at these voltages."""
    grid = np.arange(VOLTAGES[0], VOLTAGES[1] + 0.1, 2.0)
    own = t200_at(supply).table
    return grid, np.array([t200_at(at).table @ own / (own @ own) for at in grid.tolist()])


def changed(vehicle: VehicleModel, change: Any, gains: FloatArray) -> VehicleModel:
    """Return a copy of a vehicle, changed by a record of `layout.CHANGE` and by factors (n_u,) on the thrusters' forces.

    The record's factor on the lags is ignored.
    """
    inertia, added = np.sqrt(change["inertia"]), np.sqrt(change["added_mass"])
    mass = float(change["mass"])
    lift = vehicle.buoyancy + (mass - 1.0) * vehicle.weight + float(change["net_buoyancy"])
    center = vehicle.center_of_buoyancy.copy()
    center[2] += change["center_of_buoyancy_z"]
    return replace(
        vehicle,
        mass=mass * vehicle.mass,
        weight=mass * vehicle.weight,
        buoyancy=max(lift, 0.0),
        center_of_buoyancy=center,
        inertia=vehicle.inertia * np.outer(inertia, inertia),
        M_A=vehicle.M_A * np.outer(added, added),
        linear_damping=vehicle.linear_damping * change["linear_damping"],
        quadratic_damping=vehicle.quadratic_damping * change["quadratic_damping"],
        units=tuple(
            _stronger(unit, gain) if isinstance(unit, Thruster) else unit
            for unit, gain in zip(vehicle.units, gains.tolist(), strict=True)
        ),
    )


def _stronger(unit: Thruster, gain: float) -> Thruster:
    if unit.rotor_constant:
        return replace(unit, rotor_constant=gain * unit.rotor_constant)
    return replace(unit, curve=unit.curve.times(gain))
