"""A vehicle that is told physical quantities, newtons and radians, in the place of commands in [-1, 1].

What comes over a wire is a number in N. To turn it into a command of the sheet's curve and that back into newtons
would change its last bits; a curve that multiplies by a power of two changes none.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.curves import Curve
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]


class PhysicalCommands:
    """From physical quantities to what the vehicle `model` takes.

    Attributes:
        model: the vehicle, with the same motion for the same physical quantity, to the last bit.
        limits: (n_u, 2) least and most of each: N of a thruster, rad, m or m3 of others.
        neutral: (n_u,) what a command of 0 stands for.

    """

    def __init__(self, vehicle: VehicleModel) -> None:
        self._curves = [unit.curve for unit in vehicle.units]
        units, limits = [], []
        for unit in vehicle.units:
            low, high = _reach(unit.curve)
            factor = 2.0 ** math.ceil(math.log2(max(-low, high, 1e-300)))
            # A polynomial, for a linear curve would have its zero where the sheet's neutral value is.
            plain = Curve(
                "polynomial",
                (-factor, factor),
                coefficients=np.array([0.0, factor]),
                neutral=unit.curve.neutral,
            )
            units.append(replace(unit, curve=plain, resting=unit.rest))
            limits.append((low, high))
        self.model = replace(vehicle, units=tuple(units))
        self._factors = np.array([unit.curve.limits[1] for unit in units])
        self._rotors = np.zeros(len(units))
        for a, thruster in self.model.thrusters:
            self._rotors[a] = thruster.rotor_constant
        self._which = np.flatnonzero(self._rotors)
        self._values: FloatArray = np.array(limits)
        self.limits: FloatArray = self.quantities(self._values.T).T
        self.neutral: FloatArray = self.of_action(np.zeros(len(units)))

    def __call__(self, quantities: FloatArray) -> FloatArray:
        """Commands (n, n_u) of `model` for quantities (n, n_u), clipped to the sheet's limits."""
        values = quantities
        if self._which.size:
            values = quantities.copy()
            for a in self._which:
                values[:, a] = _speed(quantities[:, a], self._rotors[a])
        return np.asarray(np.clip(values, self._values[:, 0], self._values[:, 1]) / self._factors)

    def of_action(self, action: FloatArray) -> FloatArray:
        """Quantities (n_u,) of an action (n_u,) in [-1, 1] of the sheet's vehicle."""
        values = [float(curve(a)) for curve, a in zip(self._curves, action, strict=True)]
        return np.asarray(self.quantities(np.array([values]))[0])

    def quantities(self, values: FloatArray) -> FloatArray:
        """Quantities (n, n_u) that are turned back into `values` (n, n_u), the curves' own units, without a loss.

        A rotor's thrust goes with the square of its speed, so that there are more numbers of newtons than speeds; in
        extended precision both ways are rounded once, and the way back finds the speed to the last bit.
        """
        out = np.array(values, dtype=np.float64)
        for a in self._which:
            speed = out[:, a].astype(np.longdouble)
            out[:, a] = np.longdouble(self._rotors[a]) * speed * np.abs(speed)
        return out


def _speed(force: FloatArray, constant: float) -> FloatArray:
    """rad/s (n,) of a rotor whose thrust `constant` n|n| is `force` (n,) in N."""
    exact = np.sqrt(np.abs(force).astype(np.longdouble) / np.longdouble(constant))
    return np.asarray(np.copysign(exact.astype(np.float64), force), dtype=np.float64)


def _reach(curve: Curve) -> tuple[float, float]:
    """The least and the most that a curve gives."""
    if curve.kind == "linear":
        return min(curve.limits), max(curve.limits)
    values = curve.table if curve.kind == "table" else curve(np.linspace(-1.0, 1.0, 4001))
    low, high = float(np.min(values)), float(np.max(values))
    margin = 1e-6 * (high - low)  # a polynomial's top may lie between two samples
    return low - margin, high + margin
