"""Define the blocks of observations: the contents of each block, and the function that writes its numbers.

The functions are plain Python and import no compiled code. A pilot on a real vehicle calls a function directly
(`pilot.live_observation`). Environments compile the same function (`tasks.loops.observe`), so pilot and environment
compute the same observation.

`registry.BLOCKS` lists the specs below; a package adds a block by its own `BlockSpec`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from auvbench.errors import closest
from auvbench.observation import BODY, WORLD, Block
from auvbench.registry import Spec
from auvbench.untrusted.text import short

FASTEST = 50.0
"""bound of velocities in m/s and of angular rates in rad/s; no vehicle comes near this bound"""

LARGEST = 1e6
"""bound of quantities without a natural limit (estimates, messages, pings, places in a formation), in m, m/s2 and s"""

LOOK_AHEAD = 1.5
"""Look-ahead distance of the block `way` in m, measured along the shortest way from the point nearest to the vehicle"""

PINGS = 4
"""number of pings of a target that a vehicle remembers"""

BODY_AXES = "body axes (forward, port, up)"

READS = ("pose", "velocity", "action", "goal", "preview", "task", "team", "solids", "navigation")
"""Data that a block may read. `action` is the action of the last step, and `goal` is a goal that differs from the reference. `task` means
fields that only one task defines, `solids` the bottom and obstacles of a world, and `navigation` the results of an estimator."""


class Reading(NamedTuple):
    """Readings of a vehicle's sensors, including their errors."""

    position: Any  # (3,) m, world axes
    attitude: Any  # (4,) true attitude, unit quaternion (w, x, y, z)
    velocity: Any  # (3,) m/s, body axes
    rates: Any  # (3,) rad/s, body axes
    error: Any  # (3,) m, reference minus position; levelled body axes if the task observes in body axes, else world axes
    yaw_error: float  # rad
    cosine: float  # cosine of the yaw; `write_levelled` uses cosine and sine to rotate vectors
    sine: float
    previous: Any  # (n_u,) action of the last step
    preview: Any  # (points, 3) m, future positions of the reference, world axes
    stream: int  # flag that selects a stream of random numbers in `normals`


@dataclass(frozen=True, slots=True)
class Setting:
    """Properties of a task and a vehicle that determine the size, the bounds and the description of a block."""

    to: str  # name of the reference in descriptions
    has_yaw: bool  # whether the task prescribes a yaw; else yaw_error uses the bearing of the reference
    axes: str  # axes of the position error: WORLD or BODY
    bounds: tuple[float, ...]  # (3,) m, largest position errors
    depths: tuple[float, float]  # lowest and highest z in m
    actuators: Sequence[str]
    points: int  # number of points of the preview
    interval: float  # s, time between two points of the preview
    sensor: Any = None  # configuration of the range sensor whose readings the block has
    others: int = 0  # number of the other vehicles in the team


@dataclass(frozen=True, slots=True)
class BlockSpec(Spec):
    """Description of one block that `task.observation` may name."""

    name: str
    """Entry of `task.observation`."""
    write: Callable[..., None]
    """`write(m, e, p, out)`: writes the block's numbers to `out` from a `Reading` m, the episode e and the parameters p."""
    describe: Callable[[Setting], Block]
    """Function that returns the block's name, labels, unit, bounds, meaning and axes for a `Setting`."""
    reads: tuple[str, ...] = ("pose",)
    """Entries of `READS` that `write` reads. A block that reads `task` is available only in a task if the task's spec lists the block."""
    sensor: str = ""
    """`module:class` of the range sensor that writes the block; `write` is not called then. Empty for other blocks."""
    schema: None = None

    @property
    def code(self) -> str:
        """Return `module:function` of the block."""
        return f"{self.write.__module__}:{self.write.__qualname__}"

    def fault(self) -> str:
        if not re.fullmatch(r"[a-z]\w*", self.name):
            return "has an invalid name; must be a lower-case letter, followed by letters, digits and underscores"
        for what, count in (("write", 4), ("describe", 1)):
            function = getattr(self, what)
            if not isinstance(function, FunctionType) or function.__code__.co_argcount != count:
                return f"has a {what} that is not a function of {count} argument{'s' if count > 1 else ''}"
        if self.write.__closure__ or "<" in self.write.__qualname__:
            return (
                "has a write that is not a function of its module; must be defined by `def` at the top level"
            )
        for what in self.reads:
            if what not in READS:
                return f"reads {short(repr(what))}; {closest(str(what), READS)}"
        return ""


def wrap(angle: float) -> float:
    """Wrap an angle to [-pi, pi).

    >>> wrap(math.pi) == -math.pi
    True
    """
    # np.floor, because math.floor raises ValueError for a NaN, which a faulty task may write.
    wrapped = angle - 2.0 * math.pi * float(np.floor((angle + math.pi) / (2.0 * math.pi)))
    return wrapped if wrapped < math.pi else -math.pi


def normals(m: Reading, e: Any, channel: int) -> tuple[float, float, float, float]:
    """Return four zeros as the noise of a block: a pilot adds no noise, since its real sensors are noisy.

    Environments call a compiled version of this function (`tasks.loops`) instead, which returns four standard normal numbers. These
    numbers differ between blocks, channels, steps, episodes and environments.
    """
    return 0.0, 0.0, 0.0, 0.0


def triple(vector: Any) -> tuple[float, float, float]:
    """Return an array of three numbers as a tuple."""
    return vector[0], vector[1], vector[2]


def reading(
    e: Any,
    p: Any,
    position: Any,
    attitude: Any,
    velocity: Any,
    rates: Any,
    offset: Any,
    noise: Any,
    yaw_noise: float,
    previous: Any,
    preview: Any,
    stream: int,
) -> Reading:
    """Return the readings of a vehicle.

    Args:
        e: fields of the episode: `reference` (3,) in m and, if `p.has_yaw`, `reference_yaw` in rad.
        p: parameters of the task: `has_yaw` and `body_frame`.
        position: (3,) m, world axes.
        attitude: (4,) unit quaternion (w, x, y, z).
        velocity: (3,) m/s, body axes.
        rates: (3,) rad/s, body axes.
        offset: (3,) m, slow error of the position.
        noise: (3,) m, error of the position, drawn anew in each step.
        yaw_noise: error of the yaw reading, rad.
        previous: (n_u,) action of the last step.
        preview: (points, 3) m, future positions of the reference, world axes.
        stream: flag that selects a stream of random numbers: 0, TEST or VALIDATION.
    """
    w, qx, qy, qz = attitude
    # c and s are proportional to the cosine and sine of yaw. Rotating the horizontal error by them saves a second arctangent.
    c = 1.0 - 2.0 * (qy * qy + qz * qz)
    s = 2.0 * (w * qz + qx * qy)
    to_x, to_y, to_z = triple(e.reference)
    (x, y, z), (ox, oy, oz), (nx, ny, nz) = position, offset, noise
    ex, ey, ez = to_x - x - ox - nx, to_y - y - oy - ny, to_z - z - oz - nz
    if p.has_yaw > 0:
        yaw_error = wrap(e.reference_yaw - math.atan2(s, c) - yaw_noise)
    else:
        yaw_error = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s) - yaw_noise)
    read = (to_x - ex, to_y - ey, to_z - ez)
    if p.body_frame > 0:
        # Levelled body axes: a vehicle needs only its heading reading to compute them.
        yaw = math.atan2(s, c) + yaw_noise
        c, s = math.cos(yaw), math.sin(yaw)
        ex, ey = c * ex + s * ey, c * ey - s * ex
    return Reading(read, attitude, velocity, rates, (ex, ey, ez), yaw_error, c, s, previous, preview, stream)


def write_yaw_error(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0] = m.yaw_error


def write_position_error(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = m.error


def write_velocity_error(m: Reading, e: Any, p: Any, out: Any) -> None:
    w, x, y, z = m.attitude
    u, v, h = m.velocity
    vx = (1.0 - 2.0 * (y * y + z * z)) * u + 2.0 * (x * y - w * z) * v + 2.0 * (x * z + w * y) * h
    vy = 2.0 * (x * y + w * z) * u + (1.0 - 2.0 * (x * x + z * z)) * v + 2.0 * (y * z - w * x) * h
    vz = 2.0 * (x * z - w * y) * u + 2.0 * (y * z + w * x) * v + (1.0 - 2.0 * (x * x + y * y)) * h
    asked_x, asked_y, asked_z = triple(e.reference_velocity)
    write_levelled(m, asked_x - vx, asked_y - vy, asked_z - vz, out)


def write_velocity(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = m.velocity


def write_angular_velocity(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = m.rates


def write_gravity(m: Reading, e: Any, p: Any, out: Any) -> None:
    w, x, y, z = m.attitude
    out[0] = -2.0 * (x * z - w * y)
    out[1] = -2.0 * (y * z + w * x)
    out[2] = 2.0 * (x * x + y * y) - 1.0


def write_depth_margin(m: Reading, e: Any, p: Any, out: Any) -> None:
    _, _, z = m.position
    out[0] = min(p.depth_high - z, z - p.depth_low)


def write_previous_action(m: Reading, e: Any, p: Any, out: Any) -> None:
    for j in range(len(out)):
        out[j] = m.previous[j]


def write_preview(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, z = m.position
    for k in range(len(m.preview)):
        to_x, to_y, to_z = triple(m.preview[k])
        write_levelled(m, to_x - x, to_y - y, to_z - z, out[3 * k : 3 * k + 3])


def write_goal_error(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, z = m.position
    to_x, to_y, to_z = triple(e.goal)
    write_levelled(m, to_x - x, to_y - y, to_z - z, out)


def write_way(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, z = m.position
    nearest, at, part = math.inf, 0, 0.0
    for k in range(e.way_corners - 1):
        (ax, ay, az), (bx, by, bz) = triple(e.way[k]), triple(e.way[k + 1])
        ux, uy, uz = bx - ax, by - ay, bz - az
        squared = max(ux * ux + uy * uy + uz * uz, 1e-12)
        share = min(max(((x - ax) * ux + (y - ay) * uy + (z - az) * uz) / squared, 0.0), 1.0)
        dx, dy, dz = ax + share * ux - x, ay + share * uy - y, az + share * uz - z
        off = dx * dx + dy * dy + dz * dz
        if off < nearest:
            nearest, at, part = off, k, share
    remaining = LOOK_AHEAD
    for k in range(at, e.way_corners - 1):
        (ax, ay, az), (bx, by, bz) = triple(e.way[k]), triple(e.way[k + 1])
        ux, uy, uz = bx - ax, by - ay, bz - az
        length = max(math.sqrt(ux * ux + uy * uy + uz * uz), 1e-6)
        share = min(part + remaining / length, 1.0)
        write_levelled(m, ax + share * ux - x, ay + share * uy - y, az + share * uz - z, out)
        remaining -= (share - part) * length
        part = 0.0
        if share < 1.0:
            break


def write_position_sd(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = triple(e.position_sd)


def write_specific_force(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = triple(e.specific_force)


def write_sensor_age(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = triple(e.sensor_age)


def write_slot(m: Reading, e: Any, p: Any, out: Any) -> None:
    out[0], out[1], out[2] = triple(e.slot)


def write_messages(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, z = m.position
    at = 0
    for j in range(p.vehicles):
        if j == e.vehicle:
            continue
        told = e.heard[j]
        write_levelled(m, told[0] - x, told[1] - y, told[2] - z, out[at : at + 3])
        write_levelled(m, told[3], told[4], told[5], out[at + 3 : at + 6])
        out[at + 6] = e.steps * p.duration - e.heard_at[j]
        at += 7


def write_target(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, z = m.position
    believed, covariance = e.estimate, e.covariance
    write_levelled(m, believed[0] - x, believed[1] - y, e.depth - z, out)
    out[3] = math.sqrt(covariance[0, 0] + covariance[1, 1])


def write_pings(m: Reading, e: Any, p: Any, out: Any) -> None:
    x, y, _ = m.position
    for k in range(PINGS):
        heard = e.pings[k]
        at = 5 * k
        write_levelled(m, heard[0] - x, heard[1] - y, heard[2], out[at : at + 3])
        out[at + 3] = heard[3]
        out[at + 4] = e.steps * p.duration - heard[4]


def write_levelled(m: Reading, x: float, y: float, z: float, out: Any) -> None:
    """Convert a vector from world axes to levelled body axes, and write it to `out`."""
    out[0] = m.cosine * x + m.sine * y
    out[1] = m.cosine * y - m.sine * x
    out[2] = z


def _yaw_error(s: Setting) -> Block:
    meaning = "yaw of the reference less yaw" if s.has_yaw else f"bearing of the {s.to} less yaw"
    return Block("yaw_error", ("yaw_error",), "rad", (math.pi,), f"{meaning}, wrapped to [-pi, pi)")


def _position_error(s: Setting) -> Block:
    return vector("position_error", "m", s.bounds, f"{s.to} less position", s.axes)


def _velocity_error(s: Setting) -> Block:
    return vector("velocity_error", "m/s", (FASTEST,) * 3, "velocity of the reference less velocity", BODY)


def _velocity(s: Setting) -> Block:
    return vector("velocity", "m/s", (FASTEST,) * 3, "velocity over ground", BODY_AXES)


def _angular_velocity(s: Setting) -> Block:
    return vector("angular_velocity", "rad/s", (FASTEST,) * 3, "angular velocity", BODY_AXES)


def _gravity(s: Setting) -> Block:
    return vector("gravity", "1", (1.0,) * 3, "direction of gravity", BODY_AXES)


def _depth_margin(s: Setting) -> Block:
    low, high = s.depths
    high = 2.0 * s.bounds[2] + high - low
    meaning = "distance to the nearer depth limit; negative beyond it"
    return Block("depth_margin", ("depth_margin",), "m", (high,), meaning)


def _previous_action(s: Setting) -> Block:
    labels = tuple(f"previous_action_{actuator}" for actuator in s.actuators)
    return Block(
        "previous_action", labels, "1", (1.0,) * len(labels), "action of the last step; 0 at the start"
    )


def _preview(s: Setting) -> Block:
    labels = tuple(f"preview_{point}_{axis}" for point in range(1, s.points + 1) for axis in "xyz")
    # The last point of the preview may be as far ahead as a reference with the speed FASTEST moves until then.
    away = s.points * s.interval * FASTEST
    level, rise = _apart(s)
    meaning = f"reference in {s.interval:g} s, twice that, and so on, less position"
    return Block("preview", labels, "m", (level + away, level + away, rise + away) * s.points, meaning, BODY)


def _goal_error(s: Setting) -> Block:
    level, rise = _apart(s)
    return vector("goal_error", "m", (level, level, rise), "goal less position", BODY)


def _way(s: Setting) -> Block:
    level, rise = _apart(s)
    meaning = f"point of the shortest way {LOOK_AHEAD:g} m ahead, less position"
    return vector("way", "m", (level, level, rise), meaning, BODY)


def _position_sd(s: Setting) -> Block:
    return vector("position_sd", "m", (LARGEST,) * 3, "standard deviation of the estimated position", WORLD)


def _specific_force(s: Setting) -> Block:
    return vector("specific_force", "m/s2", (LARGEST,) * 3, "reading of the accelerometers", BODY_AXES)


def _sensor_age(s: Setting) -> Block:
    names = tuple(f"sensor_age_{name}" for name in ("dvl", "depth", "heading"))
    return Block("sensor_age", names, "s", (LARGEST,) * 3, "time since the last valid reading was taken")


def _slot(s: Setting) -> Block:
    axes = "axes of the leader's reference (forward, port, up)"
    return vector("slot", "m", (LARGEST,) * 3, "the vehicle's place in the formation", axes)


def _messages(s: Setting) -> Block:
    names = (*(f"{axis}_m" for axis in "xyz"), *(f"{axis}_mps" for axis in "xyz"), "age_s")
    labels = tuple(f"messages_{other}_{name}" for other in range(1, s.others + 1) for name in names)
    bounds = (*(LARGEST,) * 3, *(FASTEST,) * 3, LARGEST) * s.others
    meaning = "what each other vehicle last said: its position less the own one (m), its velocity (m/s), and the age of these (s)"
    return Block("messages", labels, "1", bounds, meaning, BODY)


def _target(s: Setting) -> Block:
    labels = (*(f"target_{axis}_m" for axis in "xyz"), "target_sd_m")
    level, rise = _apart(s)
    meaning = "believed place of the target less position (m), and its standard deviation (m)"
    return Block("target", labels, "m", (level, level, rise, LARGEST), meaning, BODY)


def _pings(s: Setting) -> Block:
    names = ("x_m", "y_m", "height_m", "range_m", "age_s")
    labels = tuple(f"pings_{ping}_{name}" for ping in range(1, PINGS + 1) for name in names)
    meaning = (
        "the last pings of the target: where the vehicle heard it less position (m), height of the target over that place (m), "
        "range (m), time since it was sent (s)"
    )
    return Block("pings", labels, "1", (LARGEST,) * len(labels), meaning, BODY)


def _apart(s: Setting) -> tuple[float, float]:
    """Return the horizontal and vertical bounds in m of a vector to a point other than the reference: twice the position error's bounds."""
    return 2.0 * math.hypot(*s.bounds[:2]), 2.0 * s.bounds[2]


def vector(name: str, unit: str, bounds: tuple[float, ...], meaning: str, axes: str) -> Block:
    """Return a block that contains one vector: its components along x, y and z."""
    return Block(name, tuple(f"{name}_{axis}" for axis in "xyz"), unit, bounds, meaning, axes)


yaw_error = BlockSpec("yaw_error", write_yaw_error, _yaw_error)
position_error = BlockSpec("position_error", write_position_error, _position_error)
velocity_error = BlockSpec("velocity_error", write_velocity_error, _velocity_error, ("pose", "velocity"))
velocity = BlockSpec("velocity", write_velocity, _velocity, ("velocity",))
angular_velocity = BlockSpec("angular_velocity", write_angular_velocity, _angular_velocity, ("velocity",))
gravity = BlockSpec("gravity", write_gravity, _gravity)
depth_margin = BlockSpec("depth_margin", write_depth_margin, _depth_margin)
previous_action = BlockSpec("previous_action", write_previous_action, _previous_action, ("action",))
preview = BlockSpec("preview", write_preview, _preview, ("pose", "preview"))
goal_error = BlockSpec("goal_error", write_goal_error, _goal_error, ("pose", "goal"))
way = BlockSpec("way", write_way, _way, ("pose", "task", "solids"))
position_sd = BlockSpec("position_sd", write_position_sd, _position_sd, ("navigation",))
specific_force = BlockSpec("specific_force", write_specific_force, _specific_force, ("navigation",))
sensor_age = BlockSpec("sensor_age", write_sensor_age, _sensor_age, ("navigation",))
slot = BlockSpec("slot", write_slot, _slot, ("team",))
messages = BlockSpec("messages", write_messages, _messages, ("pose", "team"))
target = BlockSpec("target", write_target, _target, ("pose", "task"))
pings = BlockSpec("pings", write_pings, _pings, ("pose", "task"))
