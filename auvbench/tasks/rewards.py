"""Rewards of one step, compiled. `config.rewards` has their parameters, docs/task.md their formulas and sources."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numba import cfunc, njit, types

from auvbench.tasks import kernels as k
from auvbench.tasks.kernels import Floats

# Codes of the rewards, and the order of their parameters from P_REWARD_OWN on: that of the fields in `config.rewards`.
FOREIGN = -1  # of an installed package
THESIS = 0
TRACKING = 1
EXPONENTIAL = 2
MARINEGYM_HOVER = 3
GYM_AUV_PATH = 4
GYM_DOCKAUV = 5
GOAL = 6
# 7, path: the formula of TRACKING.

_TABLE = types.Array(types.float64, 2, "C")
_SIGNATURE = types.float64(
    types.int64,
    types.int64,
    types.float64,
    types.float64,
    *(_TABLE,) * 5,
    types.Array(types.float64, 1, "C"),
)
"""of a reward of an installed package"""


def hook_of(function: Callable[..., float]) -> Any:
    """Compile the reward of an installed package.

    A kernel calls it by address, so that numba keeps one kernel on disk for all rewards; the reward itself is compiled in
    each process.

    Args:
        function: `(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, p) -> float`, of plain Python
            or `njit`; the arguments are those of `reward_row`, and p the reward's parameters in the order of its schema.
    """
    return cfunc(_SIGNATURE)(getattr(function, "py_func", function))


@njit(nogil=True)
def thesis_row(i: int, outcome: int, distance: float, F: Floats, P: Floats) -> float:
    """Return the reward of the original study: equation 2.1."""
    p = k.P_REWARD_OWN
    if outcome in (k.COLLISION, k.OUT_OF_BOUNDS):
        return float(P[p + 3])
    if outcome == k.SUCCESS:
        return float(P[p + 2])
    # F_DISTANCE is that of the step before.
    return float(P[p] * math.exp(-distance / P[p + 1]) if distance < F[i, k.F_DISTANCE] else P[p + 4])


@njit(nogil=True)
def reward_row(
    i: int,
    outcome: int,
    distance: float,
    yaw_error: float,
    pose: Floats,
    velocity: Floats,
    action: Floats,
    previous: Floats,
    F: Floats,
    P: Floats,
    hook: Any,
) -> float:
    """Return the reward of a step that led to `pose` and `outcome` (-1: the episode goes on).

    `hook`: the reward of an installed package (`hook_of`), or None.
    """
    if hook is not None:
        row = hook(
            i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P[k.P_REWARD_OWN : k.P_OWN]
        )
        return float(row)
    kind = int(P[k.P_REWARD])
    scale, p = P[k.P_REWARD_OWN], k.P_REWARD_OWN
    failed = outcome in (k.COLLISION, k.OUT_OF_BOUNDS)
    if kind == THESIS:
        return thesis_row(i, outcome, distance, F, P)
    if kind == EXPONENTIAL:
        return float(P[p + 2] if failed else scale * math.exp(-P[p + 1] * distance))
    effort, change, thrust = 0.0, 0.0, 0.0
    n_u = action.shape[1]
    for j in range(n_u):
        thrust += action[i, j]
        effort += action[i, j] ** 2
        change += (action[i, j] - previous[i, j]) ** 2
    if kind == MARINEGYM_HOVER:
        return float(scale * _marinegym_hover(i, distance, thrust, pose, velocity, F, P))
    if kind == GYM_AUV_PATH:
        return float(scale * _gym_auv_path(i, effort, pose, velocity, F, P))
    if kind == GYM_DOCKAUV:
        return float(scale * _gym_dockauv(i, outcome, effort / n_u**2, pose, velocity, F, P))
    r = (
        math.exp(-distance / P[p + 1])
        + P[p + 2] * math.exp(-abs(yaw_error) / P[p + 3])
        - P[p + 6] * effort / n_u
        - P[p + 7] * change / n_u
    )
    if P[p + 4] > 0.0 and P[k.P_YAW] > 0.0:
        squared = 0.0
        for axis in range(3):
            squared += (F[i, k.F_REFERENCE_VELOCITY + axis] - k.velocity_row(i, pose, velocity, axis)) ** 2
        r += P[p + 4] * math.exp(-math.sqrt(squared) / P[p + 5])
    if kind == GOAL:
        r += P[p + 10] * math.exp(-distance / P[p + 11])
    if outcome == k.SUCCESS:
        r += P[p + 8]
    elif failed:
        r += P[p + 9]
    return float(scale * r)


@njit(nogil=True)
def _marinegym_hover(
    i: int, distance: float, thrust: float, pose: Floats, velocity: Floats, F: Floats, P: Floats
) -> float:
    """Return MarineGym's reward: marinegym/envs/single/hover.py at commit a72ed67; `thrust` is the sum of the action."""
    p = k.P_REWARD_OWN
    w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    # The bow's direction, and that of the reference.
    hx = math.cos(F[i, k.F_REFERENCE_YAW]) - (1.0 - 2.0 * (y * y + z * z))
    hy = math.sin(F[i, k.F_REFERENCE_YAW]) - 2.0 * (x * y + w * z)
    hz = -2.0 * (x * z - w * y)
    up = 1.0 - 2.0 * (x * x + y * y)
    near = 0.5 / (1.0 + P[p + 1] ** 2 * (distance * distance + hx * hx + hy * hy + hz * hz))
    upright = 0.5 * (up + 1.0)
    roll_rate, pitch_rate, yaw_rate = velocity[i, 3], velocity[i, 4], velocity[i, 5]
    spin = 2.0 * (x * z - w * y) * roll_rate + 2.0 * (y * z + w * x) * pitch_rate + up * yaw_rate
    return float(
        near + near * (upright * upright + 1.0 / (1.0 + spin**4)) + P[p + 2] * math.exp(-abs(thrust))
    )


@njit(nogil=True)
def roll_pitch(i: int, pose: Floats) -> tuple[float, float]:
    """Return roll and pitch of pose i in rad, the bow up."""
    w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, -math.asin(min(1.0, max(-1.0, 2.0 * (w * y - x * z))))


@njit(nogil=True)
def _gym_auv_path(i: int, effort: float, pose: Floats, velocity: Floats, F: Floats, P: Floats) -> float:
    """Return gym-auv's reward: step_reward of gym_auv/envs/pathcolav3d.py at commit 90f88ec; `effort`: sum of squares."""
    p = k.P_REWARD_OWN
    tx, ty, tz = (
        F[i, k.F_REFERENCE_VELOCITY],
        F[i, k.F_REFERENCE_VELOCITY + 1],
        F[i, k.F_REFERENCE_VELOCITY + 2],
    )
    level = math.sqrt(tx * tx + ty * ty)
    # At the end of the path the reference has a yaw, but no velocity.
    course, climb = F[i, k.F_REFERENCE_YAW], math.atan2(tz, level)
    dx, dy = pose[i, 0] - F[i, k.F_REFERENCE], pose[i, 1] - F[i, k.F_REFERENCE + 1]
    dz = pose[i, 2] - F[i, k.F_REFERENCE + 2]
    # Cross-track errors, to port and up.
    port = dy * math.cos(course) - dx * math.sin(course)
    up = dz * math.cos(climb) - (dx * math.cos(course) + dy * math.sin(course)) * math.sin(climb)
    course -= math.atan2(port, P[p + 1])
    climb -= math.atan2(up, math.sqrt(port * port + P[p + 1] ** 2))
    vx, vy = k.velocity_row(i, pose, velocity, 0), k.velocity_row(i, pose, velocity, 1)
    vz = k.velocity_row(i, pose, velocity, 2)
    course_error = k.wrap(math.atan2(vy, vx) - course) / math.pi
    climb_error = k.wrap(math.atan2(vz, math.sqrt(vx * vx + vy * vy)) - climb) / math.pi
    roll, _ = roll_pitch(i, pose)
    return float(
        -P[p + 2] * (course_error**2 + climb_error**2)
        - P[p + 3] * roll**2
        - P[p + 4] * velocity[i, 3] ** 2
        - P[p + 5] * effort
    )


@njit(nogil=True)
def _gym_dockauv(
    i: int, outcome: int, effort: float, pose: Floats, velocity: Floats, F: Floats, P: Floats
) -> float:
    """Return gym_dockauv's reward: reward_step of gym_dockauv/envs/docking3d.py, set 1, at commit 6b36b5b."""
    p = k.P_REWARD_OWN
    dx, dy = F[i, k.F_GOAL] - pose[i, 0], F[i, k.F_GOAL + 1] - pose[i, 1]
    dz = F[i, k.F_GOAL + 2] - pose[i, 2]
    level = math.sqrt(dx * dx + dy * dy)
    distance, near, far = math.sqrt(level * level + dz * dz), P[p + 2], P[p + 3]
    # 0 at the goal's radius, 1 at the bounds.
    away = 1.0 - min(1.0, max(0.0, math.log(max(distance, 1e-3) / far) / math.log(near / far)))
    roll, pitch = roll_pitch(i, pose)
    elevation = pitch - math.atan2(dz, level)
    heading = k.wrap(math.atan2(dy, dx) - k.yaw_row(i, pose))
    # Rates of the Euler angles. The source's episodes end at a pitch of 60 degrees: the rates grow no more beyond it.
    q, r = velocity[i, 4], velocity[i, 5]
    turn = (q * math.sin(roll) + r * math.cos(roll)) / max(0.5, math.cos(pitch))
    roll_rate = velocity[i, 3] - turn * math.sin(pitch)
    pitch_rate = q * math.cos(roll) - r * math.sin(roll)
    rates = roll_rate**2 + pitch_rate**2 + turn**2
    quarter = 0.5 * math.pi
    result = (
        -P[p + 1] * away
        - P[p + 4] * (elevation / quarter) ** 2
        - P[p + 5] * (heading / math.pi) ** 2
        - P[p + 6] * (roll * roll + pitch * pitch) / quarter**2
        - P[p + 7] * rates / quarter**2
        - P[p + 8] * effort
    )
    if outcome == k.SUCCESS:
        result += P[p + 9]
    elif outcome == k.OUT_OF_BOUNDS:
        result += P[p + 10]
    elif outcome == k.TIMEOUT:
        result += P[p + 11]
    elif outcome == k.COLLISION:
        result += P[p + 12]
    return float(result)
