"""Change a vehicle sheet: scale its numbers, set the net buoyancy, add a payload, set the thrusters' lag, or weaken thrusters.

The result is a sheet again, so all code that reads sheets works with it.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.vehicles import sheet

FloatArray = NDArray[np.float64]

SCALES = ("mass", "inertia", "added_mass", "linear_damping", "quadratic_damping", "thrust")
SOURCE = "changed"
"""Source of changed numbers"""


@dataclass(frozen=True)
class Changes:
    """Changes, in the order of application."""

    scale: Mapping[str, float] = field(default_factory=dict)
    """Factors by the names in `SCALES`; the buoyancy changes with the mass, so that the net buoyancy stays the same"""
    net_buoyancy: float | None = None
    """Buoyancy less weight, N; None: unchanged"""
    payload: float = 0.0
    """Mass in kg of a payload, a point without volume"""
    payload_at: Sequence[float] = (0.0, 0.0, 0.0)
    """Position of the payload in body FLU, m"""
    lag: float | None = None
    """Time constant of every thruster's first-order lag, s; None: keep the sheet's lags"""
    shares: Mapping[int, float] = field(default_factory=dict)
    """Remaining fraction of a thruster's force; the keys are thruster numbers, counted from 1"""

    def __bool__(self) -> bool:
        """Return whether anything changes."""
        return self != Changes()


def changed(values: Mapping[str, Any], changes: Changes) -> dict[str, Any]:
    """Return a copy of a sheet with the changes applied.

    Args:
        values: content of a sheet, without parents.
        changes: changes to apply.

    Raises:
        VehicleError: the sheet is invalid, lacks a thruster that the changes name, or becomes invalid by a change.
    """
    if not changes:
        return dict(values)
    content = copy.deepcopy(dict(values))
    content["sources"] = {**content["sources"], SOURCE: {"title": "changed for a test"}}
    _scale(content, changes.scale)
    if changes.net_buoyancy is not None:
        _float(content, changes.net_buoyancy)
    elif "mass" in changes.scale:
        before = sheet.load(values)
        _float(content, before.buoyancy - before.weight)
    if changes.payload:
        _load(content, changes)
    _thrust(content, changes)
    sheet.load(content)
    return content


def _scale(content: dict[str, Any], scale: Mapping[str, float]) -> None:
    places = {
        "mass": [("rigid_body", "mass"), ("rigid_body", "weight")],
        "inertia": [("rigid_body", "inertia")],
        "added_mass": [("hydrodynamics", "added_mass")],
        "linear_damping": [("hydrodynamics", "linear_damping")],
        "quadratic_damping": [("hydrodynamics", "quadratic_damping")],
    }
    for name, factor in scale.items():
        for section, key in places.get(name, []):
            quantity = content[section].get(key)
            if quantity is not None:
                value = factor * np.array(quantity["value"], dtype=np.float64)
                # The sheet's range may not contain the changed value.
                entries = {name: entry for name, entry in quantity.items() if name != "range"}
                content[section][key] = {**entries, "value": value.tolist()}


def _float(content: dict[str, Any], net: float) -> None:
    """Set the net buoyancy in N."""
    content["buoyancy"] = {"center": content["buoyancy"]["center"], "net": _quantity(net, "N")}


def _load(content: dict[str, Any], changes: Changes) -> None:
    """Add a point mass without changing the volume."""
    vehicle = sheet.load(content)
    body, payload = vehicle.mass, changes.payload
    at = np.array(changes.payload_at, dtype=np.float64)
    whole = body + payload
    center = (body * vehicle.center_of_gravity + payload * at) / whole
    inertia = vehicle.inertia.copy()
    for mass, place in ((body, vehicle.center_of_gravity), (payload, at)):
        arm = place - center
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    turn = np.array([1.0, -1.0, -1.0]) if content["frame"] == "ned" else np.ones(3)
    content["rigid_body"] = {
        "mass": _quantity(whole, "kg"),
        "center_of_gravity": _quantity((center * turn).tolist(), "m"),
        "inertia": _quantity((inertia * np.outer(turn, turn)).tolist(), "kg m2"),
        "weight": _quantity(vehicle.weight + payload * vehicle.gravity, "N"),
    }
    content["buoyancy"] = {"center": content["buoyancy"]["center"], "force": _quantity(vehicle.buoyancy, "N")}


def _thrust(content: dict[str, Any], changes: Changes) -> None:
    """Set the lag and the gains of the thrusters."""
    factor = changes.scale.get("thrust", 1.0)
    numbers = dict(enumerate(_thrusters(content), start=1))
    for number in changes.shares:
        if number not in numbers:
            raise VehicleError(
                f"vehicle {content['name']}: has no thruster {number}; it has {len(numbers)} thrusters"
            )
    gains = {name: factor * changes.shares.get(number, 1.0) for number, name in numbers.items()}
    for group in content["actuators"].values():
        if group["type"] != "thruster":
            continue
        if changes.lag is not None:
            group.pop("transfer_function", None)
            group["lag"] = _quantity(changes.lag, "s")
        if any(gain != 1.0 for gain in gains.values()):
            own = group.get("gain", {}).get("value", {})
            names = group["positions"]["value"]
            group["gain"] = _quantity({name: gains[name] * own.get(name, 1.0) for name in names}, "1")


def _thrusters(content: Mapping[str, Any]) -> list[str]:
    groups = [group for group in content["actuators"].values() if group["type"] == "thruster"]
    return [str(name) for group in groups for name in group["positions"]["value"]]


def _quantity(value: Any, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "source": SOURCE}
