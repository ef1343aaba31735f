"""Write the sheet of an identified vehicle: the sheet of the prior with the numbers that the logs determine."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from auvbench.identification.fit import Estimate, Fit
from auvbench.identification.validation import quantiles
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import AXES

SOURCE = "identified"
"""Name, in a sheet's list of sources, of the source of numbers that come from logs."""
DIGITS = 6
"""Significant digits of numbers in a sheet."""


def identified_sheet(
    base: Mapping[str, Any], fit: Fit, *, name: str, command: str, digests: Sequence[tuple[str, str]]
) -> dict[str, Any]:
    """Return the content of the identified vehicle's sheet, after checking it.

    Args:
        base: content of the prior's sheet, merged with its parents.
        fit: result of the fit.
        name: name of the new vehicle.
        command: command line, which the sheet records.
        digests: name and SHA-256 of each log file.

    Raises:
        VehicleError: the numbers break a rule of sheets.
    """
    found = copy.deepcopy(dict(base))
    found["name"] = name
    found["title"] = f"{base['title']}, identified from {_count(len(digests), 'log')}"
    found["sources"] = {**found["sources"], SOURCE: {"title": _title(fit, digests), "note": command}}
    estimates = {e.parameter.name: e for e in fit.estimates if not e.kept}
    for key in ("mass", "net_buoyancy", "center_of_buoyancy.z"):
        if key in estimates:
            _PLACES[key](found, estimates[key], fit)
    for group, place in _PER_AXIS.items():
        parts = {
            AXES.index(k.partition(".")[2]): e for k, e in estimates.items() if k.startswith(f"{group}.")
        }
        if parts:
            _per_axis(found, place, parts)
    _thrusters(found, estimates)
    found["identification"] = _section(fit, command, digests)
    found["remarks"] = [*found.get("remarks", []), *_remarks(estimates)]
    sheet.load(found)
    return found


def dump(content: Mapping[str, Any]) -> str:
    """Return a sheet as YAML."""
    return yaml.safe_dump(
        dict(content), sort_keys=False, default_flow_style=None, width=130, allow_unicode=True
    )


def _title(fit: Fit, digests: Sequence[tuple[str, str]]) -> str:
    seconds = sum(log.duration for log in fit.logs)
    listed = ", ".join(f"{file} (SHA-256 {digest[:12]})" for file, digest in digests[:4])
    more = f" and {len(digests) - 4} more" if len(digests) > 4 else ""
    return f"auvbench identify, {seconds:.0f} s of {_count(len(digests), 'log')}: {listed}{more}"


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _round(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _quantity(estimate: Estimate, unit: str) -> dict[str, Any]:
    value, low, high = (_round(part) for part in (estimate.value, estimate.low, estimate.high))
    return {"value": value, "unit": unit, "range": [min(low, value), max(high, value)], "source": SOURCE}


def _mass(found: dict[str, Any], estimate: Estimate, fit: Fit) -> None:
    body = found["rigid_body"]
    if "weight" in body:
        factor = estimate.value / estimate.parameter.prior
        body["weight"] = {
            **body["weight"],
            "value": _round(body["weight"]["value"] * factor),
            "source": SOURCE,
        }
        body["weight"].pop("range", None)
    if "net" not in found["buoyancy"]:  # Write the net buoyancy, so that the new mass does not change it.
        net = fit.numbers.get("net_buoyancy", fit.vehicle.buoyancy - fit.vehicle.weight)
        found["buoyancy"] = {
            "center": found["buoyancy"]["center"],
            "net": {"value": _round(net), "unit": "N", "source": SOURCE},
        }
    body["mass"] = _quantity(estimate, "kg")


def _net(found: dict[str, Any], estimate: Estimate, fit: Fit) -> None:
    found["buoyancy"] = {"center": found["buoyancy"]["center"], "net": _quantity(estimate, "N")}


def _center(found: dict[str, Any], estimate: Estimate, fit: Fit) -> None:
    turn = -1.0 if found["frame"] == "ned" else 1.0
    ends = sorted(turn * part for part in (estimate.low, estimate.high, estimate.value))
    _components(found["buoyancy"]["center"], {2: (turn * estimate.value, ends[0], ends[2])})


_PLACES: dict[str, Callable[[dict[str, Any], Estimate, Fit], None]] = {
    "mass": _mass,
    "net_buoyancy": _net,
    "center_of_buoyancy.z": _center,
}
_PER_AXIS = {
    "inertia": ("rigid_body", "inertia"),
    "added_mass": ("hydrodynamics", "added_mass"),
    "linear_damping": ("hydrodynamics", "linear_damping"),
    "quadratic_damping": ("hydrodynamics", "quadratic_damping"),
}


def _per_axis(found: dict[str, Any], place: tuple[str, str], parts: Mapping[int, Estimate]) -> None:
    """Write the identified numbers of some axes to a list, or scale the rows and columns of a matrix to these numbers."""
    quantity = found[place[0]][place[1]]
    shift = 3 if place[1] == "inertia" else 0
    values = np.array(quantity["value"], dtype=np.float64)
    if values.ndim == 1:
        ends = {k - shift: (e.value, min(e.low, e.value), max(e.high, e.value)) for k, e in parts.items()}
        _components(quantity, ends)
        return
    scale = np.ones(len(values))
    for k, estimate in parts.items():
        scale[k - shift] = np.sqrt(estimate.value / values[k - shift, k - shift])
    values = values * np.outer(scale, scale)
    quantity["value"] = [[_round(value) for value in row] for row in values.tolist()]
    quantity.pop("range", None)
    _source(quantity, [AXES[k] for k in sorted(parts)])


def _components(quantity: dict[str, Any], parts: Mapping[int, tuple[float, float, float]]) -> None:
    """Write new values and ranges of some components of a quantity whose value is a list.

    `parts` has, for each component's index, the value and the low and high end of the range.
    """
    values = [float(value) for value in quantity["value"]]
    low, high = (list(map(float, ends)) for ends in quantity.get("range", (values, values)))
    for k, (value, lowest, highest) in parts.items():
        values[k], low[k], high[k] = _round(value), _round(lowest), _round(highest)
        low[k], high[k] = min(low[k], values[k]), max(high[k], values[k])
    quantity |= {"value": values, "range": [low, high]}
    _source(quantity, [(AXES if len(values) == 6 else "xyz")[k] for k in sorted(parts)])


def _source(quantity: dict[str, Any], names: Sequence[str]) -> None:
    """Add the source of the identified components to the quantity's sources, and the names of these components to its note."""
    given = quantity["source"]
    others = list(given) if isinstance(given, (list, tuple)) else [given]
    quantity["source"] = [SOURCE, *(source for source in others if source != SOURCE)]
    note = f"identified: {', '.join(names)}; the range of these is the 95 % interval"
    quantity["note"] = "; ".join([note, *([quantity["note"]] if quantity.get("note") else [])])


def _thrusters(found: dict[str, Any], estimates: Mapping[str, Estimate]) -> None:
    """Write the identified lag, gains and voltage of the thrusters to the sheet."""
    thrust = estimates["thrust"].value if "thrust" in estimates else 1.0
    for group in found["actuators"].values():
        if group["type"] != "thruster":
            continue
        if "lag" in estimates:
            group.pop("transfer_function", None)
            group["lag"] = _quantity(estimates["lag"], "s")
        if "voltage" in estimates and group["curve"].get("kind") in ("t200", "t200_16v"):
            group["curve"] = {
                "kind": "t200",
                "voltage": _quantity(estimates["voltage"], "V"),
                "source": group["curve"]["source"],
            }
        own = group.get("gain", {}).get("value", {})
        names = list(group["positions"]["value"])
        gains = {name: thrust * (e.value if (e := estimates.get(f"gain.{name}")) else 1.0) for name in names}
        if any(gain != 1.0 for gain in gains.values()):
            value = {name: _round(gains[name] * own.get(name, 1.0)) for name in names}
            group["gain"] = {"value": value, "unit": "1", "source": SOURCE}


def _section(fit: Fit, command: str, digests: Sequence[tuple[str, str]]) -> dict[str, Any]:
    estimates = fit.estimates
    errors = quantiles(fit.logs, fit.vehicle, {e.parameter.name: e.value for e in estimates})
    return {
        "logs": [{"name": file, "sha256": digest} for file, digest in digests],
        "command": command,
        "parameters": [e.parameter.name for e in estimates],
        "prior": [_round(e.parameter.prior) for e in estimates],
        "sd": [_round(e.parameter.sd) for e in estimates],
        "logarithmic": [e.parameter.log for e in estimates],
        "fitted": [_round(e.x) for e in estimates],
        "covariance": rounded(fit.covariance),
        "delay": _round(
            next((e.value for e in estimates if e.parameter.name == "delay" and not e.kept), 0.0)
        ),
        "errors": {
            channel: {f"{horizon:g}_s": float(f"{error:.3g}") for horizon, error in row.items()}
            for channel, row in errors.items()
        },
    }


def rounded(covariance: NDArray[np.float64]) -> list[list[float]]:
    """Return a covariance for a sheet: its diagonal enlarged by 0.01 %, its numbers rounded to nine significant digits.

    With fewer digits, or without the enlarged diagonal, a covariance from few bootstrap replicates would get negative eigenvalues.
    """
    matrix = 0.5 * (covariance + covariance.T) + 1e-4 * np.diag(np.diag(covariance))
    return [[float(f"{value:.9g}") for value in row] for row in matrix.tolist()]


def _remarks(estimates: Mapping[str, Estimate]) -> list[str]:
    delay = estimates.get("delay")
    if delay is None or delay.value < 5e-4:
        return []
    return [
        f"The logs show a delay of {1e3 * delay.value:.0f} ms, which is in the section identification, not in the model."
    ]
