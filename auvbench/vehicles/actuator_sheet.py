"""The `actuators` part of a vehicle sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.actuators import FIN_PARAMETERS, Actuator, Curve, Lag, Power, t200_table
from auvbench.vehicles.document import Document, Keys

FloatArray = NDArray[np.float64]

CURVES = ("linear", "t200_16v", "polynomial", "rotor")
_FIN_UNITS = dict(zip(FIN_PARAMETERS, ("m2", "1/rad", "1/rad", "1/rad", "1/rad", "rad"), strict=True))


def read_actuators(document: Document, turn: FloatArray) -> tuple[Actuator, ...]:
    """All actuators of the sheet, groups in the order written; vectors turned into body FLU by `turn` (3,)."""
    groups = document.mapping(("actuators",))
    units: list[Actuator] = []
    for name in groups:
        at = ("actuators", str(name))
        document.mapping(at)
        units += READERS[document.text((*at, "type"), READERS)](document, at, turn)
    if not units:
        document.fail(("actuators",), "a vehicle needs at least one actuator")
    names = [unit.name for unit in units]
    for name in names:
        if names.count(name) > 1:
            document.fail(("actuators",), f"two actuators are called {name!r}")
    return tuple(units)


def _thrusters(document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
    aim = ("directions", "angles", "orientations")
    section = document.section(
        at, ("type", "curve", "positions"), ("lag", "transfer_function", "power", *aim)
    )
    curve, rotor = _curve(document, (*at, "curve"))
    lag = _lag(document, at, section)
    power = _power(document, (*at, "power")) if "power" in section else Power()
    positions = _vectors(document, (*at, "positions"), "m", 3)
    given = [key for key in aim if key in section]
    if len(given) != 1:
        document.fail(at, f"give exactly one of {', '.join(aim)}, which say where the thrusters push")
    directions = _directions(document, at, given[0])
    if set(positions) != set(directions):
        document.fail((*at, given[0]), "does not name the same thrusters as 'positions'")
    return [
        Actuator(name, "thruster", curve, lag, position * turn, directions[name] * turn, rotor, power)
        for name, position in positions.items()
    ]


def _directions(document: Document, at: Keys, key: str) -> dict[str, FloatArray]:
    """Unit vectors of positive thrust, as given or as the x axis of a link with given attitude."""
    where = (*at, key)
    if key == "angles":
        found = {}
        for name, angles in _vectors(document, where, "deg", 3).items():
            _, pitch, yaw = np.deg2rad(angles)
            found[name] = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
        return found
    vectors = _vectors(document, where, "1", 4 if key == "orientations" else 3)
    for name, vector in vectors.items():
        length = float(np.linalg.norm(vector))
        if abs(length - 1.0) > 1e-3:
            what = {
                "orientations": "an orientation is a unit quaternion w, x, y, z",
                "hinges": "a hinge is a unit vector",
            }.get(key, "a direction is a unit vector")
            document.fail((*where, "value", name), f"{what}; this one has length {length:g}")
        if key == "orientations":
            w, x, y, z = vector
            vectors[name] = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    return vectors


def _vectors(document: Document, at: Keys, unit: str, size: int) -> dict[str, FloatArray]:
    values = document.sourced(at, unit)
    if not isinstance(values, Mapping):
        document.fail((*at, "value"), f"expected a vector under each actuator's name, got {values!r}")
    return {
        str(name): document.numbers((*at, "value", str(name)), value, ((size,),))
        for name, value in values.items()
    }


def _curve(document: Document, at: Keys) -> tuple[Curve, float]:
    """The static curve and the rotor constant k rho D^4 (0 where the curve gives newtons)."""
    document.mapping(at)
    kind = document.text((*at, "kind"), CURVES)
    if kind == "t200_16v":
        document.section(at, ("kind", "source"))
        document.source((*at, "source"))
        force = t200_table()["force_N"]
        return Curve("table", (float(force[0]), float(force[-1])), table=force), 0.0
    if kind == "polynomial":
        document.section(at, ("kind", "coefficients"))
        coefficients = document.sequence((*at, "coefficients"), "N")
        ends = np.polynomial.polynomial.polyval(np.array([-1.0, 1.0]), coefficients)
        return Curve("polynomial", (float(ends[0]), float(ends[1])), coefficients=coefficients), 0.0
    if "limits" not in document.mapping(at):
        document.fail(at, "thruster without limits: key 'limits' must give the command at -1 and at +1")
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
            document.fail((*where, "denominator"), "the transfer function is unstable")
        gain = numerator[-1] / denominator[-1]
        if abs(gain - 1.0) > 1e-9:
            document.fail(where, f"the static gain is {gain:g}: it must be 1")
        return Lag.transfer_function(numerator, denominator)
    if "lag" not in section:
        return Lag.none()
    time_constant = document.number((*at, "lag"), "s", low=0.0)
    return Lag.first_order(time_constant) if time_constant > 0.0 else Lag.none()


def _power(document: Document, at: Keys) -> Power:
    document.section(at, ("force_scale", "power_scale"))
    return Power(
        document.number((*at, "force_scale"), "1", above=0.0),
        document.number((*at, "power_scale"), "1", low=0.0),
    )


def _fins(document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
    section = document.section(at, ("type", "limits", "positions", "hinges", *FIN_PARAMETERS), ("lag",))
    parameters = {
        name: document.number((*at, name), unit, low=0.0 if name in ("area", "stall_angle") else -np.inf)
        for name, unit in _FIN_UNITS.items()
    }
    curve = Curve("linear", _limits(document, (*at, "limits"), "rad"))
    lag = _lag(document, at, section)
    hinges = _directions(document, at, "hinges")
    positions = _vectors(document, (*at, "positions"), "m", 3)
    if set(positions) != set(hinges):
        document.fail((*at, "hinges"), "does not name the same fins as 'positions'")
    return [
        Actuator(name, "fin", curve, lag, position * turn, hinges[name] * turn, parameters=parameters)
        for name, position in positions.items()
    ]


def _mass_shifter(document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
    document.section(at, ("type", "mass", "position", "axis", "limits", "rate"))
    axis = document.quantity((*at, "axis"), "1", ((3,),))
    if abs(np.linalg.norm(axis) - 1.0) > 1e-3:
        document.fail((*at, "axis", "value"), "an axis is a unit vector")
    return [
        Actuator(
            at[-1],
            "mass_shifter",
            Curve("linear", _limits(document, (*at, "limits"), "m")),
            Lag.none(),
            document.quantity((*at, "position"), "m", ((3,),)) * turn,
            axis * turn,
            rate=document.number((*at, "rate"), "m/s", above=0.0),
            parameters={"mass": document.number((*at, "mass"), "kg", above=0.0)},
        )
    ]


def _buoyancy_engine(document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
    document.section(at, ("type", "position", "limits", "neutral", "rate"))
    neutral = document.number((*at, "neutral"), "m3", low=0.0)
    limits = _limits(document, (*at, "limits"), "m3", neutral)
    return [
        Actuator(
            at[-1],
            "buoyancy_engine",
            Curve("linear", limits, neutral=neutral),
            Lag.none(),
            document.quantity((*at, "position"), "m", ((3,),)) * turn,
            np.zeros(3),
            rate=document.number((*at, "rate"), "m3/s", above=0.0),
        )
    ]


def _drop_weight(document: Document, at: Keys, turn: FloatArray) -> list[Actuator]:
    document.section(at, ("type", "mass", "position"))
    return [
        Actuator(
            at[-1],
            "drop_weight",
            Curve("linear", (0.0, 1.0)),
            Lag.none(),
            document.quantity((*at, "position"), "m", ((3,),)) * turn,
            np.zeros(3),
            parameters={"mass": document.number((*at, "mass"), "kg", above=0.0)},
        )
    ]


READERS: dict[str, Callable[[Document, Keys, FloatArray], list[Actuator]]] = {
    "thruster": _thrusters,
    "fin": _fins,
    "mass_shifter": _mass_shifter,
    "buoyancy_engine": _buoyancy_engine,
    "drop_weight": _drop_weight,
}
