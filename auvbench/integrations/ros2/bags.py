"""Read bags of ROS 2 (a folder with metadata.yaml) with the package rosbags.

Topics: std_msgs/Float64 `cmd_NAME` (as `auvbench serve` takes) or `NAME/cmd_thrust` (as Gazebo takes), thrust in N; nav_msgs/Odometry pose
in the world and velocity in the body; sensor_msgs/Imu specific force, and attitude and rates in bags without odometry;
rosgraph_msgs/Clock the time, else the time of recording. Axes are ENU and FLU (REP-103).

Messages are decoded by the type definitions that come with rosbags. The definitions in a bag are not used: rosbags would turn them
into Python code.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.errors import MissingExtraError
from auvbench.identification import csv_log
from auvbench.identification.log import Log, LogError
from auvbench.untrusted import path_safety, reading
from auvbench.untrusted.text import short

METADATA = "metadata.yaml"
COMMAND, ODOMETRY, IMU, CLOCK = (
    "std_msgs/msg/Float64",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Imu",
    "rosgraph_msgs/msg/Clock",
)
_NAMED = re.compile(r".*/cmd_(?!thrust$)(\w+)|.*/(\w+?)(?:_joint)?/cmd_thrust")
"""Pattern of the topics of thruster commands."""


def read(path: Path, motors: Sequence[str] | None = None) -> list[Log]:
    """Return the log of a folder.

    Args:
        path: a folder.
        motors: unused, because the topics of commands contain the names of the thrusters.

    Raises:
        LogError: the folder cannot be read, has no commands of thrusters, or a check fails.
        MissingExtraError: rosbags is not installed.
    """
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("rosbags", extra="bags", purpose="bags of ROS 2") from None
    try:
        digest = _digest(path)
        types = get_typestore(Stores.ROS2_JAZZY)
        with Reader(path) as reader:
            topics = _chosen(reader.connections, str(path))
            messages = [
                (topics[connection.topic], 1e-9 * stamp, types.deserialize_cdr(raw, connection.msgtype))
                for connection, stamp, raw in reader.messages(
                    [connection for connection in reader.connections if connection.topic in topics]
                )
            ]
    except LogError:
        raise
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # rosbags raises exceptions of all kinds on damaged files
        raise LogError(f"{path}: not a bag of ROS 2: {short(error)}") from None
    return [csv_log.parse(_table(messages, str(path)), str(path), digest)]


def _digest(path: Path) -> str:
    """Return one SHA-256 of the bag's metadata and all its files.

    Raises:
        ValueError: the metadata name no files or a file outside the bag's folder, or a file is too long.
    """
    data = reading.content(path / METADATA)
    about = reading.yaml_value(data)
    listed = about.get("rosbag2_bagfile_information", {}) if isinstance(about, dict) else {}
    names = listed.get("relative_file_paths") if isinstance(listed, dict) else None
    if not isinstance(names, list) or not names:
        raise ValueError(f"{METADATA} names no files")
    digest = sha256(data)
    for name in names:
        # In old bags, a file's path begins with the name of the bag's folder; rosbags uses only the last part of the path.
        digest.update(reading.content(path_safety.child(path, str(name).rpartition("/")[2]), reading.DATA))
    return digest.hexdigest()


def _chosen(connections: Any, name: str) -> dict[str, str]:
    """Return the topics to read, each with its column of the log (commands) or its type (ODOMETRY, IMU or CLOCK).

    Raises:
        LogError: the bag has no commands, or several vehicles.
    """
    topics: dict[str, str] = {}
    for connection in connections:
        if connection.msgtype == COMMAND and (match := _NAMED.fullmatch(connection.topic)):
            topics[connection.topic] = f"{match[1] or match[2]}_N"
        elif connection.msgtype in (ODOMETRY, IMU, CLOCK):
            topics[connection.topic] = connection.msgtype
    columns = list(topics.values())
    if not any(column.endswith("_N") for column in columns):
        raise LogError(
            f"{name}: has no commands of thrusters; record Float64 topics cmd_NAME or NAME/cmd_thrust, in N"
        )
    for column in dict.fromkeys(columns):
        if columns.count(column) > 1:
            several = ", ".join(topic for topic, of in topics.items() if of == column)
            raise LogError(f"{name}: has {several}; record the topics of one vehicle")
    return topics


def _table(messages: list[tuple[str, float, Any]], name: str) -> pd.DataFrame:
    """Return the table for `csv_log`: one row per time, from the time at which each thruster has had a command.

    A thruster's command is held until its next command.
    """
    ticks = [(stamp, _seconds(message.clock)) for kind, stamp, message in messages if kind == CLOCK]
    seen = {kind for kind, _, _ in messages}
    rows = []
    for kind, stamp, message in messages:
        if kind == CLOCK:
            continue
        time = float(np.interp(stamp, *np.array(ticks).T)) if ticks else stamp
        rows.append({"t_s": round(time, 6), **_values(kind, message, ODOMETRY in seen)})
    table = pd.DataFrame(rows).groupby("t_s", as_index=False).last().sort_values("t_s")
    inputs = [str(column) for column in table if str(column).endswith("_N")]
    table[inputs] = table[inputs].ffill()
    table = table[table[inputs].notna().all(axis=1)].reset_index(drop=True)
    if table.empty:
        raise LogError(f"{name}: has no time at which all of its thrusters have a command; record longer")
    return table


def _values(kind: str, message: Any, odometry: bool) -> dict[str, float]:
    """Return the numbers of a message by column."""
    if kind == ODOMETRY:
        pose, twist = message.pose.pose, message.twist.twist
        place = {f"{axis}_m": getattr(pose.position, axis) for axis in "xyz"}
        moving = {f"{name}_mps": getattr(twist.linear, axis) for name, axis in zip("uvw", "xyz", strict=True)}
        return {**place, **_turned(pose.orientation), **moving, **_turning(twist.angular)}
    if kind == IMU:
        force = {f"a{axis}_mps2": getattr(message.linear_acceleration, axis) for axis in "xyz"}
        if odometry:
            return force
        # A covariance of -1 means that the sensor does not measure attitude (sensor_msgs/Imu).
        attitude = _turned(message.orientation) if message.orientation_covariance[0] != -1.0 else {}
        return {**force, **attitude, **_turning(message.angular_velocity)}
    return {kind: float(message.data)}


def _turned(orientation: Any) -> dict[str, float]:
    return {f"q{axis}": getattr(orientation, axis) for axis in "wxyz"}


def _turning(rates: Any) -> dict[str, float]:
    return {f"{name}_radps": getattr(rates, axis) for name, axis in zip("pqr", "xyz", strict=True)}


def _seconds(time: Any) -> float:
    return float(time.sec + 1e-9 * time.nanosec)
