"""Define the parts of an actuator: the static curve, the linear lag, and the electrical power of a thruster."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.dynamics.layout import LINEAR_CURVE, POLYNOMIAL_CURVE, POWER_POINTS, TABLE_CURVE

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """The static map from a command in [-1, 1] to a physical quantity (N, rad/s, rad, m or m3)."""

    kind: str  # linear | table | polynomial
    limits: tuple[float, float]  # value at -1 and at +1
    table: FloatArray = field(default_factory=lambda: np.zeros(0))  # values at equally spaced commands
    coefficients: FloatArray = field(default_factory=lambda: np.zeros(0))  # coefficients of a^0, a^1, ...
    neutral: float = 0.0  # value at command 0 of a linear curve
    voltage: float = 0.0  # supply voltage of a T200's table, V; 0: the curve does not depend on a voltage

    @property
    def code(self) -> int:
        """Return the number of the kind in the compiled functions."""
        return {"linear": LINEAR_CURVE, "table": TABLE_CURVE, "polynomial": POLYNOMIAL_CURVE}[self.kind]

    @property
    def entries(self) -> FloatArray:
        """Return the numbers that a compiled function needs in addition to the limits."""
        return self.coefficients if self.kind == "polynomial" else self.table

    def __call__(self, command: ArrayLike) -> FloatArray:
        """Clip `command` (...) to [-1, 1] and return the curve's value there."""
        a = np.clip(np.asarray(command, dtype=np.float64), -1.0, 1.0)
        if self.kind == "linear":
            low, high = self.limits
            span = np.where(a < 0.0, self.neutral - low, high - self.neutral)
            return np.asarray(self.neutral + a * span)
        if self.kind == "table":
            return np.interp(a, np.linspace(-1.0, 1.0, self.table.size), self.table)
        return np.asarray(np.polynomial.polynomial.polyval(a, self.coefficients))

    def times(self, factor: float) -> Curve:
        """Return the curve with all values multiplied by a factor."""
        if factor == 1.0:
            return self
        low, high = self.limits
        return replace(
            self,
            limits=(factor * low, factor * high),
            table=factor * self.table,
            coefficients=factor * self.coefficients,
            neutral=factor * self.neutral,
        )

    def inverse(self, value: ArrayLike) -> FloatArray:
        """Return the command at which the curve has `value` (...).

        Values beyond the curve's monotone part around command 0 are clipped to the range of that part. If the curve has a
        dead band, the command for value 0 is 0, the middle of the band.
        """
        value = np.asarray(value, dtype=np.float64)
        if self.kind == "linear":
            low, high = self.limits
            span = np.where(value < self.neutral, self.neutral - low, high - self.neutral)
            return np.asarray(
                np.clip((value - self.neutral) / np.where(span == 0.0, np.inf, span), -1.0, 1.0)
            )
        values, commands = _monotone(self)
        return np.asarray(np.where(value == 0.0, 0.0, np.interp(value, values, commands)))


@lru_cache(maxsize=256)
def _monotone(curve: Curve) -> tuple[FloatArray, FloatArray]:
    """Return values and commands of the increasing part of a curve around command 0."""
    commands = np.linspace(-1.0, 1.0, curve.table.size if curve.kind == "table" else 4001)
    values = curve(commands)
    middle = commands.size // 2
    rising = np.diff(values) >= 0.0
    above = np.flatnonzero(~rising[middle:])
    below = np.flatnonzero(~rising[:middle])
    last = middle + int(above[0]) if above.size else commands.size - 1
    first = int(below[-1]) + 1 if below.size else 0
    return values[first : last + 1], commands[first : last + 1]


@dataclass(frozen=True, slots=True, eq=False)
class Lag:
    """Linear dynamics y = G(s) u with static gain 1, as x' = A x + B u, y = C x (controllable form)."""

    A: FloatArray  # (order, order), 1/s
    B: FloatArray  # (order,)
    C: FloatArray  # (order,)

    @property
    def order(self) -> int:
        return int(self.B.size)

    @property
    def delay(self) -> float:
        """Return the mean delay in s: -G'(0) for G(s) = C (s - A)^-1 B."""
        if self.order == 0:
            return 0.0
        return float(self.C @ np.linalg.solve(self.A, np.linalg.solve(self.A, self.B)))

    @classmethod
    def first_order(cls, time_constant: float) -> Lag:
        return cls(np.array([[-1.0 / time_constant]]), np.array([1.0 / time_constant]), np.ones(1))

    @classmethod
    def none(cls) -> Lag:
        return cls(np.zeros((0, 0)), np.zeros(0), np.zeros(0))

    @classmethod
    def transfer_function(cls, numerator: ArrayLike, denominator: ArrayLike) -> Lag:
        """Return the lag whose transfer function is a ratio of polynomials in s, highest power first.

        The states are scaled by powers of the natural frequency, so that each state has the magnitude of the input.
        """
        den = np.asarray(denominator, dtype=np.float64)
        order = den.size - 1
        num = np.zeros(order)
        coefficients = np.asarray(numerator, dtype=np.float64)
        num[order - coefficients.size :] = coefficients
        num, den = num / den[0], den / den[0]
        scale = abs(float(den[-1])) ** (1.0 / order)
        A = np.diag(np.full(order - 1, scale), 1)
        A[-1] = [-den[order - j] / scale ** (order - 1 - j) for j in range(order)]
        B = np.zeros(order)
        B[-1] = scale
        C = np.array([num[order - 1 - j] * scale**j for j in range(order)]) / scale**order
        return cls(A, B, C)

    def discretise(self, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return (Ad, Bd) of the exact update x(t + duration) = Ad x(t) + Bd u for constant u."""
        from scipy.linalg import expm

        n = self.order
        block = np.zeros((n + 1, n + 1))
        block[:n, :n] = self.A
        block[:n, n] = self.B
        E = expm(block * duration)
        return E[:n, :n], E[:n, n]

    def steady(self, value: float) -> FloatArray:
        """Return the state (order,) in which the output stays at `value`."""
        if self.order == 0:
            return np.zeros(0)
        return np.asarray(-np.linalg.solve(self.A, self.B) * value)


@cache
def t200_table() -> dict[str, FloatArray]:
    """Return Blue Robotics' public T200 measurements at 16 V (September 2019): one row per pulse width, 1100 to 1900 us."""
    path = resources.files("auvbench.vehicles") / "data" / "t200_16v.csv"
    with path.open(encoding="utf-8") as lines:
        rows = np.loadtxt((line for line in lines if not line.startswith("#")), delimiter=",", skiprows=1)
    return {"pwm_us": rows[:, 0], "force_N": rows[:, 1], "power_W": rows[:, 2]}


@cache
def t200_curve() -> Curve:
    """Return the curve of a T200 at 16 V: thrust in N; the command is the normalised pulse width."""
    force = t200_table()["force_N"]
    return Curve("table", (float(force[0]), float(force[-1])), table=force, voltage=16.0)


@cache
def t200_forces() -> tuple[FloatArray, FloatArray]:
    """Return Blue Robotics' public T200 measurements: voltages (6,), and forces in N by voltage and pulse width (6, 201)."""
    path = resources.files("auvbench.vehicles") / "data" / "t200_force.csv"
    with path.open(encoding="utf-8") as lines:
        _, heading, *rows = lines
    voltages = [float(name.removesuffix("_V")) for name in heading.strip().split(",")[1:]]
    return np.array(voltages), np.loadtxt(rows, delimiter=",").T[1:]


def t200_at(voltage: float) -> Curve:
    """Return the curve of a T200 at a supply voltage from 10 to 20 V, interpolated between the measured voltages."""
    voltages, forces = t200_forces()
    upper = int(np.clip(np.searchsorted(voltages, voltage), 1, voltages.size - 1))
    share = (voltage - voltages[upper - 1]) / (voltages[upper] - voltages[upper - 1])
    force = (1.0 - share) * forces[upper - 1] + share * forces[upper]
    return Curve("table", (float(force[0]), float(force[-1])), table=force, voltage=voltage)


@cache
def t200_power() -> tuple[float, FloatArray]:
    """Return the electrical power of a T200 at 16 V by force.

    Force is monotone in pulse width outside the dead band, so power is a function of force. The result has
    the largest force F in N and the power (POWER_POINTS,) in W at equally spaced forces from -F to F; power
    is constant beyond the strongest reverse thrust.
    """
    data = t200_table()
    force, first = np.unique(data["force_N"], return_index=True)
    power = data["power_W"][first].copy()
    power[force == 0.0] = 0.0
    largest = float(force[-1])
    return largest, np.interp(np.linspace(-largest, largest, POWER_POINTS), force, power)


@dataclass(frozen=True, slots=True, eq=False)
class Power:
    """Electrical power of a thruster in W: power_scale * P_T200(force / force_scale).

    P_T200 is the measured power of the T200 at 16 V by force (`docs/physics.md`).
    """

    force_scale: float = 1.0
    power_scale: float = 1.0

    def __call__(self, force: ArrayLike) -> FloatArray:
        """Return the power (...) in W of a thruster at `force` (...) in N."""
        largest, power = t200_power()
        scaled = np.asarray(force, dtype=np.float64) / self.force_scale
        return np.asarray(
            np.interp(scaled, np.linspace(-largest, largest, POWER_POINTS), power) * self.power_scale
        )
