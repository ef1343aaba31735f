"""The `actuators` part of a vehicle sheet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.vehicles.actuators import Actuator, Curve, Lag, Power, t200_table
from auvbench.vehicles.reader import Document, Keys

FloatArray = NDArray[np.float64]

CURVES = ("linear", "t200_16v", "polynomial", "rotor")


def read_actuators(document: Document, turn: FloatArray, density: float) -> tuple[Actuator, ...]:
    """All actuators of the sheet, groups in the order written; vectors turned into body FLU by `turn`."""
    groups = document.get(("actuators",))
    document.section(("actuators",), (), tuple(groups))
    units: list[Actuator] = []
    for name in groups:
        units += _thrusters(document, ("actuators", str(name)), turn, density)
    if not units:
        document.fail(("actuators",), "a vehicle needs at least one actuator")
    return tuple(units)


def _thrusters(document: Document, at: Keys, turn: FloatArray, density: float) -> list[Actuator]:
    section = document.section(
        at, ("type", "curve", "positions", "directions"), ("lag", "transfer_function", "power")
    )
    document.text((*at, "type"), ("thruster",))
    curve, rotor = _curve(document, (*at, "curve"), density)
    lag = _lag(document, at, section)
    power = _power(document, (*at, "power")) if "power" in section else Power()
    positions = document.sourced((*at, "positions"), "m")
    directions = document.sourced((*at, "directions"), "1")
    if set(positions) != set(directions):
        document.fail(at, "'positions' and 'directions' do not name the same thrusters")
    units = []
    for name in positions:
        position = document.numbers((*at, "positions", "value", name), positions[name], ((3,),))
        where = (*at, "directions", "value", name)
        direction = document.numbers(where, directions[name], ((3,),))
        length = float(np.linalg.norm(direction))
        if abs(length - 1.0) > 1e-3:
            document.fail(where, f"a direction is a unit vector; this one has length {length:g}")
        units.append(
            Actuator(str(name), "thruster", curve, lag, position * turn, direction * turn, rotor, power)
        )
    return units


def _curve(document: Document, at: Keys, density: float) -> tuple[Curve, float]:
    """The static curve and the rotor constant k rho D^4 (0 where the curve gives newtons)."""
    kind = document.text((*at, "kind"), CURVES)
    if kind == "t200_16v":
        document.section(at, ("kind", "source"))
        document.source((*at, "source"))
        force = t200_table()["force_N"]
        return Curve("table", (float(force[0]), float(force[-1])), table=force), 0.0
    if kind == "polynomial":
        document.section(at, ("kind", "coefficients"))
        where = (*at, "coefficients")
        count = len(document.sourced(where, "N"))
        coefficients = document.quantity(where, "N", ((count,),))
        ends = np.polynomial.polynomial.polyval(np.array([-1.0, 1.0]), coefficients)
        return Curve("polynomial", (float(ends[0]), float(ends[1])), coefficients=coefficients), 0.0
    if kind == "rotor":
        document.section(at, ("kind", "limits", "constant"))
        constant = document.number((*at, "constant"), "N s2", above=0.0)
        return Curve("linear", _limits(document, (*at, "limits"), "rad/s")), constant
    document.section(at, ("kind", "limits"))
    return Curve("linear", _limits(document, (*at, "limits"), "N")), 0.0


def _limits(document: Document, at: Keys, unit: str) -> tuple[float, float]:
    low, high = document.quantity(at, unit, ((2,),))
    if not low <= 0.0 <= high or low == high:
        document.fail((*at, "value"), f"limits [{low:g}, {high:g}] must enclose 0 and differ")
    return float(low), float(high)


def _lag(document: Document, at: Keys, section: dict[str, object]) -> Lag:
    if "transfer_function" in section:
        where = (*at, "transfer_function")
        document.section(where, ("numerator", "denominator"))
        count = len(document.sourced((*where, "numerator"), "1"))
        order = len(document.sourced((*where, "denominator"), "1")) - 1
        if not 1 <= order <= 3 or count > order:
            document.fail(where, "expected a strictly proper transfer function of order 1 to 3")
        numerator = document.quantity((*where, "numerator"), "1", ((count,),))
        denominator = document.quantity((*where, "denominator"), "1", ((order + 1,),))
        if abs(numerator[-1] / denominator[-1] - 1.0) > 1e-9:
            document.fail(where, f"static gain is {numerator[-1] / denominator[-1]:g}: it must be 1")
        if np.max(np.roots(denominator).real) >= 0.0:
            document.fail((*where, "denominator"), "the transfer function is unstable")
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
