"""Define a vehicle for the simulators: checked arrays in body FLU at the body origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.dynamics.rigid_body import rigid_body_mass
from auvbench.vehicles.actuators import Actuator, Thruster
from auvbench.vehicles.identified import Identified

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class VehicleModel:
    """Parameters of a vehicle; built and checked by `auvbench.vehicles.sheet.load`.

    Matrices are at the body origin CO with axes forward, port, up. Entries have the sign of the matrices M_A
    and D; Fossen's derivatives have the opposite sign.
    """

    name: str
    title: str
    gravity: float  # m/s2
    density: float  # kg/m3
    mass: float  # kg
    center_of_gravity: FloatArray  # (3,) m
    inertia: FloatArray  # (3, 3) kg m2, about the centre of gravity
    weight: float  # N
    buoyancy: float  # N
    center_of_buoyancy: FloatArray  # (3,) m
    M_A: FloatArray  # (6, 6) added mass, symmetric
    added_mass_coriolis: bool  # False: no C_A, as in some sources
    linear_damping: FloatArray  # (6,) N s/m, N m s
    quadratic_damping: FloatArray  # (6,) N s2/m2, N m s2
    units: tuple[Actuator, ...]
    controllable: tuple[str, ...] = ()  # degrees of freedom that the thrusters must command independently
    sources: tuple[tuple[str, str], ...] = ()  # (key, one-line citation)
    remarks: tuple[str, ...] = ()
    own_hull: tuple[float, float] | None = None  # m, radius and length of the sheet's hull
    identified: Identified | None = None  # result of an identification from logs, with the joint covariance
    plugin: str = ""  # release in `rigid_body.RELEASES` if C_A follows Gazebo's plugin instead of Fossen

    @property
    def hull(self) -> tuple[float, float]:
        """Return the radius and the length in m of the row of spheres that approximates the vehicle's shape.

        All spheres have this radius. Their centres are on a segment of the x axis with this length, centred at the origin. If
        the sheet has no hull, the shape is one sphere. It encloses all actuators and a uniform box with the vehicle's mass and
        inertia; the half diagonal of the box is sqrt(3 tr(I) / (2 m)).
        """
        if self.own_hull is not None:
            return self.own_hull
        diagonal = np.sqrt(1.5 * np.trace(self.inertia) / self.mass)
        farthest = max((float(np.linalg.norm(unit.position)) for unit in self.units), default=0.0)
        return max(float(diagonal), farthest), 0.0

    @property
    def coriolis_sign(self) -> float:
        """Return the sign of the Coriolis term of added mass: 1 for Fossen's, 0 for none, -1 for the term of
        Gazebo's plugin.
        """
        if not self.added_mass_coriolis:
            return 0.0
        return -1.0 if self.plugin else 1.0

    @property
    def actuators(self) -> tuple[str, ...]:
        """Return the names of the actuators, in the order of the action."""
        return tuple(unit.name for unit in self.units)

    @property
    def thrusters(self) -> list[tuple[int, Thruster]]:
        """Return the thrusters with their indices among the actuators."""
        return [(i, unit) for i, unit in enumerate(self.units) if isinstance(unit, Thruster)]

    @property
    def others(self) -> list[str]:
        """Return the names of the actuators other than thrusters."""
        return [unit.name for unit in self.units if not isinstance(unit, Thruster)]

    @property
    def M_RB(self) -> FloatArray:
        """Return the rigid-body mass matrix (6, 6) at the body origin."""
        return rigid_body_mass(self.mass, self.center_of_gravity, self.inertia)

    @property
    def M(self) -> FloatArray:
        """Return M_RB + M_A (6, 6)."""
        return self.M_RB + self.M_A

    @property
    def M_inverse(self) -> FloatArray:
        """Return the inverse of M (6, 6)."""
        return np.asarray(np.linalg.inv(self.M))

    @property
    def allocation(self) -> FloatArray:
        """Return the wrench (6, n_u) at the body origin per newton of each thruster; zero columns for other
        actuators.
        """
        B = np.zeros((6, len(self.units)))
        for column, unit in self.thrusters:
            B[:3, column] = unit.direction
            B[3:, column] = np.cross(unit.position, unit.direction)
        return B

    @property
    def command_limits(self) -> FloatArray:
        """Return the physical quantities (n_u, 2) at the commands -1 and +1, in N, rad/s, rad, m or m3."""
        return np.array([unit.curve.limits for unit in self.units]).reshape(-1, 2)

    @property
    def force_limits(self) -> FloatArray:
        """Return the forces (n_u, 2) in N at the commands -1 and +1; zero for actuators that are not thrusters."""
        return self.force(np.array([[-1.0], [1.0]]) * np.ones(len(self.units))).T

    def force(self, action: ArrayLike) -> FloatArray:
        """Return steady thruster forces (..., n_u) in N at normalised commands (..., n_u)."""
        action = np.asarray(action, dtype=np.float64)
        force = np.empty(action.shape)
        for i, unit in enumerate(self.units):
            force[..., i] = unit.force(action[..., i])
        return force

    def action(self, force: ArrayLike) -> FloatArray:
        """Return normalised commands (..., n_u) for `force` (..., n_u) in N, clipped to the reachable range."""
        force = np.asarray(force, dtype=np.float64)
        action = np.empty(force.shape)
        for i, unit in enumerate(self.units):
            action[..., i] = unit.command(force[..., i])
        return action

    def power(self, action: ArrayLike) -> FloatArray:
        """Return the electrical power (...,) in W of all thrusters at normalised commands (..., n_u)."""
        force = self.force(action)
        total = np.zeros(force.shape[:-1])
        for i, unit in self.thrusters:
            total = total + unit.power(force[..., i])
        return np.asarray(total)
