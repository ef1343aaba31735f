"""Compute the current at each vehicle's depth, the velocity through the water, and the early Gazebo plugin's Coriolis term."""

from __future__ import annotations

from numba import njit

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.lanes import (
    diagonal,
    four,
    put3,
    three,
)
from auvbench.dynamics.layout import (
    LANES,
    Matrix,
    Record,
    Vector,
)
from auvbench.dynamics.vectors import ZERO, add, rotation_matrix, scale, subtract, transposed_product


@inline
def current_velocity(ws: Record, lane: int) -> Vector:
    """Return the current in world axes at the vehicle's depth."""
    current = ws.current
    _, _, z = three(ws.y.position, lane)
    below = (current.top[lane] - z) * current.per_thickness[lane]
    return add(three(current.velocity, lane), scale(min(max(below, 0.0), 1.0), three(current.change, lane)))


@inline
def through_water(ws: Record, lane: int) -> tuple[Matrix, Vector, Vector]:
    """Return R(q), the current v_c in body axes, and v_r = v - v_c (Fossen 2011, section 8.3)."""
    R = rotation_matrix(four(ws.y.attitude, lane))
    v_c = transposed_product(R, current_velocity(ws, lane))
    return R, v_c, subtract(three(ws.y.velocity, lane), v_c)


@njit(nogil=True)
def clear_momenta(ws: Record) -> None:
    """Zero the momenta of M_A's off-diagonal entries, for vehicles without such entries."""
    p, h = ws.extra.p, ws.extra.h
    for lane in range(LANES):
        put3(p, lane, ZERO)
        put3(h, lane, ZERO)


@njit(nogil=True)
def clear_wrench(ws: Record) -> None:
    """Zero the wrench that `runge_kutta_stage` subtracts."""
    force, torque = ws.extra.force, ws.extra.torque
    for lane in range(LANES):
        put3(force, lane, ZERO)
        put3(torque, lane, ZERO)


@njit(nogil=True)
def put_early(ws: Record) -> None:
    """Write `rigid_body.early` of each vehicle to the wrench that `runge_kutta_stage` subtracts."""
    force, torque = ws.extra.force, ws.extra.torque
    for lane in range(LANES):
        _, _, (u, v, w) = through_water(ws, lane)
        _, _, r = three(ws.y.rates, lane)
        # M_A_coriolis is -M_A here, which gives the subtracted wrench its sign.
        _, A_22, A_33 = diagonal(ws.vehicle.M_A_coriolis.M11, lane)
        put3(force, lane, (2.0 * (A_22 * v) * r, 0.0, 0.0))
        put3(torque, lane, (0.0, 0.0, -(A_22 * v + A_33 * w) * u))
