"""Actuators as plain functions of time and state, for the reference integration."""

from __future__ import annotations

import numpy as np
from scipy.signal import StateSpace, TransferFunction, lsim

from .fossen import Array, rotation


def wrench_at(position: Array, force: Array) -> Array:
    """The wrench (6,) at CO of a force (3,) that acts at `position` (3,)."""
    return np.concatenate([force, np.cross(position, force)])


def rotor_thrust(k_t: float, rho: float, D: float, omega: float) -> float:
    """F = k_T rho D^4 omega |omega|, omega in rad/s (Gazebo's Thruster; Fossen 2011, eq. 9.7 in other units)."""
    return k_t * rho * D**4 * omega * abs(omega)


def von_benzon_curve(V: Array) -> Array:
    """N at a normalised command, before its lag (von Benzon et al. 2022, eq. 18)."""
    return -140.3 * V**9 + 389.9 * V**7 - 404.1 * V**5 + 176.0 * V**3 + 8.9 * V


def von_benzon_lag(force: Array, times: Array) -> Array:
    """The thruster's force (T,) at `times` for a commanded force (T,), held linear between them."""
    K = TransferFunction([6136, 108700], [1, 89, 9258, 108700])
    return np.asarray(lsim(StateSpace(K), force, times)[1])


def lift_and_drag(
    velocity: Array,
    forward: Array,
    upward: Array,
    *,
    rho: float,
    area: float,
    cla: float,
    cla_stall: float,
    cda: float,
    cda_stall: float,
    alpha_stall: float,
    a0: float = 0.0,
) -> Array:
    """Force (3,) on a thin foil that moves at `velocity` (3,) through the water (gz-sim, LiftDrag).

    `forward` is the chord's direction of motion and `upward` the direction of positive lift at alpha > 0.
    """
    span = np.cross(forward, upward)
    in_plane = velocity - (velocity @ span) * span
    speed = np.linalg.norm(in_plane)
    if speed == 0:
        return np.zeros(3)
    drag_direction = -in_plane / speed
    lift_direction = np.cross(span, in_plane) / speed
    alpha = a0 + np.arctan2(-(in_plane @ upward), in_plane @ forward)
    # The foil is the same from both sides of its chord: fold the angle into a quarter turn.
    alpha = (alpha + np.pi / 2) % np.pi - np.pi / 2
    beyond = max(0.0, abs(alpha) - alpha_stall)
    within = min(abs(alpha), alpha_stall)
    c_l = np.sign(alpha) * max(0.0, cla * within + cla_stall * beyond)
    c_d = abs(cda * within + cda_stall * beyond)
    sweep = 1 - (velocity @ span) ** 2 / (velocity @ velocity)
    q = 0.5 * rho * speed**2 * area * sweep
    return np.asarray(q * (c_l * lift_direction + c_d * drag_direction))


TETHYS = {
    "area": 0.0244,
    "cla": 4.13,
    "cla_stall": -1.1,
    "cda": 0.2,
    "cda_stall": 0.03,
    "alpha_stall": 0.17,
    "rho": 1025.0,
}
"""The fins of osrf/lrauv."""


def tethys(
    omega: float = 0.0,
    rudder: float = 0.0,
    elevator: float = 0.0,
    engine: float = 0.0,
    *,
    nu: Array,
    q: Array,
    current: Array | None = None,
    g: float = 9.8,
) -> Array:
    """Wrench (6,) of the LRAUV's actuators in FLU with the nose along +x.

    omega rad/s; rudder and elevator rad, positive about z and y of the body; engine m3 above neutral.
    """
    nu_1 = nu[:3] - (0 if current is None else rotation(q).T @ current)
    tau = wrench_at(
        np.array([-1.43162, 0, 0]), np.array([rotor_thrust(0.004312328425753156, 1025, 0.2, omega), 0, 0])
    )
    fin = np.array([-1.05, 0, 0])
    velocity = nu_1 + np.cross(nu[3:], fin)
    c, s = np.cos(rudder), np.sin(rudder)
    tau = tau + wrench_at(fin, lift_and_drag(velocity, np.array([c, s, 0]), np.array([-s, c, 0]), **TETHYS))
    c, s = np.cos(elevator), np.sin(elevator)
    tau = tau + wrench_at(fin, lift_and_drag(velocity, np.array([c, 0, -s]), np.array([s, 0, c]), **TETHYS))
    up = rotation(q).T @ np.array([0, 0, g * 1025 * engine])
    return tau + wrench_at(np.array([-0.137, 0, 0]), up)
