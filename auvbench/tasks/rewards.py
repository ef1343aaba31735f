"""Compute the reward of one step. `config.rewards` has the parameters, and docs/task.md has the formulas and sources.

A reward is a function of the episode `e` after the step (`e.outcome` is GOES_ON if the episode continues), the vehicle `v`,
and the parameters `p` with the names of the reward's schema. A reward may have a second function (`sights`), which gets the solids of
a world; the value of the second function is added to the reward.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from auvbench.config import rewards
from auvbench.registry import REWARDS, resolve
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    OUT_OF_BOUNDS,
    SUCCESS,
    TIMEOUT,
    Vehicle,
    roll_pitch,
    row,
    triple,
    world_velocity,
    wrap,
    yaw,
)


def function_of(reward: rewards.Reward) -> Callable[..., float]:
    """Return the function that computes a reward."""
    function: Callable[..., float] = resolve(REWARDS[reward.name].code)
    return function


def sight_of(reward: rewards.Reward) -> Callable[..., float] | None:
    """Return the function of a reward's term that depends on solids; None if the reward does not depend on solids."""
    named = REWARDS[reward.name].sight
    return resolve(named) if named else None


@row
def failed(e: Record) -> bool:
    """Return whether the step ended the episode by a collision or out of bounds."""
    return bool(e.outcome in (COLLISION, OUT_OF_BOUNDS))


@row
def thesis(e: Record, v: Vehicle, p: Record) -> float:
    """Return the reward of the original study (equation 2.1), only for waypoints, where `to_go` is the distance."""
    if failed(e):
        return float(p.collision)
    if e.outcome == SUCCESS:
        return float(p.success)
    return float(p.k * math.exp(-e.to_go / p.length) if e.to_go < e.last_distance else p.regress)


@row
def exponential(e: Record, v: Vehicle, p: Record) -> float:
    """Return a reward that depends only on the distance to go, or `p.failure` after a failure."""
    return float(p.failure if failed(e) else p.k * math.exp(-p.rate * e.to_go))


@row
def effort(v: Vehicle) -> float:
    """Return the sum of the squares of the action."""
    squares = 0.0
    for j in range(v.action.shape[0]):
        squares += v.action[j] ** 2
    return squares


@row
def errors(e: Record, v: Vehicle, p: Record) -> float:
    """Return the terms of distance, yaw, effort, change and velocity that `tracking` and `goal` share."""
    n_u = v.action.shape[0]
    change = 0.0
    for j in range(n_u):
        change += (v.action[j] - v.previous[j]) ** 2
    r = (
        math.exp(-e.to_go / p.length)
        + p.yaw * math.exp(-abs(e.yaw_error) / p.yaw_length)
        - p.effort * effort(v) / n_u
        - p.change * change / n_u
    )
    if p.velocity > 0.0 and p.has_yaw > 0:
        (asked_x, asked_y, asked_z), (vx, vy, vz) = triple(e.reference_velocity), world_velocity(v)
        squared = (asked_x - vx) ** 2 + (asked_y - vy) ** 2 + (asked_z - vz) ** 2
        r += p.velocity * math.exp(-math.sqrt(squared) / p.velocity_length)
    return float(r)


@row
def end(e: Record, p: Record) -> float:
    """Return the reward for success or failure, 0 in other steps."""
    if e.outcome == SUCCESS:
        return float(p.success)
    return float(p.failure if failed(e) else 0.0)


@row
def tracking(e: Record, v: Vehicle, p: Record) -> float:
    """Return a reward for small errors and little effort."""
    return float(p.k * (errors(e, v, p) + end(e, p)))


@row
def goal(e: Record, v: Vehicle, p: Record) -> float:
    """Return the `tracking` reward plus a term that grows only near the goal."""
    r = errors(e, v, p)
    r += p.fine * math.exp(-e.to_go / p.fine_length)
    return float(p.k * (r + end(e, p)))


@row
def marinegym_hover(e: Record, v: Vehicle, p: Record) -> float:
    """Return MarineGym's reward: marinegym/envs/single/hover.py at commit a72ed67."""
    thrust = 0.0
    for j in range(v.action.shape[0]):
        thrust += v.action[j]
    w, x, y, z = v.attitude
    # The direction of the reference minus the direction of the bow.
    hx = math.cos(e.reference_yaw) - (1.0 - 2.0 * (y * y + z * z))
    hy = math.sin(e.reference_yaw) - 2.0 * (x * y + w * z)
    hz = -2.0 * (x * z - w * y)
    up = 1.0 - 2.0 * (x * x + y * y)
    near = 0.5 / (1.0 + p.scale**2 * (e.to_go * e.to_go + hx * hx + hy * hy + hz * hz))
    upright = 0.5 * (up + 1.0)
    roll_rate, pitch_rate, yaw_rate = v.rates
    spin = 2.0 * (x * z - w * y) * roll_rate + 2.0 * (y * z + w * x) * pitch_rate + up * yaw_rate
    steady = near * (upright * upright + 1.0 / (1.0 + spin**4))
    return float(p.k * (near + steady + p.effort * math.exp(-abs(thrust))))


@row
def gym_auv_path(e: Record, v: Vehicle, p: Record) -> float:
    """Return gym-auv's reward: step_reward of gym_auv/envs/pathcolav3d.py at commit 90f88ec."""
    tx, ty, tz = triple(e.reference_velocity)
    level = math.sqrt(tx * tx + ty * ty)
    # At the end of the path the reference has a yaw, but no velocity.
    course, climb = e.reference_yaw, math.atan2(tz, level)
    (x, y, z), (to_x, to_y, to_z) = v.position, triple(e.reference)
    dx, dy, dz = x - to_x, y - to_y, z - to_z
    # Cross-track errors, to port and up.
    port = dy * math.cos(course) - dx * math.sin(course)
    up = dz * math.cos(climb) - (dx * math.cos(course) + dy * math.sin(course)) * math.sin(climb)
    course -= math.atan2(port, p.look_ahead)
    climb -= math.atan2(up, math.sqrt(port * port + p.look_ahead**2))
    vx, vy, vz = world_velocity(v)
    course_error = wrap(math.atan2(vy, vx) - course) / math.pi
    climb_error = wrap(math.atan2(vz, math.sqrt(vx * vx + vy * vy)) - climb) / math.pi
    roll, _ = roll_pitch(v)
    roll_rate, _, _ = v.rates
    return float(
        p.k
        * (
            -p.course * (course_error**2 + climb_error**2)
            - p.roll * roll**2
            - p.roll_rate * roll_rate**2
            - p.effort * effort(v)
        )
    )


@row
def gym_dockauv(e: Record, v: Vehicle, p: Record) -> float:
    """Return gym_dockauv's reward: reward_step of gym_dockauv/envs/docking3d.py, set 1, at commit 6b36b5b."""
    (x, y, z), (to_x, to_y, to_z) = v.position, triple(e.goal)
    dx, dy, dz = to_x - x, to_y - y, to_z - z
    level = math.sqrt(dx * dx + dy * dy)
    distance = math.sqrt(level * level + dz * dz)
    # 0 at the goal's radius, 1 at the bounds.
    away = 1.0 - min(1.0, max(0.0, math.log(max(distance, 1e-3) / p.far) / math.log(p.near / p.far)))
    roll, pitch = roll_pitch(v)
    elevation = pitch - math.atan2(dz, level)
    heading = wrap(math.atan2(dy, dx) - yaw(v))
    # Rates of the Euler angles. The source's episodes end at a pitch of 60 degrees; beyond this pitch, the divisor stays constant.
    roll_rate, q, r = v.rates
    turn = (q * math.sin(roll) + r * math.cos(roll)) / max(0.5, math.cos(pitch))
    roll_rate -= turn * math.sin(pitch)
    pitch_rate = q * math.cos(roll) - r * math.sin(roll)
    rates = roll_rate**2 + pitch_rate**2 + turn**2
    quarter = 0.5 * math.pi
    result = (
        -p.distance * away
        - p.elevation * (elevation / quarter) ** 2
        - p.heading * (heading / math.pi) ** 2
        - p.attitude * (roll * roll + pitch * pitch) / quarter**2
        - p.rates * rates / quarter**2
        - p.effort * (effort(v) / v.action.shape[0] ** 2)
    )
    if e.outcome == SUCCESS:
        result += p.success
    elif e.outcome == OUT_OF_BOUNDS:
        result += p.out_of_bounds
    elif e.outcome == TIMEOUT:
        result += p.timeout
    elif e.outcome == COLLISION:
        result += p.collision
    return float(p.k * result)
