"""Define the kinds of actuators, one class per kind.

A class reads the kind's part of a sheet, and provides units, warnings and the coefficients for the compiled functions.

A new kind needs a class here, an entry in `KINDS`, and its force in `dynamics/appendages.py`
(docs/adding-an-actuator.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.dynamics import layout
from auvbench.errors import closest
from auvbench.vehicles.curves import Curve, Lag, Power, t200_at, t200_curve
from auvbench.vehicles.reader import Document, Keys

FloatArray = NDArray[np.float64]

CURVES = ("linear", "t200", "t200_16v", "polynomial", "rotor")
VOLTAGES = (10.0, 20.0)
"""Smallest and largest supply voltage of the T200's tables, V"""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Actuator:
    """One actuator of a vehicle, in body FLU."""

    kind: ClassVar[str]
    """Value of the key `type` in a sheet"""
    code: ClassVar[int]
    """Number of the kind in the compiled functions"""
    output: ClassVar[str]
    """Unit of the values that the static curve gives"""

    name: str
    curve: Curve
    lag: Lag = field(default_factory=Lag.none)
    position: FloatArray
    """Position (3,) from the body origin, m"""
    direction: FloatArray = field(default_factory=lambda: np.zeros(3))
    """Unit vector (3,): a thruster's direction of force for a positive command, a fin's hinge (positive angles by the
    right-hand rule), or a mass shifter's axis of motion
    """
    rate: float = 0.0
    """Largest change of the output per second, for a rate-limited actuator; 0: unlimited"""
    resting: FloatArray | None = None
    """State at rest, if it does not follow from the curve's value at command 0"""

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        """Return the actuators of one group of a sheet; the factors `turn` (3,) convert vectors to body FLU."""
        raise NotImplementedError

    @property
    def rest(self) -> FloatArray:
        """Return the steady state of the actuator's dynamics at command 0; empty for an actuator without dynamics."""
        if self.resting is not None:
            return self.resting
        neutral = float(self.curve(0.0))
        return np.array([neutral]) if self.rate > 0.0 else self.lag.steady(neutral)

    @property
    def unit(self) -> str:
        """Return the unit of the physical quantity that a command sets."""
        return self.output

    def force(self, command: ArrayLike) -> FloatArray:
        """Return the steady force in N at a command in [-1, 1], with the command's shape (...); zero unless this is a thruster."""
        return np.zeros_like(self.curve(command))

    def command(self, force: ArrayLike) -> FloatArray:
        """Return the command for a steady force in N, with the force's shape (...); zero unless this is a thruster."""
        return np.zeros_like(np.asarray(force, dtype=np.float64))

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        """Return the kind-specific fields of `dynamics.layout.ACTUATOR` by name; density in kg/m3, gravity in m/s2."""
        return {}

    def warnings(self) -> list[str]:
        """Return warnings about this actuator, without its name."""
        return []


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Thruster(Actuator):
    """A propeller; its curve gives newtons, or a speed in rad/s that `rotor_constant` converts to newtons."""

    kind = "thruster"
    code = layout.THRUSTER
    output = "N"

    rotor_constant: float = 0.0
    """Constant k rho D^4 of F = k rho D^4 n|n|, N s2; 0 if the curve gives newtons"""
    power: Power = field(default_factory=Power)

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        aim = ("directions", "angles")
        optional = ("lag", "transfer_function", "power", "gain", *aim)
        section = document.section(at, ("type", "curve", "positions"), optional)
        curve, rotor = _thrust_curve(document, (*at, "curve"))
        lag = _lag(document, at, section)
        power = Power()
        if "power" in section:
            document.section((*at, "power"), ("force_scale", "power_scale"))
            power = Power(
                document.number((*at, "power", "force_scale"), "1", above=0.0),
                document.number((*at, "power", "power_scale"), "1", low=0.0),
            )
        keys = [key for key in aim if key in section]
        if len(keys) != 1:
            document.fail(at, f"give exactly one of {', '.join(aim)}: the direction of each thruster's force")
        placed = _placed(document, at, keys[0], "thrusters")
        gains = _gains(document, at, [name for name, _, _ in placed]) if "gain" in section else {}
        return [
            cls(
                name=name,
                curve=curve if rotor else curve.times(gains.get(name, 1.0)),
                lag=lag,
                position=position * turn,
                direction=direction * turn,
                rotor_constant=rotor * gains.get(name, 1.0),
                power=power,
            )
            for name, position, direction in placed
        ]

    @property
    def unit(self) -> str:
        return "rad/s" if self.rotor_constant else self.output

    def force(self, command: ArrayLike) -> FloatArray:
        value = self.curve(command)
        return value if self.rotor_constant == 0.0 else self.rotor_constant * value * np.abs(value)

    def command(self, force: ArrayLike) -> FloatArray:
        force = np.asarray(force, dtype=np.float64)
        if self.rotor_constant != 0.0:
            force = np.sign(force) * np.sqrt(np.abs(force) / self.rotor_constant)
        return self.curve.inverse(force)

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        return {
            "rotor": self.rotor_constant,
            "force_scale": 1.0 / self.power.force_scale,
            "power_scale": self.power.power_scale,
        }

    def warnings(self) -> list[str]:
        commands = np.linspace(0.0, 1.0, 1001)
        force = self.force(commands)
        peak = int(np.argmax(np.abs(force)))
        if abs(force[peak]) <= abs(force[-1]) * (1 + 1e-9):
            return []
        return [
            f"the thrust curve peaks at command {commands[peak]:.3f} with {force[peak]:.2f} N and falls to "
            f"{force[-1]:.2f} N at 1"
        ]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fin(Actuator):
    """A fin or rudder with lift and drag."""

    kind = "fin"
    code = layout.FIN
    output = "rad"
    UNITS: ClassVar[dict[str, str]] = {
        "area": "m2",
        "lift_slope": "1/rad",
        "lift_slope_stall": "1/rad",
        "drag_slope": "1/rad",
        "drag_slope_stall": "1/rad",
        "stall_angle": "rad",
    }

    area: float
    lift_slope: float
    lift_slope_stall: float
    drag_slope: float
    drag_slope_stall: float
    stall_angle: float

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        section = document.section(at, ("type", "limits", "positions", "hinges", *cls.UNITS), ("lag",))
        parameters: dict[str, Any] = {
            name: document.number((*at, name), unit, low=0.0 if name in ("area", "stall_angle") else -np.inf)
            for name, unit in cls.UNITS.items()
        }
        curve = Curve("linear", _limits(document, (*at, "limits"), cls.output))
        lag = _lag(document, at, section)
        return [
            cls(
                name=name,
                curve=curve,
                lag=lag,
                position=position * turn,
                direction=hinge * turn,
                **parameters,
            )
            for name, position, hinge in _placed(document, at, "hinges", "fins")
        ]

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        return {name: getattr(self, name) for name in self.UNITS} | {"density": density}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MassShifter(Actuator):
    """A mass that moves along an axis."""

    kind = "mass_shifter"
    code = layout.MASS_SHIFTER
    output = "m"

    mass: float
    """mass, kg"""

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        document.section(at, ("type", "mass", "position", "axis", "limits", "rate"))
        axis = document.quantity((*at, "axis"), "1", ((3,),))
        if abs(np.linalg.norm(axis) - 1.0) > 1e-3:
            document.fail((*at, "axis", "value"), "an axis must be a unit vector")
        shifter = cls(
            name=at[-1],
            curve=Curve("linear", _limits(document, (*at, "limits"), cls.output)),
            position=document.quantity((*at, "position"), "m", ((3,),)) * turn,
            direction=axis * turn,
            rate=document.number((*at, "rate"), "m/s", above=0.0),
            mass=document.number((*at, "mass"), "kg", above=0.0),
        )
        return [shifter]

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        return {"upward": self.mass * gravity}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BuoyancyEngine(Actuator):
    """A bladder whose volume changes."""

    kind = "buoyancy_engine"
    code = layout.BUOYANCY_ENGINE
    output = "m3"

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        document.section(at, ("type", "position", "limits", "neutral", "rate"))
        neutral = document.number((*at, "neutral"), cls.output, low=0.0)
        engine = cls(
            name=at[-1],
            curve=Curve("linear", _limits(document, (*at, "limits"), cls.output, neutral), neutral=neutral),
            position=document.quantity((*at, "position"), "m", ((3,),)) * turn,
            rate=document.number((*at, "rate"), "m3/s", above=0.0),
        )
        return [engine]

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        return {"upward": density * gravity}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DropWeight(Actuator):
    """A weight that a command above 0.5 releases permanently."""

    kind = "drop_weight"
    code = layout.DROP_WEIGHT
    output = "1"

    mass: float
    """mass, kg"""

    @classmethod
    def read(cls, document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
        document.section(at, ("type", "mass", "position"))
        weight = cls(
            name=at[-1],
            curve=Curve("linear", (0.0, 1.0)),
            position=document.quantity((*at, "position"), "m", ((3,),)) * turn,
            mass=document.number((*at, "mass"), "kg", above=0.0),
            resting=np.zeros(1),  # 0: attached, 1: released
        )
        return [weight]

    def coefficients(self, density: float, gravity: float) -> dict[str, float]:
        return {"upward": self.mass * gravity}


KINDS: dict[str, type[Actuator]] = {
    cls.kind: cls for cls in (Thruster, Fin, MassShifter, BuoyancyEngine, DropWeight)
}
"""Class of each `type` of actuator in a sheet"""


def read_actuators(document: Document, turn: FloatArray) -> tuple[Actuator, ...]:
    """Return all actuators of a sheet in the sheet's order; the factors `turn` (3,) convert vectors to body FLU."""
    units: list[Actuator] = []
    for name in document.mapping(("actuators",)):
        at = ("actuators", str(name))
        document.mapping(at)
        units += KINDS[document.text((*at, "type"), KINDS)].read(document, at, turn)
    if not units:
        document.fail(("actuators",), "a vehicle needs at least one actuator")
    names = [unit.name for unit in units]
    for name in names:
        if names.count(name) > 1:
            document.fail(("actuators",), f"two actuators are called {name!r}; each needs its own name")
    return tuple(units)


def _placed(document: Document, at: Keys, aim: str, what: str) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return name, position and direction of each actuator of a group, in the sheet's frame."""
    positions = _vectors(document, (*at, "positions"), "m")
    directions = _directions(document, at, aim)
    if set(positions) != set(directions):
        document.fail((*at, aim), f"must name the same {what} as 'positions'")
    return [(name, position, directions[name]) for name, position in positions.items()]


def _gains(document: Document, at: Keys, names: Sequence[str]) -> dict[str, float]:
    """Return the force factors in the key `gain` of a group, by thruster; thrusters without a factor are left out."""
    where = (*at, "gain")
    values = document.sourced(where, "1")
    if not isinstance(values, Mapping):
        document.fail((*where, "value"), f"expected a factor under each thruster's name, got {values!r}")
    gains = {}
    for name, value in values.items():
        if name not in names:
            document.fail((*where, "value", str(name)), f"unknown key; {closest(str(name), names)}")
        gains[str(name)] = float(document.numbers((*where, "value", str(name)), value, ((),)))
        if gains[name] <= 0.0:
            document.fail((*where, "value", str(name)), f"a factor must be positive, got {gains[name]:g}")
    return gains


def _directions(document: Document, at: Keys, key: str) -> dict[str, FloatArray]:
    """Return unit vectors by actuator: the sheet's vectors or, for the key `angles`, the x axes of links with the sheet's angles."""
    where = (*at, key)
    if key == "angles":
        directions = {}
        for name, angles in _vectors(document, where, "deg").items():
            _, pitch, yaw = np.deg2rad(angles)
            directions[name] = np.array(
                [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
            )
        return directions
    vectors = _vectors(document, where, "1")
    for name, vector in vectors.items():
        length = float(np.linalg.norm(vector))
        if abs(length - 1.0) > 1e-3:
            what = "a hinge must be a unit vector" if key == "hinges" else "a direction must be a unit vector"
            document.fail((*where, "value", name), f"{what}; this one has length {length:g}")
    return vectors


def _vectors(document: Document, at: Keys, unit: str) -> dict[str, FloatArray]:
    values = document.sourced(at, unit)
    if not isinstance(values, Mapping):
        document.fail((*at, "value"), f"expected a vector under each actuator's name, got {values!r}")
    return {
        str(name): document.numbers((*at, "value", str(name)), value, ((3,),))
        for name, value in values.items()
    }


def _thrust_curve(document: Document, at: Keys) -> tuple[Curve, float]:
    """Return the static curve and the rotor constant k rho D^4 (0 if the curve gives newtons)."""
    document.mapping(at)
    kind = document.text((*at, "kind"), CURVES)
    if kind == "t200_16v":
        document.section(at, ("kind", "source"))
        document.source((*at, "source"))
        return t200_curve(), 0.0
    if kind == "t200":
        document.section(at, ("kind", "voltage", "source"))
        document.source((*at, "source"))
        voltage = document.number((*at, "voltage"), "V", low=VOLTAGES[0])
        if voltage > VOLTAGES[1]:
            document.fail(
                (*at, "voltage", "value"),
                f"{voltage:g} V is out of range: the table ends at {VOLTAGES[1]:g} V",
            )
        return t200_at(voltage), 0.0
    if kind == "polynomial":
        document.section(at, ("kind", "coefficients"))
        coefficients = document.sequence((*at, "coefficients"), "N")
        ends = np.polynomial.polynomial.polyval(np.array([-1.0, 1.0]), coefficients)
        return Curve("polynomial", (float(ends[0]), float(ends[1])), coefficients=coefficients), 0.0
    if "limits" not in document.mapping(at):
        document.fail(
            at, "thruster without limits: key 'limits' must give the curve's values at the commands -1 and +1"
        )
    if kind == "rotor":
        section = document.section(at, ("kind", "limits"), ("constant", "thrust_coefficient", "diameter"))
        if "constant" in section:
            constant = document.number((*at, "constant"), "N s2", above=0.0)
        else:
            coefficient = document.number((*at, "thrust_coefficient"), "1", above=0.0)
            density = float(document.quantity(("environment", "density"), "kg/m3"))
            constant = coefficient * density * document.number((*at, "diameter"), "m", above=0.0) ** 4
        return Curve("linear", _limits(document, (*at, "limits"), "rad/s")), constant
    document.section(at, ("kind", "limits"))
    return Curve("linear", _limits(document, (*at, "limits"), "N")), 0.0


def _limits(document: Document, at: Keys, unit: str, neutral: float = 0.0) -> tuple[float, float]:
    low, high = document.quantity(at, unit, ((2,),))
    if not low <= neutral <= high or low == high:
        document.fail((*at, "value"), f"limits [{low:g}, {high:g}] must be rising and enclose {neutral:g}")
    return float(low), float(high)


def _lag(document: Document, at: Keys, section: Mapping[str, Any]) -> Lag:
    if "transfer_function" in section:
        if "lag" in section:
            document.fail(at, "give either 'lag' or 'transfer_function'")
        where = (*at, "transfer_function")
        document.section(where, ("numerator", "denominator"))
        numerator = document.sequence((*where, "numerator"), "1")
        denominator = document.sequence((*where, "denominator"), "1")
        order = denominator.size - 1
        if not 1 <= order <= 3 or numerator.size > order or denominator[0] == 0.0:
            document.fail(where, "expected a strictly proper transfer function of order 1 to 3")
        if np.max(np.roots(denominator).real) >= 0.0:
            document.fail(
                (*where, "denominator"),
                "the transfer function is unstable; its poles must have negative real parts",
            )
        gain = numerator[-1] / denominator[-1]
        if abs(gain - 1.0) > 1e-9:
            document.fail(where, f"the static gain is {gain:g}: it must be 1")
        return Lag.transfer_function(numerator, denominator)
    if "lag" not in section:
        return Lag.none()
    time_constant = document.number((*at, "lag"), "s", low=0.0)
    return Lag.first_order(time_constant) if time_constant > 0.0 else Lag.none()
