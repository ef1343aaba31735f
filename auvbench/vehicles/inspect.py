"""Derive properties from a vehicle's numbers without simulating: trim, forces and speeds of the thrusters, time
constants and stability.

The results come from formulas, linear algebra and linear programmes; the simulator is not used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.rigid_body import GZ_SIM_8_11, coriolis, early
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
SYMBOLS = ("u", "v", "w", "p", "q", "r")
COMPONENTS = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
DIRECTIONS = (
    ("ahead", "astern"),
    ("to port", "to starboard"),
    ("up", "down"),
    ("starboard down", "port down"),
    ("bow down", "bow up"),
    ("to port", "to starboard"),
)
"""Names of the positive and the negative direction of each axis in FLU"""

_PRIORITY = (0, 1, 2, 5, 3, 4)
"""Order in which `independent_axes` tests the axes: with too few thrusters, roll or pitch is the first axis that is missing"""


def net_buoyancy(vehicle: VehicleModel) -> float:
    """Return B - W in N; a positive vehicle rises."""
    return float(vehicle.buoyancy - vehicle.weight)


def rank(vehicle: VehicleModel) -> int:
    """Return the rank of the thruster allocation (6, n_u): the number of axes that the thrusters command
    independently.
    """
    return int(np.linalg.matrix_rank(vehicle.allocation))


def independent_axes(vehicle: VehicleModel) -> tuple[int, ...]:
    """Return the indices of the axes that the thrusters command independently of each other, in ascending order."""
    axes: list[int] = []
    for axis in _PRIORITY:
        if np.linalg.matrix_rank(vehicle.allocation[[*axes, axis]]) > len(axes):
            axes.append(axis)
    return tuple(sorted(axes))


@dataclass(frozen=True, slots=True)
class Trim:
    """Attitude at rest without thrust, in the FLU/ENU convention."""

    roll: float  # rad
    pitch: float  # rad, positive = bow down
    moment: float  # N m/rad, restoring stiffness; W BG for a vehicle that is level at rest

    @property
    def determined(self) -> bool:
        """Return False if weight and buoyancy act at the same point, so that every attitude is an equilibrium."""
        return self.moment > 1e-9


def static_trim(vehicle: VehicleModel) -> Trim:
    """Return the stable equilibrium of the restoring moment.

    The moment is (W r_g - B r_b) x d, with d the direction of gravity in the body: at rest d is parallel to
    W r_g - B r_b.
    """
    m = vehicle.weight * vehicle.center_of_gravity - vehicle.buoyancy * vehicle.center_of_buoyancy
    moment = float(np.linalg.norm(m))
    if moment <= 1e-9:
        return Trim(0.0, 0.0, 0.0)
    up = -m / moment  # third row of R: (-sin theta, cos theta sin phi, cos theta cos phi)
    # Adding 0.0 turns a negative zero into a plain one.
    roll, pitch = np.arctan2(up[1], up[2]) + 0.0, -np.arcsin(np.clip(up[0], -1.0, 1.0)) + 0.0
    return Trim(float(roll), float(pitch), moment)


def heel(vehicle: VehicleModel, moment: float) -> float | None:
    """Return the angle in rad from trim at which the righting moment balances `moment` in N m; None if `moment` is too large."""
    righting = static_trim(vehicle).moment
    return float(np.arcsin(moment / righting)) if moment < righting else None


def largest_force(vehicle: VehicleModel, axis: int, sign: float, *, moments: bool = True) -> float:
    """Return the largest force (N) or moment (N m) of the thrusters along one axis only.

    The thrusters' forces and moments along all other axes are zero, except along axes that the thrusters cannot command
    independently: a BlueROV2 cannot surge without a pitching moment. If `moments` is False, only the forces along the
    other two axes must be zero, as in a bollard-pull test.
    """
    from scipy.optimize import linprog

    B = vehicle.allocation
    if B.shape[1] == 0:
        return 0.0
    axes_held = independent_axes(vehicle) if moments else (0, 1, 2)
    free = [other for other in axes_held if other != axis]
    limits = [(float(low), float(high)) for low, high in np.sort(vehicle.force_limits, axis=1)]
    solution = linprog(-sign * B[axis], A_eq=B[free], b_eq=np.zeros(len(free)), bounds=limits)
    return float(max(0.0, sign * (B[axis] @ solution.x))) if solution.success else 0.0


def terminal_speed(force: float, linear: float, quadratic: float) -> float:
    """Return the speed v >= 0 with linear v + quadratic v^2 = force; infinite without damping, zero without force."""
    if force <= 0.0:
        return 0.0
    if quadratic == 0.0:
        return force / linear if linear > 0.0 else float("inf")
    # This form of the root loses no digits if the linear part dominates.
    return 2.0 * force / (linear + float(np.sqrt(linear**2 + 4.0 * quadratic * force)))


def rise_time(mass: float, force: float, linear: float, quadratic: float) -> float:
    """Return the seconds from rest to 1 - 1/e of the terminal speed under a constant force, in closed form.

    The motion is mass v' = force - linear v - quadratic v^2. For quadratic = 0 the result is mass / linear.
    For linear = 0, v is a hyperbolic tangent and the result is 0.745 mass / sqrt(force quadratic).
    """
    if force <= 0.0 or (linear == 0.0 and quadratic == 0.0):
        return float("inf")
    if quadratic == 0.0:
        return mass / linear
    fast = terminal_speed(force, linear, quadratic)
    other = fast + linear / quadratic  # minus the negative root
    v = fast * (1.0 - np.exp(-1.0))
    return float(mass / (quadratic * (fast + other)) * np.log(fast * (v + other) / (other * (fast - v))))


@dataclass(frozen=True, slots=True)
class Reach:
    """Performance of the thrusters along one axis in one direction, for steady motion of the level vehicle."""

    axis: int
    sign: int  # +1 or -1 along the axis in FLU
    force: float  # N or N m, largest force or moment
    speed: float  # m/s or rad/s, terminal speed by thrust alone
    speed_with_buoyancy: (
        float  # m/s, terminal speed by thrust and net buoyancy along heave; equal to `speed` on other axes
    )
    rise_time: float  # s from rest to 63 % of the speed
    bollard_force: float  # N, largest force if moments need not be balanced; equal to `force` for rotations
    bollard_speed: float  # m/s, terminal speed under the bollard force, with the vehicle held straight

    @property
    def direction(self) -> str:
        return DIRECTIONS[self.axis][0 if self.sign > 0 else 1]


def reach(vehicle: VehicleModel) -> list[Reach]:
    """Return the performance in both directions of each axis along which the thrusters have a force."""
    rows = []
    mass = np.diag(vehicle.M)
    for axis in range(6):
        d, q = float(vehicle.linear_damping[axis]), float(vehicle.quadratic_damping[axis])
        for sign in (1, -1):
            force = largest_force(vehicle, axis, sign)
            if force <= 1e-9:
                continue
            bollard = largest_force(vehicle, axis, sign, moments=False) if axis < 3 else force
            lift = sign * net_buoyancy(vehicle) if axis == 2 else 0.0
            rows.append(
                Reach(
                    axis,
                    sign,
                    force,
                    terminal_speed(force, d, q),
                    terminal_speed(force + lift, d, q),
                    rise_time(float(mass[axis]), force, d, q),
                    bollard,
                    terminal_speed(bollard, d, q),
                )
            )
    return rows


def linear_time_constants(vehicle: VehicleModel) -> dict[str, float | None]:
    """Return M_ii / D_ii in s of small motions about rest, by axis; None without linear damping."""
    mass, damping = np.diag(vehicle.M).tolist(), vehicle.linear_damping.tolist()
    return {axis: m / d if d > 0.0 else None for axis, m, d in zip(AXES, mass, damping, strict=True)}


def shortest_time_constant(vehicle: VehicleModel) -> float:
    """Return the shortest time constant of damping in s; infinite without damping.

    The physics step must be short enough for this time constant. The result is one over the largest eigenvalue of
    M^-1 dF/dnu for the damping force F = (D_l + D_q |nu|) nu. Each component of nu is the terminal speed along its axis,
    under the sum of all thrusters' forces, the net buoyancy and the largest righting moment along this axis.
    """
    return _time_constant(vehicle, 1.0, abs(net_buoyancy(vehicle)), static_trim(vehicle).moment)


def shortest_drawn_time_constant(
    vehicle: VehicleModel, drawn: Mapping[str, tuple[float, float]], *, keep_trim: bool = False
) -> float:
    """Return `shortest_time_constant` of the fastest vehicle that a randomisation can draw.

    The time constant is shortest for the lightest masses and the strongest forces: the eigenvalues fall with
    every part of the mass and rise with damping and force.

    Args:
        vehicle: vehicle of the sheet.
        drawn: lowest and highest factor on mass, buoyancy, inertia, added_mass, damping and thrust.
        keep_trim: whether a change of the weight changes the buoyancy by the same force, before the factor on buoyancy applies.
    """
    (light, heavy), (low, high) = drawn["mass"], drawn["buoyancy"]
    corners = []
    for m in (light, heavy):
        lift = vehicle.buoyancy + (m - 1.0) * vehicle.weight if keep_trim else vehicle.buoyancy
        corners += [replace(vehicle, weight=m * vehicle.weight, buoyancy=b * lift) for b in (low, high)]
    extreme = replace(
        vehicle,
        mass=light * vehicle.mass,
        inertia=drawn["inertia"][0] * vehicle.inertia,
        M_A=drawn["added_mass"][0] * vehicle.M_A,
        linear_damping=drawn["damping"][1] * vehicle.linear_damping,
        quadratic_damping=drawn["damping"][1] * vehicle.quadratic_damping,
    )
    return _time_constant(
        extreme,
        drawn["thrust"][1],
        max(abs(net_buoyancy(corner)) for corner in corners),
        max(static_trim(corner).moment for corner in corners),
    )


def _time_constant(vehicle: VehicleModel, thrust: float, lift: float, righting: float) -> float:
    """Return the shortest time constant in s; `thrust` is a factor on the forces, `lift` is in N, `righting` in N m."""
    limits = thrust * np.abs(vehicle.force_limits).max(axis=1)
    largest = np.abs(vehicle.allocation) @ limits
    largest[2] += lift
    largest[3:] += righting
    D_l, D_q = vehicle.linear_damping, vehicle.quadratic_damping
    # With only linear damping, the result does not depend on the speed, which may be infinite.
    speed = [terminal_speed(f, d, q) if q > 0.0 else 0.0 for f, d, q in zip(largest, D_l, D_q, strict=True)]
    fastest = float(np.abs(np.linalg.eigvals(vehicle.M_inverse * (D_l + 2.0 * D_q * speed))).max())
    return 1.0 / fastest if fastest > 0.0 else float("inf")


def free_speed(vehicle: VehicleModel) -> float:
    """Return the speed in m/s at which the level vehicle rises (positive) or sinks without thrust."""
    net = net_buoyancy(vehicle)
    speed = terminal_speed(abs(net), float(vehicle.linear_damping[2]), float(vehicle.quadratic_damping[2]))
    return float(np.copysign(speed, net)) if speed else 0.0


def _linearised(vehicle: VehicleModel, speed: float) -> FloatArray:
    """Return the Jacobian (8, 8) of (roll, pitch, u, v, w, p, q, r) about level motion ahead at `speed` m/s."""
    M_A = vehicle.coriolis_sign * vehicle.M_A
    r_g, r_b = vehicle.center_of_gravity, vehicle.center_of_buoyancy

    def acceleration(x: FloatArray) -> FloatArray:
        phi, theta, nu = x[0], x[1], x[2:]
        up = np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
        restoring = np.concatenate(
            [
                (vehicle.buoyancy - vehicle.weight) * up,
                np.cross(vehicle.buoyancy * r_b - vehicle.weight * r_g, up),
            ]
        )
        damping = (vehicle.linear_damping + vehicle.quadratic_damping * np.abs(nu)) * nu
        wrench = restoring - damping - coriolis(vehicle.M_RB + M_A, nu) @ nu
        if vehicle.plugin == GZ_SIM_8_11:
            wrench = wrench + early(vehicle.M_A, nu)
        return np.asarray(vehicle.M_inverse @ wrench)

    x0 = np.zeros(8)
    x0[2] = speed
    J = np.zeros((8, 8))
    J[0, 5] = J[1, 6] = 1.0  # level: the rates of the angles are p and q
    h = 1e-6
    for k in range(8):
        step = np.zeros(8)
        step[k] = h
        # The central difference cancels the steady thrust. It is valid at nu = 0, where |nu| nu has the slope 0.
        J[2:, k] = (acceleration(x0 + step) - acceleration(x0 - step)) / (2.0 * h)
    return J


@dataclass(frozen=True, slots=True)
class Instability:
    """Instability of straight motion ahead without control, above some speed."""

    plane: str  # pitch (vertical plane) or yaw (horizontal plane)
    above: float  # m/s
    growth: float  # 1/s at top speed, growth rate of a deviation
    speed: float  # m/s, the top speed


_PLANES = {"pitch": [1, 2, 4, 6], "yaw": [0, 3, 5, 7]}
"""Indices of the states of `_linearised` in each plane; with left-right symmetry, the two planes are not coupled"""


def instabilities(vehicle: VehicleModel) -> list[Instability]:
    """Return the instabilities of straight motion ahead, from the eigenvalues of the linearised equations.

    The motion is unstable at speeds at which the Munk moment exceeds the damping and restoring moments.
    """
    rows = [row for row in reach(vehicle) if row.axis == 0 and row.sign > 0]
    if not rows or not np.isfinite(rows[0].speed):
        return []
    top = rows[0].speed

    def growth(speed: float, states: list[int]) -> float:
        return float(np.linalg.eigvals(_linearised(vehicle, speed)[np.ix_(states, states)]).real.max())

    cases = []
    for plane, states in _PLANES.items():
        speeds = np.linspace(0.02, 1.0, 50) * top
        unstable = np.array([growth(speed, states) > 1e-6 for speed in speeds])
        if not unstable[-1]:
            continue
        stable = np.flatnonzero(~unstable)
        low, high = (speeds[stable[-1]], speeds[stable[-1] + 1]) if stable.size else (0.0, speeds[0])
        for _ in range(20):
            middle = (low + high) / 2.0
            low, high = (low, middle) if growth(middle, states) > 1e-6 else (middle, high)
        cases.append(Instability(plane, float(high), growth(top, states), top))
    return cases


def gyration(vehicle: VehicleModel) -> tuple[FloatArray, float]:
    """Return the radii of gyration (3,) in m about the centre of gravity, and the distance of the farthest
    actuator in m.
    """
    radii = np.sqrt(np.diag(vehicle.inertia) / vehicle.mass)
    arms = [np.linalg.norm(unit.position - vehicle.center_of_gravity) for unit in vehicle.units]
    return radii, float(max(arms, default=0.0))
