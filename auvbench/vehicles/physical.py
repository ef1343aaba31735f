"""Command a vehicle with physical quantities (newtons, radians) instead of commands in [-1, 1].

A command that arrives over a network is in N. Converting it to a normalised command with the sheet's curve, and back to
newtons, would change its last bits. Here a command is scaled only by a power of two, which changes no bits.
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
    """Converter from physical quantities to the commands of the vehicle `model`.

    Attributes:
        model: vehicle that moves as the sheet's vehicle does under the same physical quantities, to the last bit.
        limits: (n_u, 2) smallest and largest quantity: N for thrusters, rad, m or m3 for other actuators.
        neutral: (n_u,) quantity at command 0.

    """

    def __init__(self, vehicle: VehicleModel) -> None:
        self._curves = [unit.curve for unit in vehicle.units]
        units, limits = [], []
        for unit in vehicle.units:
            low, high = _reach(unit.curve)
            factor = 2.0 ** math.ceil(math.log2(max(-low, high, 1e-300)))
            # The curve is a polynomial: a linear curve would give the sheet's neutral value, not 0, at command 0.
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
        self._rotating = np.flatnonzero(self._rotors)
        self._values: FloatArray = np.array(limits)
        self.limits: FloatArray = self.quantities(self._values.T).T
        self.neutral: FloatArray = self.of_action(np.zeros(len(units)))

    def __call__(self, quantities: FloatArray) -> FloatArray:
        """Return commands (n, n_u) of `model` for quantities (n, n_u), clipped to the sheet's limits."""
        values = quantities
        if self._rotating.size:
            values = quantities.copy()
            for a in self._rotating:
                values[:, a] = _speed(quantities[:, a], self._rotors[a])
        return np.asarray(np.clip(values, self._values[:, 0], self._values[:, 1]) / self._factors)

    def of_action(self, action: FloatArray) -> FloatArray:
        """Return the quantities (n_u,) of an action (n_u,) in [-1, 1] of the sheet's vehicle."""
        values = [float(curve(a)) for curve, a in zip(self._curves, action, strict=True)]
        return np.asarray(self.quantities(np.array([values]))[0])

    def quantities(self, values: FloatArray) -> FloatArray:
        """Return the quantities for `values` of the curves, (n, n_u), such that the conversion back to `values` is exact to the last bit.

        A rotor's thrust is quadratic in its speed, so two different speeds in float64 have different thrusts in float64.
        Each conversion uses extended precision and is rounded once, so the conversion back gives the speed to the last bit.
        """
        out = np.array(values, dtype=np.float64)
        for a in self._rotating:
            speed = out[:, a].astype(np.longdouble)
            out[:, a] = np.longdouble(self._rotors[a]) * speed * np.abs(speed)
        return out


def _speed(force: FloatArray, constant: float) -> FloatArray:
    """Return the speed in rad/s (n,) of a rotor whose thrust `constant` n|n| is `force` (n,) in N."""
    exact = np.sqrt(np.abs(force).astype(np.longdouble) / np.longdouble(constant))
    return np.asarray(np.copysign(exact.astype(np.float64), force), dtype=np.float64)


def _reach(curve: Curve) -> tuple[float, float]:
    """Return the smallest and the largest value of a curve."""
    if curve.kind == "linear":
        return min(curve.limits), max(curve.limits)
    values = curve.table if curve.kind == "table" else curve(np.linspace(-1.0, 1.0, 4001))
    low, high = float(np.min(values)), float(np.max(values))
    margin = 1e-6 * (high - low)  # the top of a polynomial may be between two samples
    return low - margin, high + margin
