"""Fossen's equations of motion in 6 degrees of freedom, as one stage of Runge-Kutta over a block of vehicles.

    M_RB nu' + C_RB(nu) nu + M_A (nu' - nu_c') + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau
    eta' = J(eta) nu

with nu_r = nu - nu_c and, for a current that is constant in the world, nu_c' = [-omega x v_c; 0] in body axes
(Fossen 2011, chapters 3, 4, 6 and section 8.3). Both Coriolis terms are evaluated through momenta: with linear
momentum p and angular momentum h, C(nu) nu = [omega x p; v x p + omega x h] (theorem 3.2). Attitude is a unit
quaternion (w, x, y, z), body to world, renormalised after each step. The inverse of M_RB + M_A is computed
once per parameter set, so added mass is implicit.

`docs/physics.md` lists what is neglected; `layout.py` declares the records.
"""

from __future__ import annotations

from numba import njit

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.lanes import (
    add3,
    add4,
    diagonal,
    four,
    matrix,
    off_diagonal,
    put3,
    put4,
    symmetric,
    three,
)
from auvbench.dynamics.layout import (
    LANES,
    Quaternion,
    Record,
    Rows,
    Vector,
)
from auvbench.dynamics.vectors import (
    absolute,
    add,
    add_quaternions,
    cross,
    hollow_product,
    plus_hollow_product,
    plus_product,
    product,
    quaternion_rate,
    scale,
    scale_quaternion,
    subtract,
    times,
    transposed_product,
    up_axis,
)
from auvbench.dynamics.water import through_water


@inline
def damping(linear: Rows, quadratic: Rows, lane: int, v: Vector) -> Vector:
    """Return D(v) v = (D + D_n |v|) v of three degrees of freedom (Fossen 2011, chapter 6)."""
    D, D_n = three(linear, lane), three(quadratic, lane)
    return times(add(D, times(D_n, absolute(v))), v)


@inline
def rigid_body_momentum(vehicle: Record, lane: int, v: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """Return M_RB nu = [p; h]: p = m v + omega x m r_g, h = m r_g x v + I_o omega (Fossen 2011, eq. 3.44)."""
    m_r_g = three(vehicle.m_r_g, lane)
    p = add(scale(vehicle.m[lane], v), cross(omega, m_r_g))
    return p, plus_product(cross(m_r_g, v), symmetric(vehicle.I_o, lane), omega)


@inline
def minus_coriolis(
    force: Vector, torque: Vector, v: Vector, p: Vector, v_r: Vector, p_A: Vector, omega: Vector, h: Vector
) -> tuple[Vector, Vector]:
    """Return [force; torque] - C_RB(nu) nu - C_A(nu_r) nu_r, each C nu = [omega x p; v x p + omega x h] (theorem 3.2).

    `h` is the sum of both angular momenta.
    """
    force = subtract(force, cross(omega, add(p, p_A)))
    torque = subtract(subtract(subtract(torque, cross(v, p)), cross(v_r, p_A)), cross(omega, h))
    return force, torque


@inline
def restoring(vehicle: Record, lane: int, up: Vector) -> tuple[Vector, Vector]:
    """Return -g(eta) = [(B - W) up; (B r_b - W r_g) x up] with `up` the world's z axis (Fossen 2011, chapter 4)."""
    return scale(vehicle.B_minus_W[lane], up), cross(three(vehicle.lever, lane), up)


@inline
def acceleration(vehicle: Record, lane: int, force: Vector, torque: Vector) -> tuple[Vector, Vector]:
    """Return nu' = (M_RB + M_A)^-1 [force; torque]."""
    inverse = vehicle.M_inverse
    M12 = matrix(inverse.M12, lane)
    v_dot = plus_product(product(symmetric(inverse.M11, lane), force), M12, torque)
    omega_dot = plus_product(transposed_product(M12, force), symmetric(inverse.M22, lane), torque)
    return v_dot, omega_dot


@inline
def integrate(x: Rows, y: Rows, s: Rows, lane: int, rate: Vector, weight: float, ahead: float) -> None:
    """Add `weight` rate to the sum s of the stages, and put the next stage y at x + `ahead` rate."""
    add3(s, lane, scale(weight, rate))
    put3(y, lane, add(three(x, lane), scale(ahead, rate)))


@inline
def integrate_attitude(
    x: Rows, y: Rows, s: Rows, lane: int, rate: Quaternion, weight: float, ahead: float
) -> None:
    """Do as `integrate` with a quaternion."""
    add4(s, lane, scale_quaternion(weight, rate))
    put4(y, lane, add_quaternions(four(x, lane), scale_quaternion(ahead, rate)))


@njit(nogil=True)
def runge_kutta_stage(ws: Record, weight: float, ahead: float, full: bool) -> None:
    """Compute k = [eta'; nu'] at y for each vehicle of the block; then s += weight k and y = x + ahead k.

    A single loop: cut in two, what passes between the halves would go through memory. With `full`, `ws.extra` adds the terms of
    off-diagonal added mass, of Gazebo's early plugin and of waves.
    """
    x, y, s, vehicle, tau, extra = ws.x, ws.y, ws.s, ws.vehicle, ws.tau, ws.extra
    for lane in range(LANES):
        q, v, omega = four(y.attitude, lane), three(y.velocity, lane), three(y.rates, lane)
        R, v_c, v_r = through_water(ws, lane)

        # M_RB nu = [p; h]; M_A nu_r = [p_A; h_A], here of the diagonal of M_A; h becomes h + h_A.
        p, h = rigid_body_momentum(vehicle, lane, v, omega)
        p_A = times(diagonal(vehicle.C_A.M11, lane), v_r)
        h = add(h, times(diagonal(vehicle.C_A.M22, lane), omega))
        # -M_A nu_c' with nu_c' = [-omega x v_c; 0].
        water_inertia = times(diagonal(vehicle.M_A.M11, lane), cross(omega, v_c))
        force, torque = three(tau.force, lane), three(tau.torque, lane)
        if full:
            p_A = add(p_A, three(extra.p, lane))
            h = add(h, three(extra.h, lane))
            water_inertia = add(water_inertia, three(extra.force, lane))
            torque = subtract(torque, three(extra.torque, lane))

        # tau - C_RB(nu) nu - C_A(nu_r) nu_r + M_A nu_c' - g(eta) - D(nu_r) nu_r = (M_RB + M_A) nu'
        force, torque = minus_coriolis(force, torque, v, p, v_r, p_A, omega, h)
        force = subtract(force, water_inertia)
        weight_and_buoyancy, righting_moment = restoring(vehicle, lane, up_axis(R))
        force, torque = add(force, weight_and_buoyancy), add(torque, righting_moment)
        force = subtract(force, damping(vehicle.D.linear, vehicle.D_n.linear, lane, v_r))
        torque = subtract(torque, damping(vehicle.D.angular, vehicle.D_n.angular, lane, omega))
        v_dot, omega_dot = acceleration(vehicle, lane, force, torque)

        integrate(x.position, y.position, s.position, lane, product(R, v), weight, ahead)
        integrate_attitude(x.attitude, y.attitude, s.attitude, lane, quaternion_rate(q, omega), weight, ahead)
        integrate(x.velocity, y.velocity, s.velocity, lane, v_dot, weight, ahead)
        integrate(x.rates, y.rates, s.rates, lane, omega_dot, weight, ahead)


@njit(nogil=True)
def put_off_diagonal(ws: Record) -> None:
    """Write to `ws.extra` the terms of the entries of M_A off its diagonal, for vehicles that have any."""
    C_A, M_A, extra = ws.vehicle.C_A, ws.vehicle.M_A, ws.extra
    for lane in range(LANES):
        omega = three(ws.y.rates, lane)
        _, v_c, v_r = through_water(ws, lane)
        M12 = matrix(C_A.M12, lane)
        p_A = plus_product(hollow_product(off_diagonal(C_A.M11, lane), v_r), M12, omega)
        h_A = plus_hollow_product(transposed_product(M12, v_r), off_diagonal(C_A.M22, lane), omega)
        put3(extra.p, lane, p_A)
        put3(extra.h, lane, h_A)
        turning = cross(omega, v_c)
        put3(extra.force, lane, hollow_product(off_diagonal(M_A.M11, lane), turning))
        put3(extra.torque, lane, transposed_product(matrix(M_A.M12, lane), turning))
