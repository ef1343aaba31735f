"""Define the interface's names, types and frames, and convert its messages to arrays.

It is the interface of Centrale Nantes' BlueROV2, with additional services for a benchmark.

World ENU (frame `world`, surface at z = 0), body FLU (frame `<namespace>/base_link`), as in REP-103;
docs/ros2.md is the page for users. Quaternions are (w, x, y, z) in arrays and (x, y, z, w) in messages.
"""

from __future__ import annotations

import re
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import ConfigError

Floats = NDArray[np.float64]


WORLD = "world"
CLOCK = "/clock"
CURRENT = "/current"
NODE = "simulator"
"""Name of the node that has the parameters of a vehicle, in the vehicle's namespace."""

DEPTH = 10
"""Number of messages kept for a slow reader; QoS is reliable, volatile, keep last."""

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class Names:
    """Topics and services of one vehicle."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.pose = self.of("pose_gt")
        """geometry_msgs/Pose in the world"""
        self.odometry = self.of("odom")
        """nav_msgs/Odometry: pose in the world, twist in the body"""
        self.reset = self.of("reset")
        """std_srvs/Trigger: reset the vehicle to the parameters `start_pose` and `start_velocity`, with the actuators
        at rest
        """
        self.pause = self.of("pause")
        """std_srvs/SetBool: pause the world, or continue it"""
        self.step = self.of("step")
        """std_srvs/Trigger: make `steps` steps of `step_duration`, answer when done, and stay paused"""
        self.lockstep = self.of("lockstep")
        """std_srvs/SetBool: make each step wait for a new command to every actuator; the answer is the server's time in ns"""
        self.parameters = self.of(f"{NODE}/set_parameters")
        """rcl_interfaces/SetParameters of the vehicle's node"""

    def of(self, name: str) -> str:
        """Return the full name of a topic or service in the vehicle's namespace."""
        return f"/{self.namespace}/{name}"

    def command(self, actuator: str) -> str:
        """Return the topic of an actuator's command: std_msgs/Float64 in N for a thruster, else in rad, m or m3."""
        return self.of(f"cmd_{actuator}")


def namespaces(base: str, n: int) -> list[str]:
    """Return the namespaces of n vehicles in one world; the first namespace has the world's services.

    Raises:
        ConfigError: `base` is not a valid namespace.

    >>> namespaces("bluerov2", 1), namespaces("bluerov2", 2)
    (['bluerov2'], ['bluerov2_1', 'bluerov2_2'])
    """
    name = base.strip("/")
    if not name or not all(_TOKEN.fullmatch(token) for token in name.split("/")):
        raise ConfigError(
            f"namespace {base!r}: must consist of letters, digits and underscores, and must not begin with a digit, e.g. bluerov2"
        )
    return [name] if n == 1 else [f"{name}_{i + 1}" for i in range(n)]


def nanoseconds(duration: float) -> int:
    """Return a step's length in ns, as counted by the clock.

    >>> nanoseconds(0.1)
    100000000
    """
    return round(duration * 1e9)


def write_pose(message: Any, pose: list[float]) -> None:
    """Write x, y, z, qw, qx, qy, qz into a geometry_msgs/Pose."""
    place, turn = message.position, message.orientation
    place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z = pose


def read_pose(message: Any, pose: Floats) -> None:
    """Read a geometry_msgs/Pose into `pose` (7,)."""
    place, turn = message.position, message.orientation
    pose[:] = place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z


def write_twist(message: Any, velocity: list[float]) -> None:
    """Write u, v, w, p, q, r into a geometry_msgs/Twist."""
    straight, turning = message.linear, message.angular
    straight.x, straight.y, straight.z, turning.x, turning.y, turning.z = velocity


def read_twist(message: Any, velocity: Floats) -> None:
    """Read a geometry_msgs/Twist into `velocity` (6,)."""
    straight, turning = message.linear, message.angular
    velocity[:] = straight.x, straight.y, straight.z, turning.x, turning.y, turning.z


def write_time(stamp: Any, nanoseconds: int) -> None:
    """Write a time in ns into a builtin_interfaces/Time."""
    stamp.sec, stamp.nanosec = divmod(nanoseconds, 1_000_000_000)


def read_time(stamp: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def odometry(ros: Any, namespace: str) -> Any:
    """Return a nav_msgs/Odometry whose frame names are set; its covariances are 0, as for exact numbers."""
    message = ros.nav.Odometry()
    message.header.frame_id = WORLD
    message.child_frame_id = f"{namespace}/base_link"
    return message


_POSE = struct.Struct("<7d")
_TWIST = struct.Struct("<6d")
_COVARIANCE = 36 * 8


def read_odometry(data: bytes, pose: Floats, velocity: Floats) -> int:
    """Read a serialised nav_msgs/Odometry into `pose` (7,) and `velocity` (6,); return its stamp in ns.

    Building the Python object would take longer than the rest of a round trip, because of its 72 covariances.
    The layout is little-endian CDR: after a header of 4 bytes, each number's offset is a multiple of the number's size.

    Raises:
        ValueError: the message has a different layout.
    """
    if len(data) < 16 or data[1] != 1:
        raise ValueError("the message is not in little-endian CDR")
    seconds, nanoseconds, length = struct.unpack_from("<iII", data, 4)
    at = 16 + length
    at += -at % 4
    (length,) = struct.unpack_from("<I", data, at)
    at += 4 + length
    at += (4 - at) % 8
    x, y, z, qx, qy, qz, qw = _POSE.unpack_from(data, at)
    pose[:] = x, y, z, qw, qx, qy, qz
    velocity[:] = _TWIST.unpack_from(data, at + _POSE.size + _COVARIANCE)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)
