"""Compiled actuators that are not thrusters: fins, mass shifter, buoyancy engine, drop weight.

The kernel uses this module only for vehicles with such actuators. It calls `add_appendages` before every Runge-Kutta stage,
because a fin's force depends on the flow at that stage.

* Fin: lift and drag from the local relative flow, in the plane normal to the hinge; the hinge is normal to the x axis. Lift and
  drag are linear in the angle of attack, with one slope up to stall and another slope beyond stall. The model and the factor
  cos^2(sweep) come from gz-sim's LiftDrag system, for which the LRAUV's parameters were written.
* Mass shifter: moves a mass along its axis, which changes the restoring moment. The change of M_RB and the inertia force of the
  moving mass are neglected.
* Buoyancy engine: the force rho g (V - V_neutral) upward at the engine's position.
* Drop weight: after the release, an upward force at the position of the drop weight, equal to its weight. M_RB keeps the mass of
  the drop weight, and B keeps its volume.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.lanes import (
    add3,
    subtract3,
    three,
    vector,
)
from auvbench.dynamics.layout import (
    FIN,
    LANES,
    MASS_SHIFTER,
    THRUSTER,
    Record,
    Vector,
)
from auvbench.dynamics.vectors import cross, dot, plus_cross, scale, subtract, up_axis
from auvbench.dynamics.water import through_water

FloatArray = NDArray[np.float64]


@njit(nogil=True)
def lift_and_drag(v: Vector, angle: float, fin: Record) -> Vector:
    """Return the force on a fin that is turned by `angle` about its hinge and moves at `v` through the water.

    At angle 0 the chord points along the body's x axis; `fin` is an `ACTUATOR`.
    """
    hinge = vector(fin.axis)
    _, hinge_y, hinge_z = hinge
    # The chord is the x axis, turned about the hinge: cos(angle) x + sin(angle) (hinge x x).
    chord = (math.cos(angle), math.sin(angle) * hinge_z, -math.sin(angle) * hinge_y)
    normal = cross(hinge, chord)
    spanwise = dot(v, hinge)
    across = subtract(v, scale(spanwise, hinge))
    square = dot(across, across)
    if square == 0.0:
        return 0.0, 0.0, 0.0
    attack = math.atan2(-dot(across, normal), dot(across, chord))
    # A fin has the same lift and drag with either edge forward, so the angle is reduced to at most a quarter turn.
    if attack > 0.5 * math.pi:
        attack -= math.pi
    elif attack < -0.5 * math.pi:
        attack += math.pi
    within = min(abs(attack), fin.stall_angle)
    beyond = max(abs(attack) - fin.stall_angle, 0.0)
    C_L = math.copysign(max(fin.lift_slope * within + fin.lift_slope_stall * beyond, 0.0), attack)
    C_D = abs(fin.drag_slope * within + fin.drag_slope_stall * beyond)
    cos2_sweep = square / (square + spanwise * spanwise)
    # Dynamic pressure times area, divided by the speed, because the length of the vectors below is the speed.
    pressure = 0.5 * fin.density * square * fin.area * cos2_sweep / math.sqrt(square)
    return subtract(scale(C_L * pressure, cross(hinge, across)), scale(C_D * pressure, across))


@njit(nogil=True)
def add_appendages(ws: Record, actuators: Record, output: FloatArray) -> None:
    """Add the appendages' wrench at the present stage to tau."""
    force, torque = ws.tau.force, ws.tau.torque
    for lane in range(LANES):
        R, _, v_r = through_water(ws, lane)
        omega, up = three(ws.y.rates, lane), up_axis(R)
        for a in range(actuators.shape[0]):
            actuator = actuators[a]
            if actuator.kind == THRUSTER:
                continue
            r = vector(actuator.position)
            if actuator.kind == FIN:
                f = lift_and_drag(plus_cross(v_r, omega, r), output[a, lane], actuator)
            elif actuator.kind == MASS_SHIFTER:
                # A torque without a force: the weight m g moves by `output` along the axis, and the total weight stays.
                arm = actuator.upward * output[a, lane]
                subtract3(torque, lane, scale(arm, cross(vector(actuator.axis), up)))
                continue
            else:
                f = scale(actuator.upward * (output[a, lane] - actuator.neutral), up)
            add3(force, lane, f)
            add3(torque, lane, cross(r, f))
