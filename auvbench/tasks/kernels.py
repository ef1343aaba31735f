"""What all tasks share, compiled: columns, command noise, sums and observation, for N environments.

One row per environment in two arrays: `F` (floats, columns `F_*`) and `C` (integers, columns `C_*`). Every
draw is a function of (seed, stream, environment, episode, step, channel), so a row never depends on its
neighbours or on the batch size. The file of a task has its own draw and advance, which call the `*_row` functions.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import COMMAND, SENSOR, uniform4

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Columns of F. Sums run over the steps of the episode.
F_REFERENCE = 0  # x, y, z in m: where the vehicle is to be now
F_START = 3  # x, y, z in m
F_START_YAW = 6  # rad
F_DISTANCE = 7  # m, to the reference, now
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
# Of tasks with a yaw of their own; the waypoint task has no more columns than those above.
F_REFERENCE_YAW = 20  # rad
F_REFERENCE_VELOCITY = 21  # x, y, z in m/s, world axes
F_ERROR_SQUARED = 24  # sum of m^2
F_YAW_SQUARED = 25  # sum of rad^2
F_COUNTED = 26  # steps in these two sums
F_OWN = 27  # the first column of a task's own

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
OUT_OF_BOUNDS = 3

# Entries of the parameter vector P.
P_DEPTH_LOW = 0
P_DEPTH_HIGH = 1
P_MAX_STEPS = 2
P_DURATION = 3  # s of one agent step
P_BODY_FRAME = 4  # 1: position error in the body frame
P_POSITION_LOW = 5
P_POSITION_HIGH = 6
P_YAW_LOW = 7
P_YAW_HIGH = 8
P_COMMAND_LOW = 9
P_COMMAND_HIGH = 10
P_BOTH_SIGNS = 11
P_YAW = 12  # 1: the task has a yaw of its own, F_REFERENCE_YAW; 0: its yaw is the bearing of the reference
P_PREVIEW = 13  # the first column of F with the previewed points
P_PREVIEWED = 14  # previewed points
P_HISTORY = 15  # stacked observations
P_REWARD = 16  # place of the reward in registry.REWARDS
P_REWARD_OWN = 17  # the parameters of the reward, in the order of its schema
P_OWN = 32  # the first entry of a task's own

# Codes of the blocks of an observation.
YAW_ERROR = 0
POSITION_ERROR = 1
VELOCITY_ERROR = 2
VELOCITY = 3
ANGULAR_VELOCITY = 4
GRAVITY = 5
PREVIOUS_ACTION = 6
PREVIEW = 7
DEPTH_MARGIN = 8
GOAL_ERROR = 9

F_GOAL = F_OWN  # x, y, z in m, of a task with a goal that is not its reference

SHALLOWEST = 1.0
"""m: no start is drawn nearer to a depth limit, unless what it is drawn round is nearer"""

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


@njit(nogil=True)
def begin_row(i: int, k: int, yaw: float, F: Floats, C: Integers, P: Floats, pose: Floats) -> None:
    """Begin an episode at F_START, level, at rest: write its pose (row k) and clear its sums. The reference is set."""
    for axis in range(3):
        F[i, F_POSITION + axis] = F[i, F_START + axis]
        pose[k, axis] = F[i, F_START + axis]
    pose[k, 3] = math.cos(0.5 * yaw)
    pose[k, 4] = 0.0
    pose[k, 5] = 0.0
    pose[k, 6] = math.sin(0.5 * yaw)
    F[i, F_START_YAW] = yaw
    F[i, F_DISTANCE] = distance_row(i, pose, k, F)
    F[i, F_INITIAL_DISTANCE] = F[i, F_DISTANCE]
    for column in range(F_RETURN, F_DEPTH_MARGIN):
        F[i, column] = 0.0
    z = F[i, F_START + 2]
    F[i, F_DEPTH_MARGIN] = min(P[P_DEPTH_HIGH] - z, z - P[P_DEPTH_LOW])
    if P[P_YAW] > 0.0:
        F[i, F_ERROR_SQUARED] = 0.0
        F[i, F_YAW_SQUARED] = 0.0
        F[i, F_COUNTED] = 0.0
    C[i, C_STEPS] = 0
    C[i, C_OUTCOME] = -1


@njit(nogil=True)
def rise_row(v: float, centre: float, radius: float, P: Floats) -> float:
    """Return the height of a place on a sphere over its centre, as a share of the radius, by a uniform draw.

    The place is uniform on the part of the sphere where starts may lie: at least SHALLOWEST within the depth limits, or
    as near to them as the centre.

    Args:
        v: the draw.
        centre: z of the centre in m, within the depth limits.
        radius: m.
        P: parameters of the task.
    """
    share = 2.0 * v - 1.0
    if radius <= 0.0:
        return share
    bottom = max(-1.0, min(0.0, P[P_DEPTH_LOW] + SHALLOWEST - centre) / radius)
    top = min(1.0, max(0.0, P[P_DEPTH_HIGH] - SHALLOWEST - centre) / radius)
    return float(0.5 * (bottom + top) + 0.5 * (top - bottom) * share)


@njit(nogil=True)
def ball_row(i: int, u: float, v: float, w: float, radius: float, F: Floats, P: Floats | None = None) -> None:
    """Put F_START into a ball of a radius in m round the reference, by three uniform draws.

    It is uniform in the ball. With the parameters P of the task it stays within the depth limits (`rise_row`).
    """
    length = radius * u ** (1.0 / 3.0)
    z = 2.0 * v - 1.0
    if P is not None:
        z = rise_row(v, F[i, F_REFERENCE + 2], length, P)
    level = length * math.sqrt(1.0 - z * z)
    F[i, F_START] = F[i, F_REFERENCE] + level * math.cos(_TWO_PI * w)
    F[i, F_START + 1] = F[i, F_REFERENCE + 1] + level * math.sin(_TWO_PI * w)
    F[i, F_START + 2] = F[i, F_REFERENCE + 2] + length * z


@njit(nogil=True)
def distance_row(i: int, pose: Floats, k: int, F: Floats) -> float:
    """Return the distance in m of pose k from the reference of environment i."""
    ex = F[i, F_REFERENCE] - pose[k, 0]
    ey = F[i, F_REFERENCE + 1] - pose[k, 1]
    ez = F[i, F_REFERENCE + 2] - pose[k, 2]
    return math.sqrt(ex * ex + ey * ey + ez * ez)


@njit(nogil=True)
def yaw_row(i: int, pose: Floats) -> float:
    """Return the yaw in rad of pose i."""
    w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@njit(nogil=True)
def velocity_row(i: int, pose: Floats, velocity: Floats, axis: int) -> float:
    """Return a component of the velocity of vehicle i in m/s, world axes."""
    w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    u, v, m = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    if axis == 0:
        return float(
            (1.0 - 2.0 * (y * y + z * z)) * u + 2.0 * (x * y - w * z) * v + 2.0 * (x * z + w * y) * m
        )
    if axis == 1:
        return float(
            2.0 * (x * y + w * z) * u + (1.0 - 2.0 * (x * x + z * z)) * v + 2.0 * (y * z - w * x) * m
        )
    return float(2.0 * (x * z - w * y) * u + 2.0 * (y * z + w * x) * v + (1.0 - 2.0 * (x * x + y * y)) * m)


@njit(nogil=True)
def leaves_water(i: int, pose: Floats, P: Floats) -> bool:
    """Return whether pose i is beyond a depth limit."""
    return bool(pose[i, 2] < P[P_DEPTH_LOW] or pose[i, 2] > P[P_DEPTH_HIGH])


@njit(nogil=True)
def add_errors_row(i: int, distance: float, yaw_error: float, F: Floats) -> None:
    """Add the errors of a step to the sums of their squares."""
    F[i, F_ERROR_SQUARED] += distance * distance
    F[i, F_YAW_SQUARED] += yaw_error * yaw_error
    F[i, F_COUNTED] += 1.0


@njit(nogil=True, forceinline=True)
def end_row(
    i: int,
    outcome: int,
    r: float,
    distance: float,
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
    """Write reward and outcome of a step and add it to the sums; return 1 if the episode ended, else 0."""
    reward[i] = r
    C[i, C_OUTCOME] = outcome
    x, y, z = pose[i, 0], pose[i, 1], pose[i, 2]
    dx, dy, dz = x - F[i, F_POSITION], y - F[i, F_POSITION + 1], z - F[i, F_POSITION + 2]
    norm_squared = 0.0
    change_squared = 0.0
    for j in range(action.shape[1]):
        norm_squared += force[i, j] * force[i, j]
        change = action[i, j] - previous[i, j]
        change_squared += change * change
        previous[i, j] = action[i, j]
    F[i, F_DISTANCE] = distance
    F[i, F_RETURN] += r
    F[i, F_COMMAND_NORM] += math.sqrt(norm_squared)
    F[i, F_ENERGY] += power[i] * P[P_DURATION]
    F[i, F_PATH] += math.sqrt(dx * dx + dy * dy + dz * dz)
    F[i, F_CHANGE] += math.sqrt(change_squared)
    F[i, F_DEPTH_MARGIN] = min(F[i, F_DEPTH_MARGIN], P[P_DEPTH_HIGH] - z, z - P[P_DEPTH_LOW])
    F[i, F_POSITION] = x
    F[i, F_POSITION + 1] = y
    F[i, F_POSITION + 2] = z
    return 1 if outcome >= 0 else 0


@compiled("dynamics")
def observe(
    indices: Integers,
    pose: Floats,
    velocity: Floats,
    offset: Floats,
    previous: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    blocks: Integers,
    test: int,
    observation: NDArray[np.float32],
) -> None:
    """Write the blocks of the observations of the environments in `indices`, the newest observation first."""
    both = P[P_BOTH_SIGNS] > 0.0
    for row in range(indices.shape[0]):
        i = indices[row]
        w, qx, qy, qz = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
        # Proportional to cosine and sine of yaw: turning the bearing by them saves a second arctangent.
        c = 1.0 - 2.0 * (qy * qy + qz * qz)
        s = 2.0 * (w * qz + qx * qy)
        ex = F[i, F_REFERENCE] - pose[i, 0] - offset[i, 0]
        ey = F[i, F_REFERENCE + 1] - pose[i, 1] - offset[i, 1]
        ez = F[i, F_REFERENCE + 2] - pose[i, 2] - offset[i, 2]
        yaw_noise = offset[i, 3]
        if P[P_POSITION_HIGH] > 0.0 or P[P_YAW_HIGH] > 0.0:
            u = uniform4(C[i, C_SEED], SENSOR | test, 0, C[i, C_STEPS], C[i, C_EPISODE], C[i, C_ENVIRONMENT])
            ex -= noise(u[0], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
            ey -= noise(u[1], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
            ez -= noise(u[2], P[P_POSITION_LOW], P[P_POSITION_HIGH], both)
            yaw_noise += noise(u[3], P[P_YAW_LOW], P[P_YAW_HIGH], both)
        if P[P_YAW] > 0.0:
            yaw_error = wrap(F[i, F_REFERENCE_YAW] - math.atan2(s, c) - yaw_noise)
        else:
            yaw_error = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s) - yaw_noise)
        # The reading of the position, for blocks that are relative to another point.
        rx, ry, rz = F[i, F_REFERENCE] - ex, F[i, F_REFERENCE + 1] - ey, F[i, F_REFERENCE + 2] - ez
        if P[P_BODY_FRAME] > 0.0:
            # Levelled body frame: what a vehicle with a heading reading alone can compute.
            yaw = math.atan2(s, c) + yaw_noise
            c, s = math.cos(yaw), math.sin(yaw)
            ex, ey = c * ex + s * ey, c * ey - s * ex
        stacked = int(P[P_HISTORY])
        if stacked > 1:
            size = observation.shape[1] // stacked
            for column in range(observation.shape[1] - 1, size - 1, -1):
                observation[i, column] = observation[i, column - size]
        at = 0
        for b in range(blocks.shape[0]):
            block = blocks[b]
            if block == YAW_ERROR:
                observation[i, at] = yaw_error
                at += 1
            elif block == POSITION_ERROR:
                observation[i, at] = ex
                observation[i, at + 1] = ey
                observation[i, at + 2] = ez
                at += 3
            elif block == PREVIOUS_ACTION:
                for j in range(previous.shape[1]):
                    observation[i, at + j] = previous[i, j]
                at += previous.shape[1]
            elif block in (VELOCITY, ANGULAR_VELOCITY):
                first = 0 if block == VELOCITY else 3
                for axis in range(3):
                    observation[i, at + axis] = velocity[i, first + axis]
                at += 3
            elif block == VELOCITY_ERROR:
                vx = F[i, F_REFERENCE_VELOCITY] - velocity_row(i, pose, velocity, 0)
                vy = F[i, F_REFERENCE_VELOCITY + 1] - velocity_row(i, pose, velocity, 1)
                vz = F[i, F_REFERENCE_VELOCITY + 2] - velocity_row(i, pose, velocity, 2)
                observation[i, at] = c * vx + s * vy
                observation[i, at + 1] = c * vy - s * vx
                observation[i, at + 2] = vz
                at += 3
            elif block == GRAVITY:
                observation[i, at] = -2.0 * (qx * qz - w * qy)
                observation[i, at + 1] = -2.0 * (qy * qz + w * qx)
                observation[i, at + 2] = 2.0 * (qx * qx + qy * qy) - 1.0
                at += 3
            elif block == PREVIEW:
                for point in range(int(P[P_PREVIEWED])):
                    column = int(P[P_PREVIEW]) + 3 * point
                    px, py = F[i, column] - rx, F[i, column + 1] - ry
                    observation[i, at] = c * px + s * py
                    observation[i, at + 1] = c * py - s * px
                    observation[i, at + 2] = F[i, column + 2] - rz
                    at += 3
            elif block == DEPTH_MARGIN:
                observation[i, at] = min(P[P_DEPTH_HIGH] - rz, rz - P[P_DEPTH_LOW])
                at += 1
            elif block == GOAL_ERROR:
                px, py = F[i, F_GOAL] - rx, F[i, F_GOAL + 1] - ry
                observation[i, at] = c * px + s * py
                observation[i, at + 1] = c * py - s * px
                observation[i, at + 2] = F[i, F_GOAL + 2] - rz
                at += 3
        if stacked > 1 and C[i, C_STEPS] == 0:
            for column in range(at, observation.shape[1]):
                observation[i, column] = observation[i, column - at]
