"""Fossen's equations of motion in 6 degrees of freedom, as one stage of Runge-Kutta over a block of vehicles.

    M_RB nu' + C_RB(nu) nu + M_A (nu' - nu_c') + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau
    eta' = J(eta) nu

with nu_r = nu - nu_c and, for a current that is constant in the world, nu_c' = [-omega x v_c; 0] in body axes (Fossen 2011, chapters
3, 4, 6 and section 8.3); nu_c' leaves out the gradient of a current over depth. tau is the wrench of thrusters, appendages and
external causes. Both Coriolis terms are computed from momenta: with linear momentum p and angular momentum h, C(nu) nu =
[omega x p; v x p + omega x h] (Fossen 2011, theorem 3.2). The inverse of M_RB + M_A is computed once for each set of parameters.

    in the code     in Fossen's book
    v, omega        nu = [v; omega] = (u, v, w; p, q, r), body axes forward, port, up
    v_c, v_r        a current has no rotation: nu_c = [v_c; 0], nu_r = [v - v_c; omega]
    m_r_g, I_b      m r_g and the inertia about the origin CO
    p, h            momenta [p; h] = M nu
    up              the world's z axis in body axes, R^T [0; 0; 1]; Fossen's points down
    share, ahead    Runge-Kutta: b_i h of this stage, and the time from the substep's start to the next stage

Attitude is a quaternion (w, x, y, z), body to world. It has length 1 at the start of each substep; it is not normalised at the stages.

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
    """Return (D + D_n(v)) v for three degrees of freedom, with D_n(v) = diag(D_n |v|) (Fossen 2011, chapter 6)."""
    D, D_n = three(linear, lane), three(quadratic, lane)
    return times(add(D, times(D_n, absolute(v))), v)


@inline
def rigid_body_momentum(vehicle: Record, lane: int, v: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """Return M_RB nu = [p; h]: p = m v + omega x m r_g, h = m r_g x v + I_b omega (Fossen 2011, eq. 3.44)."""
    m_r_g = three(vehicle.m_r_g, lane)
    p = add(scale(vehicle.m[lane], v), cross(omega, m_r_g))
    return p, plus_product(cross(m_r_g, v), symmetric(vehicle.I_b, lane), omega)


@inline
def minus_coriolis(
    force: Vector, torque: Vector, v: Vector, p: Vector, v_r: Vector, p_A: Vector, omega: Vector, h: Vector
) -> tuple[Vector, Vector]:
    """Return [force; torque] - C_RB(nu) nu - C_A(nu_r) nu_r, each C nu = [omega x p; v x p + omega x h].

    `h` is the sum of the angular momenta of M_RB and M_A. -v_r x p_A is the Munk moment, which turns a slender hull across the flow.
    """
    force = subtract(force, cross(omega, add(p, p_A)))
    torque = subtract(subtract(subtract(torque, cross(v, p)), cross(v_r, p_A)), cross(omega, h))
    return force, torque


@inline
def restoring(vehicle: Record, lane: int, up: Vector) -> tuple[Vector, Vector]:
    """Return -g(eta) = [(B - W) up; (B r_b - W r_g) x up] with `up` the world's z axis (Fossen 2011, chapter 4)."""
    return scale(vehicle.B_minus_W[lane], up), cross(three(vehicle.B_r_b_minus_W_r_g, lane), up)


@inline
def acceleration(vehicle: Record, lane: int, force: Vector, torque: Vector) -> tuple[Vector, Vector]:
    """Return nu' = (M_RB + M_A)^-1 [force; torque]."""
    inverse = vehicle.M_inverse
    M12 = matrix(inverse.M12, lane)
    v_dot = plus_product(product(symmetric(inverse.M11, lane), force), M12, torque)
    omega_dot = plus_product(transposed_product(M12, force), symmetric(inverse.M22, lane), torque)
    return v_dot, omega_dot


@inline
def integrate(x: Rows, y: Rows, s: Rows, lane: int, rate: Vector, share: float, ahead: float) -> None:
    """Do s += share rate, the sum over the stages, and y = x + ahead rate, the state at the next stage."""
    add3(s, lane, scale(share, rate))
    put3(y, lane, add(three(x, lane), scale(ahead, rate)))


@inline
def integrate_attitude(
    x: Rows, y: Rows, s: Rows, lane: int, rate: Quaternion, share: float, ahead: float
) -> None:
    """Do the same as `integrate`, for a quaternion."""
    add4(s, lane, scale_quaternion(share, rate))
    put4(y, lane, add_quaternions(four(x, lane), scale_quaternion(ahead, rate)))


@njit(nogil=True)
def runge_kutta_stage(ws: Record, share: float, ahead: float, with_extra: bool) -> None:
    """Compute k = [eta'; nu'] at y for each vehicle of the block; then s += share k and y = x + ahead k.

    One loop is faster than two, which would pass values through memory. With `with_extra`, `ws.extra` adds the terms of
    off-diagonal added mass, of Gazebo's early plugin and of waves.
    """
    x, y, s, vehicle, tau, extra = ws.x, ws.y, ws.s, ws.vehicle, ws.tau, ws.extra
    for lane in range(LANES):
        q, v, omega = four(y.attitude, lane), three(y.velocity, lane), three(y.rates, lane)
        R, v_c, v_r = through_water(ws, lane)

        # M_RB nu = [p; h], M_A nu_r = [p_A; h_A], here only with the diagonal of M_A. Then h is increased by h_A.
        p, h = rigid_body_momentum(vehicle, lane, v, omega)
        p_A = times(diagonal(vehicle.M_A_coriolis.M11, lane), v_r)
        h = add(h, times(diagonal(vehicle.M_A_coriolis.M22, lane), omega))
        # -M_A nu_c' with nu_c' = [-omega x v_c; 0]: it is subtracted below.
        water_inertia = times(diagonal(vehicle.M_A.M11, lane), cross(omega, v_c))
        force, torque = three(tau.force, lane), three(tau.torque, lane)
        if with_extra:
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

        integrate(x.position, y.position, s.position, lane, product(R, v), share, ahead)
        integrate_attitude(x.attitude, y.attitude, s.attitude, lane, quaternion_rate(q, omega), share, ahead)
        integrate(x.velocity, y.velocity, s.velocity, lane, v_dot, share, ahead)
        integrate(x.rates, y.rates, s.rates, lane, omega_dot, share, ahead)


@njit(nogil=True)
def put_off_diagonal(ws: Record) -> None:
    """Write the terms of M_A's off-diagonal entries to `ws.extra`, for vehicles with such entries."""
    M_A_coriolis, M_A, extra = ws.vehicle.M_A_coriolis, ws.vehicle.M_A, ws.extra
    for lane in range(LANES):
        omega = three(ws.y.rates, lane)
        _, v_c, v_r = through_water(ws, lane)
        M12 = matrix(M_A_coriolis.M12, lane)
        p_A = plus_product(hollow_product(off_diagonal(M_A_coriolis.M11, lane), v_r), M12, omega)
        h_A = plus_hollow_product(transposed_product(M12, v_r), off_diagonal(M_A_coriolis.M22, lane), omega)
        put3(extra.p, lane, p_A)
        put3(extra.h, lane, h_A)
        turning = cross(omega, v_c)
        put3(extra.force, lane, hollow_product(off_diagonal(M_A.M11, lane), turning))
        put3(extra.torque, lane, transposed_product(matrix(M_A.M12, lane), turning))
