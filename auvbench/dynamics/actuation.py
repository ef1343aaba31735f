# ruff: noqa: E741  (l is the lane, as in the layout)
"""Compiled actuators: static curve once per step, exact linear dynamics per half substep, wrench.

A command passes: normalised command -> static curve -> linear dynamics (exactly discretised for half a
substep, so that the stages of RK4 at 0, h/2 and h see the exact state) -> rotor (k rho D^4 n|n|) or identity
-> effectiveness -> wrench through the allocation.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import (
    CURVE,
    DISCRETE_B,
    DISCRETE_C,
    DROP_WEIGHT,
    EXTERNAL,
    FIRST_STATE,
    FORCE,
    FORCE_SCALE,
    HALF_STEP,
    HIGH,
    KIND,
    LANES,
    LINEAR_CURVE,
    LOW,
    NEUTRAL,
    ORDER,
    POWER_POINTS,
    POWER_SCALE,
    RATE,
    ROTOR,
    TABLE,
    TABLE_CURVE,
    TAU,
    THRUST,
    THRUSTER,
)

FloatArray = NDArray[np.float64]
L = LANES


@njit(nogil=True)
def static_curves(units: FloatArray, tables: FloatArray, value: FloatArray) -> None:
    """Replace commands (n_u, LANES), clipped to [-1, 1], by what the static curves make of them."""
    for a in range(units.shape[0]):
        for l in range(L):
            value[a, l] = min(max(value[a, l], -1.0), 1.0)
        if units[a, CURVE] == LINEAR_CURVE:
            neutral = units[a, NEUTRAL]
            below = neutral - units[a, LOW]
            above = units[a, HIGH] - neutral
            for l in range(L):
                x = value[a, l]
                value[a, l] = neutral + x * (below if x < 0.0 else above)
            continue
        row = int(units[a, TABLE])
        points = int(tables[row, 0])
        if units[a, CURVE] == TABLE_CURVE:
            for l in range(L):
                position = 0.5 * (value[a, l] + 1.0) * (points - 1)
                k = max(min(int(position), points - 2), 0)
                low = tables[row, 1 + k]
                value[a, l] = low + (position - k) * (tables[row, 2 + k] - low)
        else:
            for l in range(L):
                x = value[a, l]
                total = tables[row, points]
                for k in range(points - 1, 0, -1):
                    total = total * x + tables[row, k]
                value[a, l] = total


@njit(nogil=True)
def report(
    first: int,
    units: FloatArray,
    tables: FloatArray,
    value: FloatArray,
    force: FloatArray,
    power: FloatArray,
) -> None:
    """Forces that the commands stand for, and the electrical power they take."""
    points = POWER_POINTS
    middle = 0.5 * (points - 1)
    per_newton = middle / tables[0, 0]
    for l in range(min(L, force.shape[0] - first)):
        watts = 0.0
        for a in range(units.shape[0]):
            if units[a, KIND] != THRUSTER:
                force[first + l, a] = 0.0
                continue
            newtons = value[a, l]
            if units[a, ROTOR] != 0.0:
                newtons = units[a, ROTOR] * newtons * abs(newtons)
            force[first + l, a] = newtons
            position = newtons * units[a, FORCE_SCALE] * per_newton + middle
            position = min(max(position, 0.0), points - 1.0)
            k = max(min(int(position), points - 2), 0)
            left = tables[0, 1 + k]
            watts += (left + (position - k) * (tables[0, 2 + k] - left)) * units[a, POWER_SCALE]
        power[first + l] = watts


@njit(nogil=True)
def apply_thrust(
    ws: FloatArray, units: FloatArray, geometry: FloatArray, output: FloatArray, thrust: FloatArray
) -> None:
    """TAU = external wrench + allocation of the present outputs; `thrust` is what multiplies each of them."""
    for l in range(6 * L):
        ws[TAU * L + l] = ws[EXTERNAL * L + l]
    for a in range(units.shape[0]):
        if units[a, KIND] != THRUSTER:
            continue
        rotor = units[a, ROTOR]
        if rotor == 0.0:
            for l in range(L):
                ws[FORCE * L + l] = output[a, l] * thrust[a, l]
        else:
            for l in range(L):
                ws[FORCE * L + l] = rotor * output[a, l] * abs(output[a, l]) * thrust[a, l]
        b0 = geometry[a, 0]
        b1 = geometry[a, 1]
        b2 = geometry[a, 2]
        b3 = geometry[a, 3]
        b4 = geometry[a, 4]
        b5 = geometry[a, 5]
        for l in range(L):
            f = ws[FORCE * L + l]
            ws[TAU * L + l] += b0 * f
            ws[(TAU + 1) * L + l] += b1 * f
            ws[(TAU + 2) * L + l] += b2 * f
            ws[(TAU + 3) * L + l] += b3 * f
            ws[(TAU + 4) * L + l] += b4 * f
            ws[(TAU + 5) * L + l] += b5 * f


@njit(nogil=True)
def hold_commands(
    ws: FloatArray,
    block: int,
    states: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    force: FloatArray,
    power: FloatArray,
    units: FloatArray,
    geometry: FloatArray,
    discrete: FloatArray,
    tables: FloatArray,
    value: FloatArray,
    output: FloatArray,
    thrust: FloatArray,
    inner: FloatArray,
) -> None:
    """Start a step: static curves, commanded forces and power, present outputs, first wrench."""
    last = command.shape[0] - 1
    for l in range(L):
        i = min(block * L + l, last)
        for a in range(units.shape[0]):
            value[a, l] = command[i, a]
            thrust[a, l] = effectiveness[i, a]
        for j in range(states.shape[1]):
            inner[j, l] = states[i, j]
    for a in range(units.shape[0]):
        for l in range(L):
            thrust[a, l] *= ws[THRUST * L + l]
    static_curves(units, tables, value)
    for a in range(units.shape[0]):
        if units[a, KIND] == DROP_WEIGHT:
            first = int(units[a, FIRST_STATE])
            for l in range(L):
                # Released for good by a command above one half.
                if value[a, l] > 0.5:
                    inner[first, l] = 1.0
    report(block * L, units, tables, value, force, power)
    _outputs(units, value, output, inner, discrete)
    apply_thrust(ws, units, geometry, output, thrust)


@njit(nogil=True)
def _outputs(
    units: FloatArray, value: FloatArray, output: FloatArray, inner: FloatArray, discrete: FloatArray
) -> None:
    """Output of each actuator's dynamics in its present state."""
    for a in range(units.shape[0]):
        order = int(units[a, ORDER])
        first = int(units[a, FIRST_STATE])
        if order == 0:
            for l in range(L):
                output[a, l] = value[a, l]
            continue
        for l in range(L):
            output[a, l] = 0.0
        for j in range(order):
            c = discrete[a, DISCRETE_C + j]
            for l in range(L):
                output[a, l] += c * inner[first + j, l]


# The updates below take whole tables and an index, not rows: a view costs more than the arithmetic. Coefficients
# are read into locals first, so that the compiler knows that no store can change them.


@njit(nogil=True)
def _advance_first(
    a: int, first: int, D: FloatArray, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    decay, b, c = D[a, 0], D[a, DISCRETE_B], D[a, DISCRETE_C]
    for l in range(L):
        x0 = decay * inner[first, l] + b * value[a, l]
        inner[first, l] = x0
        output[a, l] = c * x0


@njit(nogil=True)
def _advance_second(
    a: int, first: int, D: FloatArray, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    a00, a01, a10, a11 = D[a, 0], D[a, 1], D[a, 3], D[a, 4]
    b0, b1 = D[a, DISCRETE_B], D[a, DISCRETE_B + 1]
    c0, c1 = D[a, DISCRETE_C], D[a, DISCRETE_C + 1]
    for l in range(L):
        s0, s1, u = inner[first, l], inner[first + 1, l], value[a, l]
        x0 = a00 * s0 + a01 * s1 + b0 * u
        x1 = a10 * s0 + a11 * s1 + b1 * u
        inner[first, l] = x0
        inner[first + 1, l] = x1
        output[a, l] = c0 * x0 + c1 * x1


@njit(nogil=True)
def _advance_third(
    a: int, first: int, D: FloatArray, value: FloatArray, output: FloatArray, inner: FloatArray
) -> None:
    a00, a01, a02 = D[a, 0], D[a, 1], D[a, 2]
    a10, a11, a12 = D[a, 3], D[a, 4], D[a, 5]
    a20, a21, a22 = D[a, 6], D[a, 7], D[a, 8]
    b0, b1, b2 = D[a, DISCRETE_B], D[a, DISCRETE_B + 1], D[a, DISCRETE_B + 2]
    c0, c1, c2 = D[a, DISCRETE_C], D[a, DISCRETE_C + 1], D[a, DISCRETE_C + 2]
    for l in range(L):
        s0, s1, s2, u = inner[first, l], inner[first + 1, l], inner[first + 2, l], value[a, l]
        x0 = a00 * s0 + a01 * s1 + a02 * s2 + b0 * u
        x1 = a10 * s0 + a11 * s1 + a12 * s2 + b1 * u
        x2 = a20 * s0 + a21 * s1 + a22 * s2 + b2 * u
        inner[first, l] = x0
        inner[first + 1, l] = x1
        inner[first + 2, l] = x2
        output[a, l] = c0 * x0 + c1 * x1 + c2 * x2


@njit(nogil=True)
def advance_actuators(
    ws: FloatArray,
    units: FloatArray,
    geometry: FloatArray,
    discrete: FloatArray,
    value: FloatArray,
    output: FloatArray,
    thrust: FloatArray,
    inner: FloatArray,
) -> None:
    """Advance the actuator states by half a substep, exactly, and renew the wrench."""
    for a in range(units.shape[0]):
        order = int(units[a, ORDER])
        if order == 0:
            continue
        first = int(units[a, FIRST_STATE])
        if units[a, RATE] > 0.0:
            reach = units[a, RATE] * discrete[a, HALF_STEP]
            for l in range(L):
                inner[first, l] += min(max(value[a, l] - inner[first, l], -reach), reach)
                output[a, l] = inner[first, l]
        elif units[a, KIND] == DROP_WEIGHT:
            continue
        elif order == 1:
            _advance_first(a, first, discrete, value, output, inner)
        elif order == 2:
            _advance_second(a, first, discrete, value, output, inner)
        else:
            _advance_third(a, first, discrete, value, output, inner)
    apply_thrust(ws, units, geometry, output, thrust)
