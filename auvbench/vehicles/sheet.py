"""Convert a vehicle sheet, in which every number names its source, to a checked `VehicleModel`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.rigid_body import RELEASES, rigid_body_mass
from auvbench.errors import VehicleError, closest
from auvbench.vehicles import identified
from auvbench.vehicles.actuators import read_actuators
from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.reader import Document, read
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

_BUOYANCY = ("volume", "force", "net")
_ASYMMETRY = 1e-9
_MENDABLE = 0.1
"""Largest asymmetry of an added-mass matrix that `symmetrise` averages, as a share of sqrt(M_ii M_jj).
Identification leaves a far smaller asymmetry (rexrov: 1e-6), and a typing error causes a far larger one.
"""
SHORTEST = 1e-5
"""Smallest value that is allowed for a vehicle's shortest time constant, s; real vehicles have some milliseconds (docs/physics.md)"""


DEFAULT = "bluerov2_2026"
"""Default sheet of `auvbench pilot`; conf/train.yaml has the same default vehicle"""


def load(source: str | Path | Mapping[str, Any]) -> VehicleModel:
    """Return the vehicle that a sheet describes.

    Args:
        source: content of a sheet as a mapping, path of a YAML file, or name of a known sheet
            (`reader.sheets`).

    Raises:
        VehicleError: the sheet breaks a rule; the message names file, key and rule.

    >>> load("bluerov2").mass
    15.22
    """
    document = read(source)
    document.section(
        (),
        ("name", "title", "frame", "sources", "environment", "rigid_body", "buoyancy", "hydrodynamics",
         "actuators", "controllable"),
        ("hull", "identification", "remarks"),
    )  # fmt: skip
    document.section(("sources",), (), tuple(document.mapping(("sources",))))
    frame = document.text(("frame",), ("enu", "ned"))
    # NED/FRD and ENU/FLU body axes differ by half a turn about x.
    turn = np.array([1.0, -1.0, -1.0]) if frame == "ned" else np.ones(3)
    document.section(("environment",), ("gravity", "density"))
    gravity = document.number(("environment", "gravity"), "m/s2", above=0.0)
    density = document.number(("environment", "density"), "kg/m3", above=0.0)
    mass, weight, r_g, inertia = _rigid_body(document, gravity, turn)
    buoyancy, r_b = _buoyancy(document, weight, gravity, density, turn)
    M_A, coriolis, release, linear, quadratic = _hydrodynamics(document, turn)
    _check_mass(document, rigid_body_mass(mass, r_g, inertia), M_A)
    units = read_actuators(document, turn)
    vehicle = VehicleModel(
        name=document.text(("name",)),
        title=document.text(("title",)),
        gravity=gravity,
        density=density,
        mass=mass,
        center_of_gravity=r_g,
        inertia=inertia,
        weight=weight,
        buoyancy=buoyancy,
        center_of_buoyancy=r_b,
        M_A=M_A,
        added_mass_coriolis=coriolis,
        plugin=release,
        linear_damping=linear,
        quadratic_damping=quadratic,
        units=units,
        controllable=_controllable(document),
        own_hull=_hull(document),
        identified=identified.of(document),
        sources=_sources(document),
        remarks=document.texts("remarks"),
    )
    _check_allocation(document, vehicle)
    return vehicle


def _sources(document: Document) -> tuple[tuple[str, str], ...]:
    """Return the citations of the sources that the sheet's numbers name, without unused sources of a parent sheet."""
    citations = []
    for key in document.mapping(("sources",)):
        path = ("sources", str(key))
        document.section(path, ("title",), ("repository", "version", "licence", "note"))
        if key not in document.used:
            continue
        fields = document.mapping(path)
        parts = [
            str(fields[name]) for name in ("title", "repository", "version", "licence") if name in fields
        ]
        citations.append((str(key), ", ".join(parts)))
    return tuple(citations)


def _rigid_body(
    document: Document, gravity: float, turn: FloatArray
) -> tuple[float, float, FloatArray, FloatArray]:
    at = ("rigid_body",)
    section = document.section(at, ("mass", "center_of_gravity", "inertia"), ("weight",))
    mass = document.number((*at, "mass"), "kg", above=0.0)
    weight = document.number((*at, "weight"), "N", above=0.0) if "weight" in section else mass * gravity
    r_g = document.quantity((*at, "center_of_gravity"), "m", ((3,),)) * turn
    inertia = document.quantity((*at, "inertia"), "kg m2", ((3,), (3, 3)))
    if inertia.ndim == 1:
        inertia = np.diag(inertia)
    where = (*at, "inertia", "value")
    if np.max(np.abs(inertia - inertia.T)) > _ASYMMETRY * np.max(np.abs(inertia)):
        document.fail(
            where,
            f"the inertia matrix is not symmetric (entries differ by up to {np.max(np.abs(inertia - inertia.T)):g})",
        )
    principal = np.linalg.eigvalsh(inertia)
    smallest = float(principal[0])
    if principal[2] > (principal[0] + principal[1]) * (1.0 + _ASYMMETRY) and smallest > 0.0:
        document.fail(
            where,
            f"no body has the principal inertias {', '.join(f'{value:g}' for value in principal)}: each must be at most"
            " the sum of the other two",
        )
    if smallest <= 0.0:
        document.fail(
            where, f"the inertia matrix is not positive definite (smallest eigenvalue {smallest:g})"
        )
    return mass, weight, r_g, inertia * np.outer(turn, turn)


def _buoyancy(
    document: Document, weight: float, gravity: float, density: float, turn: FloatArray
) -> tuple[float, FloatArray]:
    at = ("buoyancy",)
    section = document.section(at, ("center",), _BUOYANCY)
    keys = [key for key in _BUOYANCY if key in section]
    if len(keys) != 1:
        document.fail(
            at,
            f"give exactly one of 'volume' in m3, 'force' in N, 'net' (force minus weight) in N; got {keys}",
        )
    if keys == ["volume"]:
        force = density * gravity * document.number((*at, "volume"), "m3", low=0.0)
    elif keys == ["force"]:
        force = document.number((*at, "force"), "N", low=0.0)
    else:
        force = weight + document.number((*at, "net"), "N", low=-weight)
    return force, document.quantity((*at, "center"), "m", ((3,),)) * turn


def _hydrodynamics(
    document: Document, turn: FloatArray
) -> tuple[FloatArray, bool, str, FloatArray, FloatArray]:
    at = ("hydrodynamics",)
    section = document.section(
        at, ("added_mass", "linear_damping", "quadratic_damping"), ("added_mass_coriolis", "symmetrise")
    )
    M_A = document.quantity((*at, "added_mass"), "kg, kg m, kg m2", ((6,), (6, 6)))
    if M_A.ndim == 1:
        M_A = np.diag(M_A)
    asymmetry = float(np.max(np.abs(M_A - M_A.T)))
    if asymmetry > _ASYMMETRY * float(np.max(np.abs(M_A))):
        if section.get("symmetrise") is not True:
            document.fail(
                (*at, "added_mass", "value"),
                f"the added-mass matrix is not symmetric (entries differ by up to {asymmetry:g}); correct it or "
                "say 'symmetrise: true' to use the mean with its transpose",
            )
        scale = np.sqrt(np.abs(np.outer(np.diag(M_A), np.diag(M_A))))
        excess = np.abs(M_A - M_A.T) - _MENDABLE * scale
        row, column = (int(k) for k in np.unravel_index(np.argmax(excess), excess.shape))
        if excess[row, column] > 0.0:
            document.fail(
                (*at, "added_mass", "value"),
                f"entries ({row + 1},{column + 1}) = {M_A[row, column]:g} and ({column + 1},{row + 1}) ="
                f" {M_A[column, row]:g} differ too much for 'symmetrise': by at most {100 * _MENDABLE:g} % of the"
                f" root of the product of their diagonal entries, {scale[row, column]:g}",
            )
        M_A = 0.5 * (M_A + M_A.T)
    smallest = float(np.linalg.eigvalsh(M_A)[0])
    if smallest < -_ASYMMETRY * float(np.max(np.abs(M_A))):
        document.fail(
            (*at, "added_mass", "value"),
            f"the added-mass matrix is indefinite (smallest eigenvalue {smallest:g}): entries have the sign of the matrix "
            "M_A; Fossen's derivatives have the opposite sign",
        )
    coriolis, release = _coriolis(document, section, M_A)
    damping = []
    for key, unit in (("linear_damping", "N s/m, N m s"), ("quadratic_damping", "N s2/m2, N m s2")):
        values = document.quantity((*at, key), unit, ((6,),))
        if np.any(values < 0.0):
            index = int(np.argmax(values < 0.0))
            document.fail(
                (*at, key, "value"),
                f"negative damping {values[index]:g} in {AXES[index]}: entries have the sign of the matrix "
                "D, which takes energy out; Fossen's derivatives have the opposite sign",
            )
        damping.append(values)
    six = np.concatenate((turn, turn))
    return M_A * np.outer(six, six), coriolis, release, damping[0], damping[1]


def _coriolis(document: Document, section: Mapping[str, Any], M_A: FloatArray) -> tuple[bool, str]:
    """Return whether added mass has a Coriolis term, and the release of the Gazebo plugin whose term is used; '': Fossen's term."""
    at = ("hydrodynamics", "added_mass_coriolis")
    value = section.get("added_mass_coriolis", True)
    if isinstance(value, Mapping):
        value = document.sourced(at, "1")
    if isinstance(value, bool):
        return value, ""
    if value not in RELEASES:
        document.fail(at, f"{value!r} must be true, false or {' or '.join(RELEASES)}")
    if np.any(np.diag(np.diag(M_A)) != M_A):
        document.fail(at, f"{value}: the plugin's term needs a diagonal added mass")
    return True, str(value)


def _check_mass(document: Document, M_RB: FloatArray, M_A: FloatArray) -> None:
    smallest = float(np.linalg.eigvalsh(M_RB + M_A)[0])
    if smallest <= 0.0:
        document.fail(
            ("rigid_body",),
            f"M_RB + M_A is not positive definite (smallest eigenvalue {smallest:g}); correct mass, inertia or added mass",
        )


def _controllable(document: Document) -> tuple[str, ...]:
    declared = document.get(("controllable",))
    if not isinstance(declared, list) or not declared:
        document.fail(("controllable",), f"expected a list of {', '.join(AXES)}, got {declared!r}")
    for name in declared:
        if name not in AXES:
            document.fail(
                ("controllable",),
                f"{name!r} is not a degree of freedom; {closest(str(name), AXES)}",
            )
    return tuple(declared)


def _hull(document: Document) -> tuple[float, float] | None:
    """Return the hull as the radius and length in m of a row of spheres; None if the sheet has no hull."""
    if "hull" not in document.mapping(()):
        return None
    section = document.section(("hull",), ("radius",), ("length",))
    radius = document.number(("hull", "radius"), "m", above=0.0)
    length = document.number(("hull", "length"), "m", low=0.0) if "length" in section else 0.0
    if length > 50.0 * radius:
        document.fail(
            ("hull", "length"), f"{length:g} m must be at most 50 times the radius, {50.0 * radius:g} m"
        )
    return radius, length


def _check_allocation(document: Document, vehicle: VehicleModel) -> None:
    rows = [AXES.index(name) for name in vehicle.controllable]
    rank = int(np.linalg.matrix_rank(vehicle.allocation[rows]))
    if rank < len(rows):
        document.fail(
            ("controllable",),
            f"rank-deficient allocation: the thrusters span {rank} of the {len(rows)} degrees of freedom declared "
            f"({', '.join(vehicle.controllable)}); move a thruster or declare fewer degrees of freedom",
        )


def refuse_stiff_vehicle(name: str, shortest: float) -> None:
    """Raise VehicleError for a vehicle with such a short time constant that the physics step would have to be tiny.

    Args:
        name: name of the vehicle, for the message.
        shortest: shortest time constant in s, of the vehicle or of any vehicle that a randomisation may draw.

    Raises:
        VehicleError: the time constant is below `SHORTEST`, or NaN.
    """
    if not shortest >= SHORTEST:
        raise VehicleError(
            f"vehicle {name}: damping too large for its mass: time constant {shortest:.3g} s, must be at "
            f"least {SHORTEST:g} s "
            f"(auvbench vehicles {name})"
        )
