"""Compiled functions for one episode, which tasks and rewards share.

In these functions, `e` is the record of an episode (`records.EPISODE` and the task's own fields), `v` the present vehicle,
and `p` the record of the parameters. Every draw is a function of (seed, stream, environment, episode, step, channel), so
an episode does not depend on other episodes or on the size of the batch.
"""

from __future__ import annotations

import math
import warnings
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning
from numpy.typing import NDArray

from auvbench import blocks
from auvbench.dynamics.compiled import borrowed as borrowed
from auvbench.dynamics.compiled import compiled, inline
from auvbench.dynamics.random import COMMAND, MESSAGE, SCENARIO, uniform4
from auvbench.dynamics.vectors import product, rotation_matrix
from auvbench.tasks.records import Record

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]

SUCCESS = 0
COLLISION = 1
TIMEOUT = 2
OUT_OF_BOUNDS = 3
GOES_ON = -1

VEHICLE = 1 << 24
"""Increment of the counter `environment` from one vehicle of a team to the next"""

SHALLOWEST = 1.0
"""Smallest distance of a drawn start from a depth limit, m; if the centre of the draw is closer to the limit, the centre's distance"""

_TWO_PI = 2.0 * math.pi

# Before numba compiles a function for the record of one task, it checks whether code for another task's record fits, and warns.
warnings.filterwarnings("ignore", ".*has been considered a subtype of", NumbaExperimentalFeatureWarning)


class Vehicle(NamedTuple):
    """A vehicle after an agent step, without noise."""

    position: Vector  # m, world axes
    attitude: Quaternion  # unit quaternion (w, x, y, z)
    velocity: Vector  # m/s, body axes (forward, port, up)
    rates: Vector  # rad/s, body axes
    action: Floats  # (n_u,) in [-1, 1], of this step
    previous: Floats  # (n_u,) action of the previous step
    force: Floats  # (n_u,) commanded force before lag and faults, N; 0 for actuators that are not thrusters
    power: float  # electrical power of the command, W


row = inline
"""Compile a function of one episode into its callers."""


wrap = row(blocks.wrap)
triple = row(blocks.triple)


@row
def put(field: Floats, vector: Vector) -> None:
    """Write a vector to a field of a record."""
    field[0], field[1], field[2] = vector


@row
def pose_of(pose: Any, i: int) -> tuple[Vector, Quaternion]:
    """Return the position and the attitude of vehicle i from poses (n, 7)."""
    return (pose[i, 0], pose[i, 1], pose[i, 2]), (pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6])


@row
def motion_of(velocity: Any, i: int) -> tuple[Vector, Vector]:
    """Return the linear and the angular velocity of vehicle i from velocities (n, 6)."""
    return (velocity[i, 0], velocity[i, 1], velocity[i, 2]), (velocity[i, 3], velocity[i, 4], velocity[i, 5])


@row
def put_motion(velocity: Any, linear: Vector, angular: Vector) -> None:
    """Write the linear and the angular velocity into a velocity (6,)."""
    velocity[0], velocity[1], velocity[2] = linear
    velocity[3], velocity[4], velocity[5] = angular


@row
def quaternion(pose: Any) -> Quaternion:
    """Return the attitude of a pose (7,)."""
    return pose[3], pose[4], pose[5], pose[6]


@row
def turning(velocity: Any) -> Vector:
    """Return the angular velocity of a velocity (6,)."""
    return velocity[3], velocity[4], velocity[5]


@row
def vehicle(
    i: int,
    pose: Floats,
    velocity: Floats,
    action: Floats,
    previous: Floats,
    force: Floats,
    power: Floats,
) -> Vehicle:
    """Return vehicle i of a batch."""
    position, attitude = pose_of(pose, i)
    linear, angular = motion_of(velocity, i)
    return Vehicle(
        position,
        attitude,
        linear,
        angular,
        action[i],
        previous[i],
        force[i],
        power[i],
    )


@row
def current_at(w: Record, z: float) -> Vector:
    """Return the current in m/s, world axes, at a height z in m; `w` is the vehicle's current as `Simulator.set_current` stores it."""
    below = min(max((w.top - z) * w.per_thickness, 0.0), 1.0)
    (x, y, up), (dx, dy, d_up) = triple(w.velocity), triple(w.change)
    return x + below * dx, y + below * dy, up + below * d_up


@row
def yaw(v: Vehicle) -> float:
    """Return the yaw in rad."""
    w, x, y, z = v.attitude
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@row
def roll_pitch(v: Vehicle) -> tuple[float, float]:
    """Return roll and pitch in rad; unlike in `frames.euler`, pitch is positive with the bow up."""
    w, x, y, z = v.attitude
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return roll, -math.asin(min(1.0, max(-1.0, 2.0 * (w * y - x * z))))


@row
def world_velocity(v: Vehicle) -> Vector:
    """Return the velocity in m/s, world axes."""
    return product(rotation_matrix(v.attitude), v.velocity)


@row
def between(a: Vector, b: Vector) -> float:
    """Return the distance between two points in m."""
    (ax, ay, az), (bx, by, bz) = a, b
    dx, dy, dz = ax - bx, ay - by, az - bz
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@row
def team_of(environment: int) -> int:
    """Return the counter of a vehicle's team, which is the counter of the team's first vehicle."""
    return environment & (VEHICLE - 1)


@row
def misses(e: Record, p: Record, speaker: int, turn: int, stream: int) -> bool:
    """Return whether a vehicle misses the acoustic message that the vehicle `speaker` of its team sends in a turn."""
    lost, _, _, _ = uniform4(e.seed, MESSAGE | stream, speaker, turn, e.episode, e.environment)
    return bool(lost < p.message_loss)


@row
def drawn(e: Record, stream: int, block: int) -> tuple[float, float, float, float]:
    """Return four uniform draws in (0, 1) for the start of an episode; each `block` has its own draws."""
    return uniform4(e.seed, SCENARIO | stream, block, 0, e.episode, e.environment)


@row
def rise(u: float, centre: float, radius: float, p: Record) -> float:
    """Return a drawn point's height over the centre of a sphere, as a fraction of the radius.

    The point is uniform on the part of the sphere where starts are allowed: at least SHALLOWEST m away from each depth
    limit or, if the centre is closer to a limit, at least as far away from this limit as the centre.

    Args:
        u: uniform draw.
        centre: z of the centre in m, within the depth limits.
        radius: radius of the sphere, m.
        p: parameters of the task.
    """
    share = 2.0 * u - 1.0
    if radius <= 0.0:
        return share
    bottom = max(-1.0, min(0.0, p.depth_low + SHALLOWEST - centre) / radius)
    top = min(1.0, max(0.0, p.depth_high - SHALLOWEST - centre) / radius)
    return float(0.5 * (bottom + top) + 0.5 * (top - bottom) * share)


@row
def start_in_ball(e: Record, radius: float, p: Record, u: float, v: float, w: float) -> None:
    """Draw `e.start` uniformly in a ball with `radius` m round the reference, from the uniform draws u, v and w.

    If the depth limits cut the ball, the start is uniform on the allowed part of each sphere (`rise`).
    """
    x, y, z = triple(e.reference)
    length = radius * u ** (1.0 / 3.0)
    share = rise(v, z, length, p)
    level = length * math.sqrt(1.0 - share * share)
    put(e.start, (x + level * math.cos(_TWO_PI * w), y + level * math.sin(_TWO_PI * w), z + length * share))


@row
def leaves_water(v: Vehicle, p: Record) -> bool:
    """Return whether a vehicle is beyond a depth limit."""
    _, _, z = v.position
    return bool(z < p.depth_low or z > p.depth_high)


@row
def arrival(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of a step towards a point, or GOES_ON. The depth limits are checked first, then the goal, then the last step."""
    if leaves_water(v, p):
        return COLLISION
    if e.distance < p.goal_radius:
        return SUCCESS
    if e.steps >= p.max_steps:
        return TIMEOUT
    return GOES_ON


@row
def add_errors(e: Record) -> None:
    """Add the squared position and yaw errors of a step to their sums."""
    e.error_squared_sum += e.distance * e.distance
    e.yaw_error_squared_sum += e.yaw_error * e.yaw_error
    e.counted += 1.0


# --- Functions that the loops of every task call (`loops`) ----------------------------------------------------------------------


@row
def begin(e: Record) -> None:
    """Reset the outcome, the number of steps and the sums of an episode."""
    e.steps = 0
    e.outcome = GOES_ON
    e.reward_sum = 0.0
    e.deviation_sum = 0.0
    e.deviation_squared_sum = 0.0
    e.command_norm_sum = 0.0
    e.energy = 0.0
    e.path_length = 0.0
    e.change_sum = 0.0
    e.error_squared_sum = 0.0
    e.yaw_error_squared_sum = 0.0
    e.counted = 0.0
    e.detour = 0.0


@row
def start(e: Record, heading: float, p: Record, pose: Floats) -> None:
    """Begin an episode at `e.start`, level and at rest, with the yaw `heading` in rad, and write the start pose (7,).

    The reference must be set before the call.
    """
    x, y, z = triple(e.start)
    put(e.position, (x, y, z))
    put(pose, (x, y, z))
    pose[3] = math.cos(0.5 * heading)
    pose[4] = 0.0
    pose[5] = 0.0
    pose[6] = math.sin(0.5 * heading)
    e.start_yaw = heading
    e.distance = between(triple(e.reference), (x, y, z))
    e.initial_distance = e.distance
    e.depth_margin = min(p.depth_high - z, z - p.depth_low)


@row
def measure(e: Record, v: Vehicle) -> None:
    """Write the distance from the reference, the distance after the previous step, and the distance to go."""
    e.last_distance = e.distance
    e.distance = between(triple(e.reference), v.position)
    e.to_go = e.distance + e.detour


@row
def turn(e: Record, v: Vehicle) -> None:
    """Write the yaw error of a reference that has its own yaw."""
    e.yaw_error = wrap(e.reference_yaw - yaw(v))


@row
def turn_to(e: Record, v: Vehicle) -> None:
    """Write the yaw error of a reference without a yaw: the reference's bearing minus the vehicle's yaw."""
    (x, y, _), (to_x, to_y, _) = v.position, triple(e.reference)
    e.yaw_error = wrap(math.atan2(to_y - y, to_x - x) - yaw(v))


@row
def finish(e: Record, v: Vehicle, reward: float, p: Record) -> None:
    """Add a step to the episode's sums; store the step's action and position for the next step."""
    norm_squared = 0.0
    change_squared = 0.0
    for j in range(v.action.shape[0]):
        norm_squared += v.force[j] * v.force[j]
        change = v.action[j] - v.previous[j]
        change_squared += change * change
        v.previous[j] = v.action[j]
    _, _, z = v.position
    e.reward_sum += reward
    e.command_norm_sum += math.sqrt(norm_squared)
    e.energy += v.power * p.duration
    e.path_length += between(v.position, triple(e.position))
    e.change_sum += math.sqrt(change_squared)
    e.depth_margin = min(e.depth_margin, p.depth_high - z, z - p.depth_low)
    put(e.position, v.position)


@row
def noise(u: float, low: float, high: float, both_signs: bool) -> float:
    """Return noise from a uniform draw u, with a magnitude uniform in [low, high] and, if `both_signs`, a random sign."""
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
    episodes: Any,
    parameters: Any,
    scale: Floats,
    stream: int,
    command: Floats,
) -> None:
    """Compute command = action + noise, clipped to [-1, 1]; `scale` (n_u,) converts the noise to units of the action."""
    p = parameters[0]
    n_u = action.shape[1]
    low, high, both_signs = p.command_noise_low, p.command_noise_high, p.both_signs > 0
    silent = high == 0.0
    for i in range(start, stop):
        e = episodes[i]
        for block in range((n_u + 3) // 4):
            if silent:
                u = (0.0, 0.0, 0.0, 0.0)
            else:
                u = uniform4(e.seed, COMMAND | stream, block, e.steps, e.episode, e.environment)
            for entry in range(min(4, n_u - 4 * block)):
                j = 4 * block + entry
                value = action[i, j]
                if not silent:
                    value += noise(u[entry], low, high, both_signs) * scale[j]
                command[i, j] = min(1.0, max(-1.0, value))
