# ruff: noqa: E741  (l is the lane, as in the layout)
"""Compiled actuators that are no thrusters: fins, mass shifter, buoyancy engine, drop weight.

Only vehicles that have any of them come here; it is called before every Runge-Kutta stage, because a fin's force
depends on the flow at that stage.

* Fin: lift and drag in the plane across its hinge from the local relative flow, linear in the angle of attack up to
  stall and with another slope beyond it; the model and the factor cos^2(sweep) are those of gz-sim's LiftDrag system,
  which the LRAUV's parameters were written for.
* Mass shifter: moves weight along its axis; changes the restoring moment (its effect on M_RB is neglected).
* Buoyancy engine: rho g (V - V_neutral) upward at its position.
* Drop weight: once released, its weight upward at its position (its mass stays in M_RB, its volume in B).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import (
    AREA,
    AXIS,
    DENSITY,
    DRAG_SLOPE,
    DRAG_SLOPE_STALL,
    FIN,
    KIND,
    LANES,
    LIFT_SLOPE,
    LIFT_SLOPE_STALL,
    MASS_SHIFTER,
    NEUTRAL,
    STALL_ANGLE,
    TAU,
    THRUSTER,
    UPWARD,
    Y,
)
from auvbench.dynamics.water import relative_velocity

FloatArray = NDArray[np.float64]
L = LANES


@njit(nogil=True)
def lift_and_drag(
    vx: float, vy: float, vz: float, angle: float, fin: FloatArray
) -> tuple[float, float, float]:
    """Force (3) on a fin turned by `angle` about its hinge that moves at (vx, vy, vz) through the water.

    At angle 0 the chord points along the body's x axis; `fin` is a row of the table of geometry.
    """
    ax, ay, az = fin[AXIS], fin[AXIS + 1], fin[AXIS + 2]
    c, s = math.cos(angle), math.sin(angle)
    # Chord, turned about the hinge a: f = c x + s (a x x); normal: n = a x f.
    fx, fy, fz = c, s * az, -s * ay
    nx, ny, nz = ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx
    spanwise = vx * ax + vy * ay + vz * az
    px, py, pz = vx - spanwise * ax, vy - spanwise * ay, vz - spanwise * az
    square = px * px + py * py + pz * pz
    if square == 0.0:
        return 0.0, 0.0, 0.0
    speed = math.sqrt(square)
    attack = math.atan2(-(px * nx + py * ny + pz * nz), px * fx + py * fy + pz * fz)
    # The same from both sides of the chord: fold into a quarter turn.
    if attack > 0.5 * math.pi:
        attack -= math.pi
    elif attack < -0.5 * math.pi:
        attack += math.pi
    size = abs(attack)
    within = min(size, fin[STALL_ANGLE])
    beyond = max(size - fin[STALL_ANGLE], 0.0)
    lift = max(fin[LIFT_SLOPE] * within + fin[LIFT_SLOPE_STALL] * beyond, 0.0)
    lift = math.copysign(lift, attack)
    drag = abs(fin[DRAG_SLOPE] * within + fin[DRAG_SLOPE_STALL] * beyond)
    sweep = square / (square + spanwise * spanwise)
    pressure = 0.5 * fin[DENSITY] * square * fin[AREA] * sweep
    lift *= pressure / speed
    drag *= pressure / speed
    return (
        lift * (ay * pz - az * py) - drag * px,
        lift * (az * px - ax * pz) - drag * py,
        lift * (ax * py - ay * px) - drag * pz,
    )


@njit(nogil=True)
def add_appendages(ws: FloatArray, units: FloatArray, geometry: FloatArray, output: FloatArray) -> None:
    """Add to TAU what the appendages do at the present stage."""
    for l in range(L):
        u, v, w, zx, zy, zz = relative_velocity(ws, l)
        p = ws[(Y + 10) * L + l]
        q = ws[(Y + 11) * L + l]
        r = ws[(Y + 12) * L + l]
        for a in range(units.shape[0]):
            kind = units[a, KIND]
            if kind == THRUSTER:
                continue
            row = geometry[a]
            rx, ry, rz = row[0], row[1], row[2]
            if kind == FIN:
                fx, fy, fz = lift_and_drag(
                    u + q * rz - r * ry, v + r * rx - p * rz, w + p * ry - q * rx, output[a, l], row
                )
            elif kind == MASS_SHIFTER:
                # A couple: the weight m g leaves its place and comes back at `output` along the axis.
                arm = row[UPWARD] * output[a, l]
                ws[(TAU + 3) * L + l] -= arm * (row[AXIS + 1] * zz - row[AXIS + 2] * zy)
                ws[(TAU + 4) * L + l] -= arm * (row[AXIS + 2] * zx - row[AXIS] * zz)
                ws[(TAU + 5) * L + l] -= arm * (row[AXIS] * zy - row[AXIS + 1] * zx)
                continue
            else:
                upward = row[UPWARD] * (output[a, l] - units[a, NEUTRAL])
                fx, fy, fz = upward * zx, upward * zy, upward * zz
            ws[TAU * L + l] += fx
            ws[(TAU + 1) * L + l] += fy
            ws[(TAU + 2) * L + l] += fz
            ws[(TAU + 3) * L + l] += ry * fz - rz * fy
            ws[(TAU + 4) * L + l] += rz * fx - rx * fz
            ws[(TAU + 5) * L + l] += rx * fy - ry * fx
