"""Bags of ROS 2, written with rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.identification import readers
from auvbench.identification.log import CHANNELS, Log

pytest.importorskip("rosbags.rosbag2")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
TIME = 0.05 * np.arange(101)
YAW = 3.0 + 0.5 * np.sin(TIME)
FLOAT, ODOMETRY, IMU, CLOCK = "std_msgs/msg/Float64", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "rosgraph_msgs/msg/Clock"  # fmt: skip


def made(kind: str, *values: Any) -> Any:
    return STORE.types[kind](*values)


def three(kind: str, *values: float) -> Any:
    return made(f"geometry_msgs/msg/{kind}", *values)


def at(seconds: float) -> Any:
    return made("builtin_interfaces/msg/Time", int(seconds), round(seconds % 1.0 * 1e9))


def messages(k: int) -> dict[str, Any]:
    """Return the messages of a time by their topics."""
    t = TIME[k]
    attitude = three("Quaternion", 0.0, 0.0, np.sin(0.5 * YAW[k]), np.cos(0.5 * YAW[k]))
    header = made("std_msgs/msg/Header", at(0.0), "world")
    place, turning = three("Point", t, 2.0 * t, -5.0), three("Vector3", 0.0, 0.0, 0.5 * np.cos(t))
    pose = made("geometry_msgs/msg/PoseWithCovariance", three("Pose", place, attitude), np.zeros(36))
    twist = three("Twist", three("Vector3", 0.1 * t, 0.0, 0.0), turning)
    moving = made("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
    force = three("Vector3", 0.0, 0.0, 9.81)
    none = np.array([-1.0, *[0.0] * 8])
    return {
        "/rov/cmd_T1": made(FLOAT, 5.0 if t % 2.0 < 1.0 else -5.0),
        "/model/rov/joint/T2_joint/cmd_thrust": made(FLOAT, 1.0),
        "/rov/odom": made(ODOMETRY, header, "base_link", pose, moving),
        "/rov/imu": made(IMU, header, attitude, none, turning, np.zeros(9), force, np.zeros(9)),
        "/rov/light": made(FLOAT, 0.3),
        "/clock": made(CLOCK, at(7.0 + t)),
    }


def write(
    path: Path, *left_out: str, storage: Any = StoragePlugin.MCAP, also: dict[str, str] | None = None
) -> Path:
    """Write a bag at twice the pace of its clock; `also` repeats topics under other names."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Any] = {}
        for k in range(TIME.size):
            now = messages(k)
            now |= {new: now[topic] for new, topic in (also or {}).items()}
            for topic, message in now.items():
                if topic in left_out:
                    continue
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
                stamp = round(1e9 * (1000.0 + 0.5 * TIME[k]))
                writer.write(connections[topic], stamp, STORE.serialize_cdr(message, kind))
    return path


def column(log: Log, name: str) -> Any:
    return log.measured[:, CHANNELS.index(name)]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_topics_become_columns(tmp_path: Path, storage: Any) -> None:
    [log] = readers.read([str(write(tmp_path / "bag", storage=storage))])
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    assert (log.kind, log.actuators) == ("force", ("T1", "T2"))
    np.testing.assert_array_equal(log.inputs[:, 0], np.where(TIME % 2.0 < 1.0, 5.0, -5.0))
    np.testing.assert_allclose(column(log, "yaw"), YAW - 0.0, atol=1e-9)
    np.testing.assert_allclose(column(log, "y"), 2.0 * TIME)
    np.testing.assert_allclose(column(log, "u"), 0.1 * TIME)
    np.testing.assert_allclose(column(log, "r"), 0.5 * np.cos(TIME))
    assert log.acceleration is not None
    assert np.all(log.acceleration[:, 2] == 9.81)


def test_without_odometry_and_clock_there_are_the_imu_and_the_time_of_recording(tmp_path: Path) -> None:
    [log] = readers.read([str(write(tmp_path / "bag", "/rov/odom", "/clock"))])
    np.testing.assert_allclose(log.time, 0.5 * TIME, atol=1e-6)
    np.testing.assert_allclose(column(log, "r"), 0.5 * np.cos(TIME))
    assert not log.has("yaw")


def test_what_is_wrong_gets_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bags = {
        "has no commands of thrusters": write(tmp_path / "a", "/rov/cmd_T1", "/model/rov/joint/T2_joint/cmd_thrust"),
        "has /rov/odom, /b/odom; record the topics of one vehicle": write(tmp_path / "b", also={"/b/odom": "/rov/odom"}),
        "has no measurement": write(tmp_path / "c", "/rov/odom", "/rov/imu"),
    }  # fmt: skip
    for name, content in (("d", "x: 1"), ("e", "rosbag2_bagfile_information: {relative_file_paths: [..]}")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_text(content)
    bags |= {"metadata.yaml names no files": tmp_path / "d", "'..' is not a valid name": tmp_path / "e"}
    damaged = write(tmp_path / "f")
    [file] = damaged.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:500] + bytes(1000))
    bags["not a bag of ROS 2"] = damaged
    for message, bag in bags.items():
        assert main(["identify", str(bag), "vehicle=bluerov2_2026"]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1, error
