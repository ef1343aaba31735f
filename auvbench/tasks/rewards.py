"""Rewards of one step, compiled. `config.rewards` has their parameters, docs/task.md their formulas and sources."""

from __future__ import annotations

import math

from numba import njit

from auvbench.tasks.kernels import (
    COLLISION,
    F_DISTANCE,
    F_REFERENCE_VELOCITY,
    F_REFERENCE_YAW,
    OUT_OF_BOUNDS,
    P_REWARD,
    P_REWARD_OWN,
    P_YAW,
    SUCCESS,
    Floats,
    velocity_row,
)

# Codes of the rewards, and the order of their parameters from P_REWARD_OWN on: that of the fields in `config.rewards`.
THESIS = 0
TRACKING = 1
EXPONENTIAL = 2
MARINEGYM_HOVER = 3


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
) -> float:
    """Return the reward of a step that led to `pose` and `outcome` (-1: the episode goes on)."""
    kind = int(P[P_REWARD])
    k, p = P[P_REWARD_OWN], P_REWARD_OWN
    failed = outcome in (COLLISION, OUT_OF_BOUNDS)
    if kind == THESIS:
        if failed:
            return float(P[p + 3])
        if outcome == SUCCESS:
            return float(P[p + 2])
        # F_DISTANCE is that of the step before.
        return float(k * math.exp(-distance / P[p + 1]) if distance < F[i, F_DISTANCE] else P[p + 4])
    if kind == EXPONENTIAL:
        return float(P[p + 2] if failed else k * math.exp(-P[p + 1] * distance))
    effort, change, thrust = 0.0, 0.0, 0.0
    n_u = action.shape[1]
    for j in range(n_u):
        thrust += action[i, j]
        effort += action[i, j] ** 2
        change += (action[i, j] - previous[i, j]) ** 2
    if kind == MARINEGYM_HOVER:
        return float(k * _marinegym_hover(i, distance, thrust, pose, velocity, F, P))
    r = (
        math.exp(-distance / P[p + 1])
        + P[p + 2] * math.exp(-abs(yaw_error) / P[p + 3])
        - P[p + 6] * effort / n_u
        - P[p + 7] * change / n_u
    )
    if P[p + 4] > 0.0 and P[P_YAW] > 0.0:
        squared = 0.0
        for axis in range(3):
            squared += (F[i, F_REFERENCE_VELOCITY + axis] - velocity_row(i, pose, velocity, axis)) ** 2
        r += P[p + 4] * math.exp(-math.sqrt(squared) / P[p + 5])
    if outcome == SUCCESS:
        r += P[p + 8]
    elif failed:
        r += P[p + 9]
    return float(k * r)


@njit(nogil=True)
def _marinegym_hover(
    i: int, distance: float, thrust: float, pose: Floats, velocity: Floats, F: Floats, P: Floats
) -> float:
    """Return MarineGym's reward: marinegym/envs/single/hover.py at commit a72ed67; `thrust` is the sum of the action."""
    p = P_REWARD_OWN
    w, x, y, z = pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6]
    # The bow's direction, and that of the reference.
    hx = math.cos(F[i, F_REFERENCE_YAW]) - (1.0 - 2.0 * (y * y + z * z))
    hy = math.sin(F[i, F_REFERENCE_YAW]) - 2.0 * (x * y + w * z)
    hz = -2.0 * (x * z - w * y)
    up = 1.0 - 2.0 * (x * x + y * y)
    near = 0.5 / (1.0 + P[p + 1] ** 2 * (distance * distance + hx * hx + hy * hy + hz * hz))
    upright = 0.5 * (up + 1.0)
    roll_rate, pitch_rate, yaw_rate = velocity[i, 3], velocity[i, 4], velocity[i, 5]
    spin = 2.0 * (x * z - w * y) * roll_rate + 2.0 * (y * z + w * x) * pitch_rate + up * yaw_rate
    return float(
        near + near * (upright * upright + 1.0 / (1.0 + spin**4)) + P[p + 2] * math.exp(-abs(thrust))
    )
