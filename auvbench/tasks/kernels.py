"""The waypoint task, compiled: scenario, command noise, reward and ends, observation, for N environments.

One row per environment in two arrays: `F` (floats, columns `F_*`) and `C` (integers, columns `C_*`). Every
draw is a function of (seed, stream, environment, episode, step, channel), so a row never depends on its
neighbours or on the batch size.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import COMMAND, SCENARIO, SENSOR, uniform4

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns of F. Sums run over the steps of the episode.
F_WAYPOINT = 0  # x, y, z in m
F_START = 3  # x, y, z in m
F_START_YAW = 6  # rad
F_DISTANCE = 7  # m, to the waypoint, now
F_INITIAL_DISTANCE = 8  # m
F_RETURN = 9
F_DEVIATION = 10  # sum of m
F_DEVIATION_SQUARED = 11  # sum of m^2
F_COMMAND_NORM = 12  # sum of N
F_ENERGY = 13  # J
F_PATH = 14  # m
F_CHANGE = 15  # sum of norms of the change of the normalised action
F_DEPTH_MARGIN = 16  # m, smallest so far
F_POSITION = 17  # x, y, z in m at the previous step
N_FLOATS = 20

# Columns of C.
C_STEPS = 0
C_EPISODE = 1
C_ENVIRONMENT = 2
C_OUTCOME = 3  # -1 under way, else an index into record.OUTCOMES
C_SEED = 4  # 0 .. 2^32 - 1, of every draw of the row
N_INTEGERS = 5

SUCCESS = 0
COLLISION = 1
TIMEOUT = 2

# Entries of the parameter vector P.
P_GOAL = 0
P_DEPTH_LOW = 1
P_DEPTH_HIGH = 2
P_MAX_STEPS = 3
P_K = 4
P_LENGTH = 5
P_SUCCESS = 6
P_COLLISION = 7
P_REGRESS = 8
P_DURATION = 9  # s of one agent step
P_BODY_FRAME = 10  # 1: position error in the body frame
P_START = 11  # x, y, z
P_BOX_LOW = 14  # x, y, z
P_BOX_HIGH = 17  # x, y, z
P_POSITION_LOW = 20
P_POSITION_HIGH = 21
P_YAW_LOW = 22
P_YAW_HIGH = 23
P_COMMAND_LOW = 24
P_COMMAND_HIGH = 25
P_BOTH_SIGNS = 26
N_PARAMETERS = 27

_TWO_PI = 2.0 * math.pi


@njit(nogil=True)
def wrap(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    wrapped = angle - _TWO_PI * math.floor((angle + math.pi) / _TWO_PI)
    return wrapped if wrapped < math.pi else -math.pi


@njit(nogil=True)
def noise(u: float, low: float, high: float, both_signs: bool) -> float:
    """Return noise of magnitude uniform in [low, high] from one uniform draw; `both_signs`: of random sign."""
    if not both_signs:
        return low + (high - low) * u
    v = 2.0 * u - 1.0
    magnitude = low + (high - low) * abs(v)
    return magnitude if v >= 0.0 else -magnitude


@compiled("dynamics")
def draw_scenarios(
    indices: Integers,
    F: Floats,
    C: Integers,
    P: Floats,
    test: int,
    pose: Floats,
) -> None:
    """Draw start yaw and waypoint of the environments in `indices` and clear their sums.

    Writes the start poses into `pose` (len(indices), 7). `test` is 0, or TEST or VALIDATION for a protocol's scenarios.
    """
    for k in range(indices.shape[0]):
        i = indices[k]
        u = uniform4(C[i, C_SEED], SCENARIO | test, 0, 0, C[i, C_EPISODE], C[i, C_ENVIRONMENT])
        yaw = wrap(_TWO_PI * u[0])
        squared = 0.0
        for axis in range(3):
            low, high = P[P_BOX_LOW + axis], P[P_BOX_HIGH + axis]
            F[i, F_WAYPOINT + axis] = low + (high - low) * u[1 + axis]
            F[i, F_START + axis] = P[P_START + axis]
            F[i, F_POSITION + axis] = P[P_START + axis]
            pose[k, axis] = P[P_START + axis]
            squared += (F[i, F_WAYPOINT + axis] - P[P_START + axis]) ** 2
        pose[k, 3] = math.cos(0.5 * yaw)
        pose[k, 4] = 0.0
        pose[k, 5] = 0.0
        pose[k, 6] = math.sin(0.5 * yaw)
        F[i, F_START_YAW] = yaw
        F[i, F_DISTANCE] = math.sqrt(squared)
        F[i, F_INITIAL_DISTANCE] = F[i, F_DISTANCE]
        for column in range(F_RETURN, F_DEPTH_MARGIN):
            F[i, column] = 0.0
        z = P[P_START + 2]
        F[i, F_DEPTH_MARGIN] = min(P[P_DEPTH_HIGH] - z, z - P[P_DEPTH_LOW])
        C[i, C_STEPS] = 0
        C[i, C_OUTCOME] = -1


@compiled("dynamics")
def add_command_noise(
    start: int,
    stop: int,
    action: Floats,
    C: Integers,
    P: Floats,
    scale: Floats,
    test: int,
    command: Floats,
) -> None:
    """Compute command = action + noise, clipped to [-1, 1]; `scale` (n_u,) turns the noise's unit into the action's."""
    n_u = action.shape[1]
    low, high, both = P[P_COMMAND_LOW], P[P_COMMAND_HIGH], P[P_BOTH_SIGNS] > 0.0
    silent = high == 0.0
    for i in range(start, stop):
        for block in range((n_u + 3) // 4):
            if silent:
                u = (0.0, 0.0, 0.0, 0.0)
            else:
                u = uniform4(
                    C[i, C_SEED], COMMAND | test, block, C[i, C_STEPS], C[i, C_EPISODE], C[i, C_ENVIRONMENT]
                )
            for entry in range(min(4, n_u - 4 * block)):
                j = 4 * block + entry
                value = action[i, j]
                if not silent:
                    value += noise(u[entry], low, high, both) * scale[j]
                command[i, j] = min(1.0, max(-1.0, value))


@compiled("dynamics")
def advance(
    start: int,
    stop: int,
    pose: Floats,
    action: Floats,
    previous: Floats,
    force: Floats,
    power: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    reward: Floats,
) -> int:
    """Compute reward, ends and sums after one agent step; return how many episodes ended (-1 - i: pose i is not finite).

    Reward and ends: docs/task.md. Precedence of the ends: leaving the depth limits, then the goal, then
    the last step. `force` (n, n_u) in N and `power` (n,) in W belong to the command that was applied.
    """
    n_u = action.shape[1]
    ended = 0
    for i in range(start, stop):
        x, y, z = pose[i, 0], pose[i, 1], pose[i, 2]
        ex = F[i, F_WAYPOINT] - x
        ey = F[i, F_WAYPOINT + 1] - y
        ez = F[i, F_WAYPOINT + 2] - z
        distance = math.sqrt(ex * ex + ey * ey + ez * ez)
        if not math.isfinite(distance):
            return -1 - i
        C[i, C_STEPS] += 1
        outcome = -1
        if z < P[P_DEPTH_LOW] or z > P[P_DEPTH_HIGH]:
            outcome = COLLISION
            r = P[P_COLLISION]
        elif distance < P[P_GOAL]:
            outcome = SUCCESS
            r = P[P_SUCCESS]
        else:
            if distance < F[i, F_DISTANCE]:
                r = P[P_K] * math.exp(-distance / P[P_LENGTH])
            else:
                r = P[P_REGRESS]
            if C[i, C_STEPS] >= P[P_MAX_STEPS]:
                outcome = TIMEOUT
        reward[i] = r
        C[i, C_OUTCOME] = outcome
        if outcome >= 0:
            ended += 1
        # Perpendicular distance to the line start-waypoint: |(p - a) x (b - a)| / |b - a|.
        ax, ay, az = F[i, F_START], F[i, F_START + 1], F[i, F_START + 2]
        bx, by, bz = F[i, F_WAYPOINT] - ax, F[i, F_WAYPOINT + 1] - ay, F[i, F_WAYPOINT + 2] - az
        px, py, pz = x - ax, y - ay, z - az
        cx, cy, cz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
        length_squared = bx * bx + by * by + bz * bz
        if length_squared > 0.0:
            deviation = math.sqrt((cx * cx + cy * cy + cz * cz) / length_squared)
        else:
            deviation = math.sqrt(px * px + py * py + pz * pz)
        dx, dy, dz = x - F[i, F_POSITION], y - F[i, F_POSITION + 1], z - F[i, F_POSITION + 2]
        norm_squared = 0.0
        change_squared = 0.0
        for j in range(n_u):
            norm_squared += force[i, j] * force[i, j]
            change = action[i, j] - previous[i, j]
            change_squared += change * change
            previous[i, j] = action[i, j]
        F[i, F_DISTANCE] = distance
        F[i, F_RETURN] += r
        F[i, F_DEVIATION] += deviation
        F[i, F_DEVIATION_SQUARED] += deviation * deviation
        F[i, F_COMMAND_NORM] += math.sqrt(norm_squared)
        F[i, F_ENERGY] += power[i] * P[P_DURATION]
        F[i, F_PATH] += math.sqrt(dx * dx + dy * dy + dz * dz)
        F[i, F_CHANGE] += math.sqrt(change_squared)
        F[i, F_DEPTH_MARGIN] = min(F[i, F_DEPTH_MARGIN], P[P_DEPTH_HIGH] - z, z - P[P_DEPTH_LOW])
        F[i, F_POSITION] = x
        F[i, F_POSITION + 1] = y
        F[i, F_POSITION + 2] = z
    return ended


@njit(nogil=True)
def observe_row(
    i: int,
    pose: Floats,
    offset: Floats,
    previous: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    test: int,
    observation: NDArray[np.float32],
) -> None:
    """Write the observation of one environment: yaw error, position error (3), previous action (n_u)."""
    both = P[P_BOTH_SIGNS] > 0.0
    w, qx, qy, qz = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    # Proportional to cosine and sine of yaw: turning the bearing by them saves a second arctangent.
    c = 1.0 - 2.0 * (qy * qy + qz * qz)
    s = 2.0 * (w * qz + qx * qy)
    ex = F[i, F_WAYPOINT] - pose[i, 0] - offset[i, 0]
    ey = F[i, F_WAYPOINT + 1] - pose[i, 1] - offset[i, 1]
    ez = F[i, F_WAYPOINT + 2] - pose[i, 2] - offset[i, 2]
    yaw_noise = offset[i, 3]
    if P[P_POSITION_HIGH] > 0.0 or P[P_YAW_HIGH] > 0.0:
        u = uniform4(C[i, C_SEED], SENSOR | test, 0, C[i, C_STEPS], C[i, C_EPISODE], C[i, C_ENVIRONMENT])
        ex -= noise(u[0], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
        ey -= noise(u[1], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
        ez -= noise(u[2], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
        yaw_noise += noise(u[3], P[P_YAW_LOW], P[P_YAW_HIGH], both)
    observation[i, 0] = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s) - yaw_noise)
    if P[P_BODY_FRAME] > 0.0:
        # Levelled body frame: what a vehicle with a heading reading alone can compute.
        yaw = math.atan2(s, c) + yaw_noise
        c, s = math.cos(yaw), math.sin(yaw)
        ex, ey = c * ex + s * ey, c * ey - s * ex
    observation[i, 1] = ex
    observation[i, 2] = ey
    observation[i, 3] = ez
    for j in range(previous.shape[1]):
        observation[i, 4 + j] = previous[i, j]


@compiled("dynamics")
def observe(
    start: int,
    stop: int,
    pose: Floats,
    offset: Floats,
    previous: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    test: int,
    observation: NDArray[np.float32],
) -> None:
    """Call `observe_row` for the environments start .. stop - 1."""
    for i in range(start, stop):
        observe_row(i, pose, offset, previous, F, C, P, test, observation)


@compiled("dynamics")
def observe_some(
    indices: Integers,
    pose: Floats,
    offset: Floats,
    previous: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    test: int,
    observation: NDArray[np.float32],
) -> None:
    """Call `observe_row` for the environments in `indices`."""
    for k in range(indices.shape[0]):
        observe_row(indices[k], pose, offset, previous, F, C, P, test, observation)
