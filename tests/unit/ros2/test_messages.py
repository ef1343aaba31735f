"""Messages as numbers and back."""

import numpy as np
import pytest

from auvbench.errors import ConfigError
from auvbench.integrations.ros2 import interface
from auvbench.integrations.ros2.middleware import load
from tests import dds


@dds.needs_ros
@pytest.mark.parametrize(
    "namespace", ["bluerov2", "a", "ab", "abc", "abcd", "fleet/abcde", "abcdef", "abcdefg"]
)
def test_serialised_odometry_is_read_as_rclpy_reads_it(namespace):
    from rclpy.serialization import deserialize_message, serialize_message

    ros = load()
    rng = np.random.default_rng(len(namespace))
    pose, velocity = rng.normal(size=7), rng.normal(size=6)
    message = interface.odometry(ros, namespace)
    message.pose.covariance = rng.normal(size=36)
    interface.write_time(message.header.stamp, 12_345_678_901)
    interface.write_pose(message.pose.pose, pose.tolist())
    interface.write_twist(message.twist.twist, velocity.tolist())
    data = serialize_message(message)
    found, moving = np.zeros(7), np.zeros(6)
    assert interface.read_odometry(data, found, moving) == 12_345_678_901
    np.testing.assert_array_equal(found, pose)
    np.testing.assert_array_equal(moving, velocity)
    again = deserialize_message(data, ros.nav.Odometry)
    interface.read_pose(again.pose.pose, found)
    np.testing.assert_array_equal(found, pose)
    assert interface.read_time(again.header.stamp) == 12_345_678_901


def test_other_encodings_are_refused():
    with pytest.raises(ValueError, match="little-endian"):
        interface.read_odometry(b"\x00\x00" + bytes(800), np.zeros(7), np.zeros(6))


@pytest.mark.parametrize("name", ["", "2fast", "blue rov", "a//b", "a-b"])
def test_namespaces_that_are_none(name):
    with pytest.raises(ConfigError, match="must consist of letters, digits and underscores"):
        interface.namespaces(name, 1)
