"""Masses for Gazebo: the hull without its propellers, which are bodies of their own, and explicit added mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import VehicleError
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

PROPELLER = 0.01
"""kg of each propeller link, which a Thruster plugin needs and no sheet has; taken off the hull, inertia included."""


def explicit_growth(vehicle: VehicleModel) -> float:
    """Return the factor by which an error of the acceleration grows per step if added mass is an explicit force.

    With M_RB a[k+1] = tau - M_A a[k] an error grows by the largest eigenvalue of M_RB^-1 M_A, at any step.
    """
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(vehicle.M_RB, vehicle.M_A))).max())


def whole(vehicle: VehicleModel) -> tuple[float, FloatArray, FloatArray]:
    """Return the vehicle's mass in kg, centre of gravity (3,) in m, and inertia (3, 3) in kg m2 about it."""
    return vehicle.mass, vehicle.center_of_gravity, vehicle.inertia


def hull(vehicle: VehicleModel) -> tuple[float, FloatArray, FloatArray]:
    """Return the same as `whole` for the vehicle without its propellers, spheres of PROPELLER kg."""
    mass = vehicle.mass - PROPELLER * len(vehicle.units)
    if mass <= 0.0:
        raise VehicleError(
            f"vehicle {vehicle.name}: {len(vehicle.units)} propellers of {PROPELLER:g} kg exceed its"
            f" {vehicle.mass:g} kg"
        )
    moment = vehicle.mass * vehicle.center_of_gravity - PROPELLER * sum(
        (unit.position for unit in vehicle.units), np.zeros(3)
    )
    r_g = moment / mass
    inertia = vehicle.inertia + _parallel(vehicle.mass, vehicle.center_of_gravity)
    for unit in vehicle.units:
        inertia = inertia - _parallel(PROPELLER, unit.position) - spin(PROPELLER) * np.eye(3)
    return mass, r_g, inertia - _parallel(mass, r_g)


def _parallel(mass: float, r: FloatArray) -> FloatArray:
    """Return the inertia (3, 3) of a point mass at `r` (3,) about the origin."""
    return np.asarray(mass * (float(r @ r) * np.eye(3) - np.outer(r, r)))


def spin(mass: float) -> float:
    """Return the moment of inertia in kg m2 of a propeller link, a sphere of 2 cm radius."""
    return 0.4 * mass * 0.02**2
