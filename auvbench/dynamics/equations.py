# ruff: noqa: E741  (l is the lane, as in the layout)
"""Fossen's equations of motion in 6 degrees of freedom, as one stage of Runge-Kutta over a block of vehicles.

    M_RB nu' + C_RB(nu) nu + M_A (nu' - nu_c') + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau
    eta' = J(eta) nu

with nu_r = nu - nu_c and, for a current that is constant in the world, nu_c' = [-omega x v_c; 0] in body axes
(Fossen 2011, chapters 3, 4, 6 and section 8.3). Both Coriolis terms are evaluated through momenta: with linear
momentum p and angular momentum h, C(nu) nu = [omega x p; v x p + omega x h] (theorem 3.2). Attitude is a unit
quaternion (w, x, y, z), body to world, renormalised after each step. The inverse of M_RB + M_A is computed
once per parameter set, so added mass is implicit.

`docs/physics.md` lists what is neglected; `layout.py` says what lies where in the workspace.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import (
    ADDED,
    ADDED_OFF,
    CORIOLIS,
    CORIOLIS_OFF,
    CURRENT,
    EXTRA,
    INERTIA,
    INVERSE,
    LANES,
    LEVER,
    LINEAR,
    MASS,
    MOMENT,
    NET,
    QUADRATIC,
    TAU,
    S,
    X,
    Y,
)

FloatArray = NDArray[np.float64]
L = LANES


@njit(nogil=True)
def off_diagonal(ws: FloatArray) -> None:
    """Momentum and current terms of the off-diagonal added mass, for vehicles that have any."""
    for l in range(L):
        qw = ws[(Y + 3) * L + l]
        qx = ws[(Y + 4) * L + l]
        qy = ws[(Y + 5) * L + l]
        qz = ws[(Y + 6) * L + l]
        p = ws[(Y + 10) * L + l]
        q = ws[(Y + 11) * L + l]
        r = ws[(Y + 12) * L + l]
        depth = (ws[(CURRENT + 6) * L + l] - ws[(Y + 2) * L + l]) * ws[(CURRENT + 7) * L + l]
        s = min(max(depth, 0.0), 1.0)
        cx = ws[CURRENT * L + l] + s * ws[(CURRENT + 3) * L + l]
        cy = ws[(CURRENT + 1) * L + l] + s * ws[(CURRENT + 4) * L + l]
        cz = ws[(CURRENT + 2) * L + l] + s * ws[(CURRENT + 5) * L + l]
        cu = (
            (1.0 - 2.0 * (qy * qy + qz * qz)) * cx
            + 2.0 * (qx * qy + qw * qz) * cy
            + 2.0 * (qx * qz - qw * qy) * cz
        )
        cv = (
            2.0 * (qx * qy - qw * qz) * cx
            + (1.0 - 2.0 * (qx * qx + qz * qz)) * cy
            + 2.0 * (qy * qz + qw * qx) * cz
        )
        cw = (
            2.0 * (qx * qz + qw * qy) * cx
            + 2.0 * (qy * qz - qw * qx) * cy
            + (1.0 - 2.0 * (qx * qx + qy * qy)) * cz
        )
        u = ws[(Y + 7) * L + l] - cu
        v = ws[(Y + 8) * L + l] - cv
        w = ws[(Y + 9) * L + l] - cw
        C = CORIOLIS_OFF
        ws[(EXTRA + 0) * L + l] = (
            ws[C * L + l] * v + ws[(C + 1) * L + l] * w
            + ws[(C + 2) * L + l] * p + ws[(C + 3) * L + l] * q + ws[(C + 4) * L + l] * r
        )  # fmt: skip
        ws[(EXTRA + 1) * L + l] = (
            ws[C * L + l] * u + ws[(C + 5) * L + l] * w
            + ws[(C + 6) * L + l] * p + ws[(C + 7) * L + l] * q + ws[(C + 8) * L + l] * r
        )  # fmt: skip
        ws[(EXTRA + 2) * L + l] = (
            ws[(C + 1) * L + l] * u + ws[(C + 5) * L + l] * v
            + ws[(C + 9) * L + l] * p + ws[(C + 10) * L + l] * q + ws[(C + 11) * L + l] * r
        )  # fmt: skip
        ws[(EXTRA + 3) * L + l] = (
            ws[(C + 2) * L + l] * u + ws[(C + 6) * L + l] * v + ws[(C + 9) * L + l] * w
            + ws[(C + 12) * L + l] * q + ws[(C + 13) * L + l] * r
        )  # fmt: skip
        ws[(EXTRA + 4) * L + l] = (
            ws[(C + 3) * L + l] * u + ws[(C + 7) * L + l] * v + ws[(C + 10) * L + l] * w
            + ws[(C + 12) * L + l] * p + ws[(C + 14) * L + l] * r
        )  # fmt: skip
        ws[(EXTRA + 5) * L + l] = (
            ws[(C + 4) * L + l] * u + ws[(C + 8) * L + l] * v + ws[(C + 11) * L + l] * w
            + ws[(C + 13) * L + l] * p + ws[(C + 14) * L + l] * q
        )  # fmt: skip
        ax = q * cw - r * cv
        ay = r * cu - p * cw
        az = p * cv - q * cu
        A = ADDED_OFF
        ws[(EXTRA + 6) * L + l] = ws[A * L + l] * ay + ws[(A + 1) * L + l] * az
        ws[(EXTRA + 7) * L + l] = ws[A * L + l] * ax + ws[(A + 5) * L + l] * az
        ws[(EXTRA + 8) * L + l] = ws[(A + 1) * L + l] * ax + ws[(A + 5) * L + l] * ay
        ws[(EXTRA + 9) * L + l] = (
            ws[(A + 2) * L + l] * ax + ws[(A + 6) * L + l] * ay + ws[(A + 9) * L + l] * az
        )
        ws[(EXTRA + 10) * L + l] = (
            ws[(A + 3) * L + l] * ax + ws[(A + 7) * L + l] * ay + ws[(A + 10) * L + l] * az
        )
        ws[(EXTRA + 11) * L + l] = (
            ws[(A + 4) * L + l] * ax + ws[(A + 8) * L + l] * ay + ws[(A + 11) * L + l] * az
        )


@njit(nogil=True)
def runge_kutta_stage(ws: FloatArray, weight: float, ahead: float, full: bool) -> None:
    """One Runge-Kutta stage: k = f(Y), then S += weight k and Y = X + ahead k.

    A single loop, long as it is: cut in two, what passes between the halves would go through memory.
    """
    for l in range(L):
        qw = ws[(Y + 3) * L + l]
        qx = ws[(Y + 4) * L + l]
        qy = ws[(Y + 5) * L + l]
        qz = ws[(Y + 6) * L + l]
        u = ws[(Y + 7) * L + l]
        v = ws[(Y + 8) * L + l]
        w = ws[(Y + 9) * L + l]
        p = ws[(Y + 10) * L + l]
        q = ws[(Y + 11) * L + l]
        r = ws[(Y + 12) * L + l]

        # Rotation matrix, body to world.
        r00 = 1.0 - 2.0 * (qy * qy + qz * qz)
        r01 = 2.0 * (qx * qy - qw * qz)
        r02 = 2.0 * (qx * qz + qw * qy)
        r10 = 2.0 * (qx * qy + qw * qz)
        r11 = 1.0 - 2.0 * (qx * qx + qz * qz)
        r12 = 2.0 * (qy * qz - qw * qx)
        r20 = 2.0 * (qx * qz - qw * qy)
        r21 = 2.0 * (qy * qz + qw * qx)
        r22 = 1.0 - 2.0 * (qx * qx + qy * qy)

        # Current at this depth, in body axes, and velocity through the water.
        depth = (ws[(CURRENT + 6) * L + l] - ws[(Y + 2) * L + l]) * ws[(CURRENT + 7) * L + l]
        s = min(max(depth, 0.0), 1.0)
        cx = ws[CURRENT * L + l] + s * ws[(CURRENT + 3) * L + l]
        cy = ws[(CURRENT + 1) * L + l] + s * ws[(CURRENT + 4) * L + l]
        cz = ws[(CURRENT + 2) * L + l] + s * ws[(CURRENT + 5) * L + l]
        cu = r00 * cx + r10 * cy + r20 * cz
        cv = r01 * cx + r11 * cy + r21 * cz
        cw = r02 * cx + r12 * cy + r22 * cz
        ur = u - cu
        vr = v - cv
        wr = w - cw

        # Momenta of the rigid body and of the added mass.
        m = ws[MASS * L + l]
        gx = ws[MOMENT * L + l]
        gy = ws[(MOMENT + 1) * L + l]
        gz = ws[(MOMENT + 2) * L + l]
        px = m * u + (q * gz - r * gy)
        py = m * v + (r * gx - p * gz)
        pz = m * w + (p * gy - q * gx)
        ixy = ws[(INERTIA + 3) * L + l]
        ixz = ws[(INERTIA + 4) * L + l]
        iyz = ws[(INERTIA + 5) * L + l]
        hx = (gy * w - gz * v) + ws[INERTIA * L + l] * p + ixy * q + ixz * r
        hy = (gz * u - gx * w) + ixy * p + ws[(INERTIA + 1) * L + l] * q + iyz * r
        hz = (gx * v - gy * u) + ixz * p + iyz * q + ws[(INERTIA + 2) * L + l] * r
        ax = ws[CORIOLIS * L + l] * ur
        ay = ws[(CORIOLIS + 1) * L + l] * vr
        az = ws[(CORIOLIS + 2) * L + l] * wr
        hx += ws[(CORIOLIS + 3) * L + l] * p
        hy += ws[(CORIOLIS + 4) * L + l] * q
        hz += ws[(CORIOLIS + 5) * L + l] * r
        # Acceleration of the fluid seen from the body, -omega x v_c, times the added mass.
        bx = ws[ADDED * L + l] * (q * cw - r * cv)
        by = ws[(ADDED + 1) * L + l] * (r * cu - p * cw)
        bz = ws[(ADDED + 2) * L + l] * (p * cv - q * cu)
        tx = ws[(TAU + 3) * L + l]
        ty = ws[(TAU + 4) * L + l]
        tz = ws[(TAU + 5) * L + l]
        if full:
            ax += ws[EXTRA * L + l]
            ay += ws[(EXTRA + 1) * L + l]
            az += ws[(EXTRA + 2) * L + l]
            hx += ws[(EXTRA + 3) * L + l]
            hy += ws[(EXTRA + 4) * L + l]
            hz += ws[(EXTRA + 5) * L + l]
            bx += ws[(EXTRA + 6) * L + l]
            by += ws[(EXTRA + 7) * L + l]
            bz += ws[(EXTRA + 8) * L + l]
            tx -= ws[(EXTRA + 9) * L + l]
            ty -= ws[(EXTRA + 10) * L + l]
            tz -= ws[(EXTRA + 11) * L + l]
        sx = px + ax
        sy = py + ay
        sz = pz + az

        # Forces and moments.
        net = ws[NET * L + l]
        lx = ws[LEVER * L + l]
        ly = ws[(LEVER + 1) * L + l]
        lz = ws[(LEVER + 2) * L + l]
        f0 = (
            ws[TAU * L + l] - (q * sz - r * sy) - bx + net * r20
            - (ws[LINEAR * L + l] + ws[QUADRATIC * L + l] * abs(ur)) * ur
        )  # fmt: skip
        f1 = (
            ws[(TAU + 1) * L + l] - (r * sx - p * sz) - by + net * r21
            - (ws[(LINEAR + 1) * L + l] + ws[(QUADRATIC + 1) * L + l] * abs(vr)) * vr
        )  # fmt: skip
        f2 = (
            ws[(TAU + 2) * L + l] - (p * sy - q * sx) - bz + net * r22
            - (ws[(LINEAR + 2) * L + l] + ws[(QUADRATIC + 2) * L + l] * abs(wr)) * wr
        )  # fmt: skip
        f3 = (
            tx - (v * pz - w * py) - (vr * az - wr * ay) - (q * hz - r * hy) + (ly * r22 - lz * r21)
            - (ws[(LINEAR + 3) * L + l] + ws[(QUADRATIC + 3) * L + l] * abs(p)) * p
        )  # fmt: skip
        f4 = (
            ty - (w * px - u * pz) - (wr * ax - ur * az) - (r * hx - p * hz) + (lz * r20 - lx * r22)
            - (ws[(LINEAR + 4) * L + l] + ws[(QUADRATIC + 4) * L + l] * abs(q)) * q
        )  # fmt: skip
        f5 = (
            tz - (u * py - v * px) - (ur * ay - vr * ax) - (p * hy - q * hx) + (lx * r21 - ly * r20)
            - (ws[(LINEAR + 5) * L + l] + ws[(QUADRATIC + 5) * L + l] * abs(r)) * r
        )  # fmt: skip

        # Kinematics (Fossen 2011, chapter 2; the rotation matrix above is eq. 2.65).
        k = r00 * u + r01 * v + r02 * w
        ws[S * L + l] += weight * k
        ws[Y * L + l] = ws[X * L + l] + ahead * k
        k = r10 * u + r11 * v + r12 * w
        ws[(S + 1) * L + l] += weight * k
        ws[(Y + 1) * L + l] = ws[(X + 1) * L + l] + ahead * k
        k = r20 * u + r21 * v + r22 * w
        ws[(S + 2) * L + l] += weight * k
        ws[(Y + 2) * L + l] = ws[(X + 2) * L + l] + ahead * k
        k = -0.5 * (qx * p + qy * q + qz * r)
        ws[(S + 3) * L + l] += weight * k
        ws[(Y + 3) * L + l] = ws[(X + 3) * L + l] + ahead * k
        k = 0.5 * (qw * p + qy * r - qz * q)
        ws[(S + 4) * L + l] += weight * k
        ws[(Y + 4) * L + l] = ws[(X + 4) * L + l] + ahead * k
        k = 0.5 * (qw * q + qz * p - qx * r)
        ws[(S + 5) * L + l] += weight * k
        ws[(Y + 5) * L + l] = ws[(X + 5) * L + l] + ahead * k
        k = 0.5 * (qw * r + qx * q - qy * p)
        ws[(S + 6) * L + l] += weight * k
        ws[(Y + 6) * L + l] = ws[(X + 6) * L + l] + ahead * k

        # nu' = M^-1 f, from the upper triangle of the symmetric inverse.
        I = INVERSE
        k = (
            ws[I * L + l] * f0 + ws[(I + 1) * L + l] * f1 + ws[(I + 2) * L + l] * f2
            + ws[(I + 3) * L + l] * f3 + ws[(I + 4) * L + l] * f4 + ws[(I + 5) * L + l] * f5
        )  # fmt: skip
        ws[(S + 7) * L + l] += weight * k
        ws[(Y + 7) * L + l] = ws[(X + 7) * L + l] + ahead * k
        k = (
            ws[(I + 1) * L + l] * f0 + ws[(I + 6) * L + l] * f1 + ws[(I + 7) * L + l] * f2
            + ws[(I + 8) * L + l] * f3 + ws[(I + 9) * L + l] * f4 + ws[(I + 10) * L + l] * f5
        )  # fmt: skip
        ws[(S + 8) * L + l] += weight * k
        ws[(Y + 8) * L + l] = ws[(X + 8) * L + l] + ahead * k
        k = (
            ws[(I + 2) * L + l] * f0 + ws[(I + 7) * L + l] * f1 + ws[(I + 11) * L + l] * f2
            + ws[(I + 12) * L + l] * f3 + ws[(I + 13) * L + l] * f4 + ws[(I + 14) * L + l] * f5
        )  # fmt: skip
        ws[(S + 9) * L + l] += weight * k
        ws[(Y + 9) * L + l] = ws[(X + 9) * L + l] + ahead * k
        k = (
            ws[(I + 3) * L + l] * f0 + ws[(I + 8) * L + l] * f1 + ws[(I + 12) * L + l] * f2
            + ws[(I + 15) * L + l] * f3 + ws[(I + 16) * L + l] * f4 + ws[(I + 17) * L + l] * f5
        )  # fmt: skip
        ws[(S + 10) * L + l] += weight * k
        ws[(Y + 10) * L + l] = ws[(X + 10) * L + l] + ahead * k
        k = (
            ws[(I + 4) * L + l] * f0 + ws[(I + 9) * L + l] * f1 + ws[(I + 13) * L + l] * f2
            + ws[(I + 16) * L + l] * f3 + ws[(I + 18) * L + l] * f4 + ws[(I + 19) * L + l] * f5
        )  # fmt: skip
        ws[(S + 11) * L + l] += weight * k
        ws[(Y + 11) * L + l] = ws[(X + 11) * L + l] + ahead * k
        k = (
            ws[(I + 5) * L + l] * f0 + ws[(I + 10) * L + l] * f1 + ws[(I + 14) * L + l] * f2
            + ws[(I + 17) * L + l] * f3 + ws[(I + 19) * L + l] * f4 + ws[(I + 20) * L + l] * f5
        )  # fmt: skip
        ws[(S + 12) * L + l] += weight * k
        ws[(Y + 12) * L + l] = ws[(X + 12) * L + l] + ahead * k
