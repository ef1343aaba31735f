"""The compiled simulator: classical Runge-Kutta for many vehicles at once, in blocks of 16. `equations` has the equations of motion.

The state of the batch has a row for each vehicle. The kernel copies each block into a workspace, which stores each quantity
side by side for 16 vehicles. It advances the block there by all substeps of a step, and then copies the block back.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.actuation import (
    advance_actuators,
    apply_thrust,
    hold_commands,
    report,
    static_curves,
)
from auvbench.dynamics.appendages import add_appendages
from auvbench.dynamics.compiled import compiled, inline
from auvbench.dynamics.equations import put_off_diagonal, runge_kutta_stage
from auvbench.dynamics.lanes import (
    four,
    put3,
    put4,
    quaternion,
    set3,
    set4,
    three,
    vector,
)
from auvbench.dynamics.layout import (
    ACTUATOR,
    CURRENT,
    DISCRETE,
    LANES,
    PARAMETER_ROWS,
    POSE,
    ROWS,
    VELOCITY,
    WORKSPACE,
    WRENCH,
    Record,
)
from auvbench.dynamics.vectors import unit
from auvbench.dynamics.water import clear_momenta, clear_wrench, put_early
from auvbench.dynamics.waves import add_water_inertia, move_water

FloatArray = NDArray[np.float64]

PARTS = 6.0, 3.0, 3.0, 6.0
"""1 / b_i of the stages of the classical Runge-Kutta method"""
AHEAD = 0.5, 0.5, 1.0, 0.0
"""Time from the start of a substep to the next stage, as a fraction of the substep"""


@inline
def copy_state(source: Record, target: Record, lane: int) -> None:
    """Copy the `STATE` of one vehicle."""
    put3(target.position, lane, three(source.position, lane))
    put4(target.attitude, lane, four(source.attitude, lane))
    put3(target.velocity, lane, three(source.velocity, lane))
    put3(target.rates, lane, three(source.rates, lane))


@njit(nogil=True)
def _begin(ws: Record) -> None:
    """Copy the state x at the start of a substep to y, the state at the first stage, and to s, the sum of the stages."""
    x, y, s = ws.x, ws.y, ws.s
    for lane in range(LANES):
        copy_state(x, y, lane)
        copy_state(x, s, lane)


@njit(nogil=True)
def _finish(ws: Record) -> None:
    """Copy s, the sum of the stages, to the state x, and normalise the quaternion."""
    x, s = ws.x, ws.s
    for lane in range(LANES):
        copy_state(s, x, lane)
        put4(x.attitude, lane, unit(four(x.attitude, lane)))


@njit(nogil=True)
def _gather(
    ws: Record, block: int, poses: Record, velocities: Record, currents: Record, externals: Record
) -> None:
    """Copy one block into the workspace; lanes after the last vehicle repeat this vehicle."""
    last = poses.shape[0] - 1
    x, current, external = ws.x, ws.current, ws.external
    for lane in range(LANES):
        i = min(block * LANES + lane, last)
        put3(x.position, lane, vector(poses[i].position))
        put4(x.attitude, lane, quaternion(poses[i].attitude))
        put3(x.velocity, lane, vector(velocities[i].linear))
        put3(x.rates, lane, vector(velocities[i].angular))
        put3(current.velocity, lane, vector(currents[i].velocity))
        put3(current.change, lane, vector(currents[i].change))
        current.top[lane] = currents[i].top
        current.per_thickness[lane] = currents[i].per_thickness
        put3(external.force, lane, vector(externals[i].force))
        put3(external.torque, lane, vector(externals[i].torque))


@njit(nogil=True)
def _scatter(ws: Record, block: int, poses: Record, velocities: Record) -> None:
    """Copy the vehicles of one block back."""
    x = ws.x
    for lane in range(min(LANES, poses.shape[0] - block * LANES)):
        i = block * LANES + lane
        set3(poses[i].position, three(x.position, lane))
        set4(poses[i].attitude, four(x.attitude, lane))
        set3(velocities[i].linear, three(x.velocity, lane))
        set3(velocities[i].angular, three(x.rates, lane))


@compiled()
def advance(
    pose: FloatArray,  # (n, 7)
    velocity: FloatArray,  # (n, 6)
    states: FloatArray,  # (n, n_actuator_states)
    command: FloatArray,  # (n, n_u) in [-1, 1]
    effectiveness: FloatArray,  # (n, n_u)
    force: FloatArray,  # (n, n_u) out: commanded force, N
    power: FloatArray,  # (n,) out: electrical power of the command, W
    current: FloatArray,  # (n, 8)
    external: FloatArray,  # (n, 6) body wrench
    waves: tuple[FloatArray, FloatArray, FloatArray],  # components, rays, time of `waves.Waves`
    parameters: FloatArray,  # (n_blocks, rows * LANES), or one row for all blocks
    # The next two arrays are passed as floats, because numba compares the types of records again in each call.
    actuators: FloatArray,  # records of ACTUATOR (n_u,)
    discrete: FloatArray,  # records of DISCRETE (n_u,) for half a substep
    tables: FloatArray,  # (k, points)
    # Whether the vehicles have: off-diagonal added mass; actuators with dynamics; actuators that are not thrusters; C_A of Gazebo's
    # early plugin; lags whose time constants differ between vehicles.
    flags: tuple[bool, bool, bool, bool, bool],
    blocks: tuple[int, int],  # first block, one past the last
    substeps: int,
    h: float,
) -> None:
    """Advance the vehicles of `blocks` by `substeps` RK4 steps of `h` seconds with a constant command."""
    off_diagonal, dynamic, appendages, early_plugin, own_lags = flags
    components, rays, time = waves
    wavy = components.shape[0] > 0
    n_u, count = command.shape[1], states.shape[1]
    units, lags = actuators.view(ACTUATOR), discrete.view(DISCRETE)
    poses, velocities = pose.view(POSE)[:, 0], velocity.view(VELOCITY)[:, 0]
    currents, externals = current.view(CURRENT)[:, 0], external.view(WRENCH)[:, 0]
    # One piece of memory starts at a cache line's boundary, because a 64-byte vector across two lines costs twice as much.
    rows = ROWS + 5 * n_u + count
    memory = np.empty((rows + 1) * LANES)
    skip = (-memory.ctypes.data % 64) // 8
    table = memory[skip : skip + rows * LANES].reshape((rows, LANES))
    workspace = memory[skip : skip + ROWS * LANES]
    ws = workspace.view(WORKSPACE)[0]
    value = table[ROWS : ROWS + n_u]  # static curve of the command
    output = table[ROWS + n_u : ROWS + 2 * n_u]  # output of the dynamics
    thrust = table[ROWS + 2 * n_u : ROWS + 3 * n_u]  # effectiveness times thrust scale
    inner = table[ROWS + 3 * n_u : ROWS + 3 * n_u + count]
    kept = table[
        ROWS + 3 * n_u + count : ROWS + 4 * n_u + count
    ]  # A and B of lags that differ between vehicles
    moved = table[ROWS + 4 * n_u + count :]
    clear_momenta(ws)
    first, end = blocks
    for block in range(first, end):
        if parameters.shape[0] > 1 or block == first:
            row = min(block, parameters.shape[0] - 1)
            for j in range(PARAMETER_ROWS * LANES):
                workspace[j] = parameters[row, j]
        _gather(ws, block, poses, velocities, currents, externals)
        hold_commands(ws, block, states, command, effectiveness, force, power, units, lags,
                      tables, value, output, thrust, inner, kept, moved, own_lags)  # fmt: skip
        for step in range(substeps):
            if wavy:
                move_water(ws, block, currents, components, rays, time, step * h, h / 2.0)
            _begin(ws)
            # The classical Runge-Kutta method, as a loop, so that the stage is not compiled four times.
            for stage in range(4):
                share, ahead = h / PARTS[stage], h * AHEAD[stage]
                if dynamic and (stage == 1 or stage == 3):
                    advance_actuators(ws, units, lags, value, output, thrust, inner, kept, moved, own_lags)
                if not (off_diagonal or appendages or early_plugin or wavy):
                    # With the constant False, the compiler drops the terms of `ws.extra`, so that they cost
                    # vehicles without these terms nothing.
                    runge_kutta_stage(ws, share, ahead, False)
                    continue
                if off_diagonal:
                    put_off_diagonal(ws)
                elif wavy:
                    clear_wrench(ws)
                if early_plugin:  # no sheet with this plugin has off-diagonal added mass
                    put_early(ws)
                if appendages:
                    apply_thrust(ws, units, output, thrust)
                    add_appendages(ws, units, output)
                if wavy:
                    add_water_inertia(ws)
                runge_kutta_stage(ws, share, ahead, off_diagonal or early_plugin or wavy)
            _finish(ws)
        _scatter(ws, block, poses, velocities)
        for lane in range(min(LANES, poses.shape[0] - block * LANES)):
            for j in range(count):
                states[block * LANES + lane, j] = inner[j, lane]


@compiled()
def commanded(
    command: FloatArray,  # (n, n_u) in [-1, 1], clipped
    actuators: Record,  # (n_u,) of ACTUATOR
    tables: FloatArray,  # (k, points)
    quantity: FloatArray,  # (n, n_u) out: values of the static curves, N, rad/s, rad, m or m3
    force: FloatArray,  # (n, n_u) out: N of the thrusters
    power: FloatArray,  # (n,) out: electrical W
) -> None:
    """Write the static curves' values, forces and powers of commands, for external simulators.

    `force` and `power` have the same bits as the results of `advance`.
    """
    n, n_u = command.shape
    value = np.empty((n_u, LANES))
    for block in range((n + LANES - 1) // LANES):
        first = block * LANES
        for lane in range(LANES):
            i = min(first + lane, n - 1)
            for a in range(n_u):
                value[a, lane] = command[i, a]
        static_curves(actuators, tables, value)
        for lane in range(min(LANES, n - first)):
            for a in range(n_u):
                quantity[first + lane, a] = value[a, lane]
        report(first, actuators, tables, value, force, power)
