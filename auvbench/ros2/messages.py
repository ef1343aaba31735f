"""Convert between arrays and messages. Quaternions are (w, x, y, z) in arrays and (x, y, z, w) in messages."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.ros2 import interface

Floats = NDArray[np.float64]


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
    """Return a nav_msgs/Odometry with its frames; covariances are 0, because its numbers are exact."""
    message = ros.nav.Odometry()
    message.header.frame_id = interface.WORLD
    message.child_frame_id = f"{namespace}/base_link"
    return message


_POSE = struct.Struct("<7d")
_TWIST = struct.Struct("<6d")
_COVARIANCE = 36 * 8


def read_odometry(data: bytes, pose: Floats, velocity: Floats) -> int:
    """Read a serialised nav_msgs/Odometry into `pose` (7,) and `velocity` (6,); return its stamp in ns.

    The Python object takes longer to make than the rest of a round trip, because of its 72 covariances. The layout is
    little-endian CDR: numbers are aligned to their size, counted after a header of 4 bytes.

    Raises:
        ValueError: the message has another layout.
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
