# ruff: noqa: E741  (l is the lane, as in the layout)
"""Compiled actuators: static curve once per step, exact linear dynamics per half substep, wrench.

A command passes: normalised command -> static curve -> linear dynamics (exactly discretised for half a
substep, so that the stages of RK4 at 0, h/2 and h see the exact state) -> rotor (k rho D^4 n|n|) or identity
-> effectiveness -> wrench through the allocation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.layout import (
    CURVE,
    DISCRETE_B,
    DISCRETE_C,
    FIRST_STATE,
    FORCE_SCALE,
    HIGH,
    KIND,
    LANES,
    LINEAR_CURVE,
    LOW,
    NEUTRAL,
    ORDER,
    POWER_SCALE,
    ROTOR,
    TABLE,
    TABLE_CURVE,
    TAU,
    THRUST,
    THRUSTER,
)

FloatArray = NDArray[np.float64]
L = LANES


@njit(cache=True, nogil=True)
def interpolate(table: FloatArray, fraction: float) -> Any:
    """Linear interpolation in a table at equally spaced points; `fraction` in [0, 1] of its range."""
    last = table.size - 1
    position = min(max(fraction, 0.0), 1.0) * last
    index = min(int(position), last - 1)
    return table[index] + (position - index) * (table[index + 1] - table[index])


@njit(cache=True, nogil=True)
def _static(unit: FloatArray, tables: FloatArray, command: float) -> Any:
    a = min(max(command, -1.0), 1.0)
    if unit[CURVE] == LINEAR_CURVE:
        neutral = unit[NEUTRAL]
        if a < 0.0:
            return neutral + a * (neutral - unit[LOW])
        return neutral + a * (unit[HIGH] - neutral)
    row = tables[int(unit[TABLE])]
    if unit[CURVE] == TABLE_CURVE:
        points = int(row[0])
        return interpolate(row[1 : points + 1], 0.5 * (a + 1.0))
    total: Any = 0.0
    for k in range(int(row[0]), 0, -1):
        total = total * a + row[k]
    return total


@njit(cache=True, nogil=True)
def _rotor(unit: FloatArray, value: float) -> Any:
    if unit[ROTOR] == 0.0:
        return value
    return unit[ROTOR] * value * abs(value)


@njit(cache=True, nogil=True)
def _apply(
    ws: FloatArray,
    block: int,
    external: FloatArray,
    units: FloatArray,
    geometry: FloatArray,
    output: FloatArray,
    thrust: FloatArray,
) -> None:
    """TAU = external wrench + allocation of the present actuator outputs; `thrust` holds effectiveness."""
    n_u = units.shape[0]
    n = external.shape[0]
    for j in range(6):
        for l in range(L):
            i = block * L + l
            if i >= n:
                i = block * L
            ws[(TAU + j) * L + l] = external[i, j]
    for a in range(n_u):
        if units[a, KIND] != THRUSTER:
            continue
        rotor = units[a, ROTOR]
        for j in range(6):
            arm = geometry[a, j]
            if arm == 0.0:
                continue
            if rotor == 0.0:
                for l in range(L):
                    ws[(TAU + j) * L + l] += arm * (output[a, l] * thrust[a, l])
            else:
                for l in range(L):
                    ws[(TAU + j) * L + l] += arm * (rotor * output[a, l] * abs(output[a, l]) * thrust[a, l])


@njit(cache=True, nogil=True)
def hold_commands(
    ws: FloatArray,
    block: int,
    states: FloatArray,
    command: FloatArray,
    effectiveness: FloatArray,
    external: FloatArray,
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
    n_u = units.shape[0]
    n = command.shape[0]
    curve = tables[0, 2:]
    low = tables[0, 0]
    inverse_span = 1.0 / (tables[0, 1] - low)
    for l in range(L):
        i = block * L + l
        real = i < n
        if not real:
            i = block * L
        watts = 0.0
        for a in range(n_u):
            unit = units[a]
            value[a, l] = _static(unit, tables, command[i, a])
            newtons = 0.0
            if unit[KIND] == THRUSTER:
                newtons = _rotor(unit, value[a, l])
                fraction = (newtons * unit[FORCE_SCALE] - low) * inverse_span
                watts += interpolate(curve, fraction) * unit[POWER_SCALE]
            if real:
                force[i, a] = newtons
            thrust[a, l] = effectiveness[i, a] * ws[THRUST * L + l]
        if real:
            power[i] = watts
        for j in range(states.shape[1]):
            inner[j, l] = states[i, j]
    _outputs(units, value, output, inner, discrete)
    _apply(ws, block, external, units, geometry, output, thrust)


@njit(cache=True, nogil=True)
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
        else:
            for l in range(L):
                output[a, l] = discrete[a, DISCRETE_C] * inner[first, l]
            for j in range(1, order):
                for l in range(L):
                    output[a, l] += discrete[a, DISCRETE_C + j] * inner[first + j, l]


@njit(cache=True, nogil=True)
def advance_actuators(
    ws: FloatArray,
    block: int,
    external: FloatArray,
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
        first = int(units[a, FIRST_STATE])
        D = discrete[a]
        if order == 1:
            for l in range(L):
                inner[first, l] = D[0] * inner[first, l] + D[DISCRETE_B] * value[a, l]
        elif order == 2:
            for l in range(L):
                x0 = inner[first, l]
                x1 = inner[first + 1, l]
                inner[first, l] = D[0] * x0 + D[1] * x1 + D[DISCRETE_B] * value[a, l]
                inner[first + 1, l] = D[3] * x0 + D[4] * x1 + D[DISCRETE_B + 1] * value[a, l]
        elif order == 3:
            for l in range(L):
                x0 = inner[first, l]
                x1 = inner[first + 1, l]
                x2 = inner[first + 2, l]
                inner[first, l] = D[0] * x0 + D[1] * x1 + D[2] * x2 + D[DISCRETE_B] * value[a, l]
                inner[first + 1, l] = D[3] * x0 + D[4] * x1 + D[5] * x2 + D[DISCRETE_B + 1] * value[a, l]
                inner[first + 2, l] = D[6] * x0 + D[7] * x1 + D[8] * x2 + D[DISCRETE_B + 2] * value[a, l]
    _outputs(units, value, output, inner, discrete)
    _apply(ws, block, external, units, geometry, output, thrust)
