"""Serve vehicles with sensors: sample sensors in the simulator's steps, and publish their readings.

The published covariances equal the covariances in auvbench's own filter. The caller passes the `Navigation` object, so that this
module needs no compiler.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.errors import MissingExtraError
from auvbench.integrations.ros2 import interface

Floats = NDArray[np.float64]
UNKNOWN = 1e6
"""variance of a coordinate that a sensor does not measure"""
PLACES = {"depth": (2,), "heading": (5,), "usbl": (0, 1, 2), "gnss": (0, 1)}
"""indices of the coordinates that each sensor with a pose message measures; order: x, y, z, roll, pitch, yaw"""


class Estimator(Protocol):
    """The part of `auvbench.tasks.navigation.estimator.Navigation` that a server uses."""

    pose: Floats
    velocity: Floats
    covariance: Floats
    is_filter: bool

    def begin(self, indices: NDArray[np.int64], simulator: Any) -> None: ...

    def intervals(self, duration: float) -> int: ...

    def sample(self, simulator: Any, seconds: float) -> None: ...

    def conclude(self, action: Floats, force: Floats, power: Floats) -> None: ...


class Sensed:
    """A simulator of vehicles with sensors and an estimator.

    Args:
        simulator: simulator of the vehicles; attributes that this class lacks are the simulator's attributes.
        navigation: sensors and estimates.
        draw: function that takes indices of vehicles and draws their next episodes, since sensor errors differ between episodes.
        readings: function that returns the last readings of a vehicle, by sensor.
        names: names of the sensors.
    """

    n: int
    pose: Floats
    velocity: Floats
    effectiveness: Floats

    def __init__(
        self,
        simulator: Any,
        navigation: Estimator,
        draw: Callable[[NDArray[np.int64]], Any],
        readings: Callable[[int], dict[str, Any]],
        names: tuple[str, ...],
    ) -> None:
        self.simulator, self.navigation, self.draw = simulator, navigation, draw
        self.readings, self.names = readings, names
        self.sampled: Callable[[float], None] = lambda left: None
        """function called after each sample of the IMU, with the time in s until the end of the step"""

    def __getattr__(self, name: str) -> Any:
        if name == "simulator":  # not set yet while a copy is made
            raise AttributeError(name)
        return getattr(self.simulator, name)

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current of all vehicles; see `Simulator.set_current`."""
        self.simulator.set_current(velocity, bottom, depths)

    def reset(
        self, indices: NDArray[Any], pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles at `pose` with `velocity`, and restart their sensors and estimates."""
        self.simulator.reset(indices, pose, velocity, scales)
        self.draw(indices)
        self.navigation.begin(indices, self.simulator)

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply commands for `duration` s; sample the sensors at the intervals of the IMU."""
        simulator, count = self.simulator, self.navigation.intervals(duration)
        for k in range(1, count + 1):
            simulator.step(command, duration / count)
            self.navigation.sample(simulator, duration / count)
            self.sampled(duration * (count - k) / count)
        self.navigation.conclude(np.asarray(command), simulator.command_force, simulator.power)


class Topics:
    """Topics of one vehicle's sensors.

    Args:
        session: session with the modules of ROS 2.
        node: the vehicle's node.
        namespace: namespace of the vehicle.
        sensed: simulator of the vehicle.
        index: number of the vehicle.

    Raises:
        MissingExtraError: `sensor_msgs` is not installed.
    """

    def __init__(self, session: Any, node: Any, namespace: str, sensed: Sensed, index: int) -> None:
        ros, names = session.ros, interface.Names(namespace)
        try:
            imu = import_module("sensor_msgs.msg").Imu
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                "sensor_msgs (ROS 2 Jazzy)", extra="ros2", purpose="auvbench serve with sensors"
            ) from error
        self.sensed, self.index = sensed, index
        kinds = {"imu": imu, "dvl": ros.geometry.TwistWithCovarianceStamped}
        self._messages, self._publishers, self._last = {}, {}, dict.fromkeys(sensed.names, -1)
        for name in sensed.names:
            kind = kinds.get(name, ros.geometry.PoseWithCovarianceStamped)
            message = kind()
            message.header.frame_id = interface.WORLD if name in PLACES else f"{namespace}/{name}_link"
            self._messages[name] = message
            self._publishers[name] = node.create_publisher(kind, names.of(name), session.qos)

    def publish(self, time: int) -> None:
        """Publish the readings that are new at `time` in ns."""
        if not any(publisher.get_subscription_count() for publisher in self._publishers.values()):
            return
        for name, reading in self.sensed.readings(self.index).items():
            stamp = time - interface.nanoseconds(reading.age)
            # Publish each reading once; since ages are rounded, the stamps of one reading may differ by up to 1 us.
            if stamp <= self._last[name] + 1000:
                continue
            self._last[name] = stamp
            message = self._messages[name]
            interface.write_time(message.header.stamp, stamp)
            write_reading(name, message, reading.value, reading.covariance)
            self._publishers[name].publish(message)


def write_reading(name: str, message: Any, value: Floats, covariance: Floats) -> None:
    """Write a reading (k,) with its covariance (k, k) into its sensor's message."""
    numbers = value.tolist()
    if name == "imu":
        force, rates = message.linear_acceleration, message.angular_velocity
        force.x, force.y, force.z, rates.x, rates.y, rates.z = numbers
        message.linear_acceleration_covariance = covariance[:3, :3].ravel()
        message.angular_velocity_covariance = covariance[3:, 3:].ravel()
        message.orientation_covariance = np.array([-1.0, *[0.0] * 8])  # in sensor_msgs: not measured
        return
    measured = (0, 1, 2) if name == "dvl" else PLACES[name]
    full = UNKNOWN * np.eye(6)
    full[np.ix_(measured, measured)] = covariance
    if name == "dvl":
        message.twist.covariance = full.ravel()
        interface.write_twist(message.twist.twist, [*numbers, 0.0, 0.0, 0.0])
        return
    message.pose.covariance = full.ravel()
    place = np.zeros(6)
    place[list(measured)] = numbers
    half = 0.5 * float(place[5])
    interface.write_pose(message.pose.pose, [*place[:3].tolist(), float(np.cos(half)), 0.0, 0.0, float(np.sin(half))])  # fmt: skip


def write_covariances(message: Any, covariance: Floats) -> None:
    """Write a filter's covariances of position and attitude, from its whole covariance (n, n), into a nav_msgs/Odometry.

    Attitude errors are in world axes, in the filter and in the message. The message's covariances of velocity and rates stay 0.
    """
    picked = [0, 1, 2, 6, 7, 8]
    message.pose.covariance = covariance[np.ix_(picked, picked)].ravel()
