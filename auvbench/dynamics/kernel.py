# ruff: noqa: E741  (l is the lane, as in the layout)
"""The compiled simulator: classical Runge-Kutta for many vehicles at once, in blocks of 16.

The state of the batch stays row by row, a vehicle after the other; each block is copied into a workspace in which the
same quantity of 16 vehicles lies side by side, advanced there by all substeps of a step, and copied back.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics import layout
from auvbench.dynamics.actuation import (
    advance_actuators,
    apply_thrust,
    hold_commands,
    report,
    static_curves,
)
from auvbench.dynamics.appendages import add_appendages
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.equations import off_diagonal, runge_kutta_stage
from auvbench.dynamics.layout import CURRENT, LANES, PARAMETERS, ROWS, STATE_ROWS, S, X, Y
from auvbench.dynamics.water import add_early
from auvbench.dynamics.waves import add_inertia, clear_extra, move_water

FloatArray = NDArray[np.float64]
L = LANES
PARAMETER_ROWS = layout.PARAMETERS_END - PARAMETERS


@njit(nogil=True)
def _begin(ws: FloatArray) -> None:
    """Y = S = X."""
    for l in range(STATE_ROWS * L):
        ws[Y * L + l] = ws[X * L + l]
        ws[S * L + l] = ws[X * L + l]


@njit(nogil=True)
def _finish(ws: FloatArray) -> None:
    """X = S with a unit quaternion."""
    for l in range(STATE_ROWS * L):
        ws[X * L + l] = ws[S * L + l]
    for l in range(L):
        qw = ws[(X + 3) * L + l]
        qx = ws[(X + 4) * L + l]
        qy = ws[(X + 5) * L + l]
        qz = ws[(X + 6) * L + l]
        scale = 1.0 / math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        ws[(X + 3) * L + l] = qw * scale
        ws[(X + 4) * L + l] = qx * scale
        ws[(X + 5) * L + l] = qy * scale
        ws[(X + 6) * L + l] = qz * scale


@njit(nogil=True)
def _gather(
    ws: FloatArray,
    block: int,
    pose: FloatArray,
    velocity: FloatArray,
    current: FloatArray,
    external: FloatArray,
    parameters: FloatArray,
    first: bool,
) -> None:
    """Copy one block into the workspace; lanes past the end repeat the last vehicle."""
    last = pose.shape[0] - 1
    for l in range(L):
        i = min(block * L + l, last)
        for j in range(7):
            ws[(X + j) * L + l] = pose[i, j]
        for j in range(6):
            ws[(X + 7 + j) * L + l] = velocity[i, j]
        for j in range(layout.CURRENT_COLUMNS):
            ws[(CURRENT + j) * L + l] = current[i, j]
        for j in range(6):
            ws[(layout.EXTERNAL + j) * L + l] = external[i, j]
    if parameters.shape[0] > 1 or first:
        row = min(block, parameters.shape[0] - 1)
        for l in range(PARAMETER_ROWS * L):
            ws[PARAMETERS * L + l] = parameters[row, l]


@njit(nogil=True)
def _scatter(ws: FloatArray, block: int, pose: FloatArray, velocity: FloatArray) -> None:
    for l in range(min(L, pose.shape[0] - block * L)):
        i = block * L + l
        for j in range(7):
            pose[i, j] = ws[(X + j) * L + l]
        for j in range(6):
            velocity[i, j] = ws[(X + 7 + j) * L + l]


@compiled()
def advance(
    pose: FloatArray,  # (n, 7)
    velocity: FloatArray,  # (n, 6)
    states: FloatArray,  # (n, n_actuator_states)
    command: FloatArray,  # (n, n_u) in [-1, 1]
    effectiveness: FloatArray,  # (n, n_u)
    force: FloatArray,  # (n, n_u) out: N that the command stands for
    power: FloatArray,  # (n,) out: electrical W of that command
    current: FloatArray,  # (n, 8)
    external: FloatArray,  # (n, 6) body wrench
    waves: tuple[FloatArray, FloatArray, FloatArray],  # components, rays, time of `waves.Waves`
    parameters: FloatArray,  # (n_blocks, rows * LANES), or one row for all blocks
    units: FloatArray,  # (n_u, ACTUATOR_COLUMNS)
    geometry: FloatArray,  # (n_u, GEOMETRY_COLUMNS)
    discrete: FloatArray,  # (n_u, DISCRETE_COLUMNS) for half a substep
    tables: FloatArray,  # (k, points)
    # Off-diagonal added mass, actuators with dynamics, actuators that are no thrusters, C_A of Gazebo's early plugin.
    flags: tuple[bool, bool, bool, bool],
    blocks: tuple[int, int],  # first block, one past the last
    substeps: int,
    h: float,
) -> None:
    """Advance vehicles of `blocks` by `substeps` RK4 steps of `h` seconds with the command held."""
    full, dynamic, special, early = flags
    components, rays, time = waves
    wavy = components.shape[0] > 0
    n_u = units.shape[0]
    count = states.shape[1]
    # One piece of memory on a cache line's boundary: vectors of 64 bytes that straddle two lines cost twice.
    memory = np.zeros((ROWS + 3 * n_u + count + 1) * L)
    skip = (-memory.ctypes.data % 64) // 8
    ws = memory[skip : skip + ROWS * L]
    table = memory[skip + ROWS * L : skip + (ROWS + 3 * n_u + count) * L].reshape((3 * n_u + count, L))
    value = table[:n_u]  # static curve of the command
    output = table[n_u : 2 * n_u]  # after the dynamics
    thrust = table[2 * n_u : 3 * n_u]  # effectiveness times thrust scale
    inner = table[3 * n_u :]
    for block in range(blocks[0], blocks[1]):
        _gather(ws, block, pose, velocity, current, external, parameters, block == blocks[0])
        hold_commands(ws, block, states, command, effectiveness, force, power, units, geometry, discrete,
                      tables, value, output, thrust, inner)  # fmt: skip
        for step in range(substeps):
            if wavy:
                move_water(ws, block, current, components, rays, time, step * h, h / 2.0)
            _begin(ws)
            # The classical Runge-Kutta method; one call in the source, so that it is compiled once.
            for stage in range(4):
                weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
                ahead = h / 2.0 if stage < 2 else h * (3 - stage)
                if dynamic and (stage == 1 or stage == 3):
                    advance_actuators(ws, units, geometry, discrete, value, output, thrust, inner)
                if not (full or special or early or wavy):
                    # With the constant the compiler drops the terms of the off-diagonal added mass, so that
                    # vehicles without it do not pay for it.
                    runge_kutta_stage(ws, weight, ahead, False)
                    continue
                if full:
                    off_diagonal(ws)
                elif wavy:
                    clear_extra(ws)
                if early:
                    add_early(ws)
                if special:
                    apply_thrust(ws, units, geometry, output, thrust)
                    add_appendages(ws, units, geometry, output)
                if wavy:
                    add_inertia(ws)
                runge_kutta_stage(ws, weight, ahead, full or early or wavy)
            _finish(ws)
        _scatter(ws, block, pose, velocity)
        if states.shape[1] > 0:
            for l in range(min(L, pose.shape[0] - block * L)):
                for j in range(states.shape[1]):
                    states[block * L + l, j] = inner[j, l]


@compiled()
def commanded(
    command: FloatArray,  # (n, n_u) in [-1, 1], clipped
    units: FloatArray,  # (n_u, ACTUATOR_COLUMNS)
    tables: FloatArray,  # (k, points)
    quantity: FloatArray,  # (n, n_u) out: what the curves make of the commands, N, rad/s, rad, m or m3
    force: FloatArray,  # (n, n_u) out: N of the thrusters
    power: FloatArray,  # (n,) out: electrical W
) -> None:
    """Write what commands stand for, for simulators that act elsewhere: the bits that `advance` leaves in `force` and `power`."""
    n, n_u = command.shape
    value = np.empty((n_u, LANES))
    for block in range((n + LANES - 1) // LANES):
        first = block * LANES
        for lane in range(LANES):
            i = min(first + lane, n - 1)
            for a in range(n_u):
                value[a, lane] = command[i, a]
        static_curves(units, tables, value)
        for lane in range(min(LANES, n - first)):
            for a in range(n_u):
                quantity[first + lane, a] = value[a, lane]
        report(first, units, tables, value, force, power)
