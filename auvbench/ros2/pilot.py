"""A ROS 2 node that carries a pilot's commands, and what it needs to know."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.pilot import loop
from auvbench.pilot.observation import yaw_of
from auvbench.pilot.steering import Steering
from auvbench.ros2 import discovery, interface
from auvbench.ros2.middleware import Session

Floats = NDArray[np.float64]

NODE = "pilot"
GOAL = "/goal_pose"


class Pilot(loop.Pilot):
    """A pilot as a node.

    Args:
        namespace: of the vehicle.
        steering: as `loop.Pilot`.
        options: likewise; `sim_time` steps by `/clock`.

    Raises:
        ConfigError: ROS 2 does not start.
    """

    def __init__(self, namespace: str, steering: Steering, **options: Any) -> None:
        super().__init__(steering, **options)
        self.names = interface.Names(interface.namespaces(namespace, 1)[0])
        self.source = self.names.odometry
        self.session = Session()
        try:
            self._make()
        except BaseException:
            self.session.close()
            raise
        self._set_state("disarmed")

    def _make(self) -> None:
        ros, session = self.session.ros, self.session
        self.node = node = session.node(NODE, self.names.namespace)
        self._float = ros.std.Float64()
        self._publishers = [
            node.create_publisher(ros.std.Float64, self.names.command(name), session.qos)
            for name in self.steering.vehicle.actuators
        ]
        policies = ros.qos
        latched = policies.QoSProfile(depth=1, durability=policies.DurabilityPolicy.TRANSIENT_LOCAL)
        self._state = node.create_publisher(ros.std.String, self.names.of(f"{NODE}/state"), latched)
        node.create_subscription(ros.nav.Odometry, self.names.odometry, self._odometry, session.qos)
        node.create_subscription(ros.geometry.PoseStamped, GOAL, self._goal, session.qos)
        if self._sim_time:
            node.create_subscription(ros.rosgraph.Clock, interface.CLOCK, self._clock, session.qos)
        node.create_service(ros.services.SetBool, self.names.of(f"{NODE}/arm"), self._arm)
        node.create_service(ros.services.Trigger, self.names.of(f"{NODE}/stop"), self._stop)
        session.renew()

    def wait_for_odometry(self, seconds: float) -> bool:
        """Wait for the vehicle's odometry at most `seconds`; without it, report the namespaces there are."""
        if self.session.discovered(lambda: self.node.count_publishers(self.names.odometry) > 0, seconds):
            return True
        self._report(discovery.explain_absence(self.node, self.names.namespace, "--namespace"))
        return False

    # Incoming messages.

    def _odometry(self, message: Any) -> None:
        pose, velocity = np.empty(7), np.empty(6)
        interface.read_pose(message.pose.pose, pose)
        interface.read_twist(message.twist.twist, velocity)
        self._take_pose(interface.read_time(message.header.stamp), pose, velocity)

    def _clock(self, message: Any) -> None:
        self._take_time(interface.read_time(message.clock) / 1e9)

    def _goal(self, message: Any) -> None:
        frame = message.header.frame_id.lstrip("/")
        pose = np.empty(7)
        interface.read_pose(message.pose, pose)
        if frame not in ("", interface.WORLD):
            self._report(f"waypoint ignored: the frame is {frame!r}, must be {interface.WORLD!r}")
        elif self.limits.holds and not loop.is_turn(pose):
            self._report("waypoint ignored: the orientation is not a unit quaternion")
        else:
            self.steer_to(pose[:3].tolist(), yaw_of(pose))

    def _arm(self, request: Any, response: Any) -> Any:
        if request.data:
            response.message = self.arm()
            response.success = not response.message
        else:
            self.disarm("by the service arm")
            response.success = True
        return response

    def _stop(self, _request: Any, response: Any) -> Any:
        self.disarm("by the service stop")
        self.steering.waypoint = None
        response.success = True
        return response

    # The network of `loop.Pilot`.

    def _receive(self, seconds: float) -> None:
        self.session.spin_once(seconds)

    def _command(self, quantities: Floats) -> None:
        for publisher, value in zip(self._publishers, quantities.tolist(), strict=True):
            self._float.data = value
            publisher.publish(self._float)

    def _take_over(self) -> str:
        count = self.node.count_publishers
        if count(self.names.odometry) > 1:
            return f"{self.names.odometry}: several publishers"
        for name in self.steering.vehicle.actuators:
            topic = self.names.command(name)
            if count(topic) > 1:
                return f"{topic}: another client commands this vehicle"
            if self.node.count_subscribers(topic) == 0:
                return f"{topic}: no subscriber"
        return ""

    def _leave(self, was_armed: bool) -> None:
        try:
            if was_armed:
                duration = self.session.ros.duration.Duration(seconds=1.0)
                for publisher in self._publishers:
                    publisher.wait_for_all_acked(duration)
        finally:
            self.session.close()

    def _report(self, text: str) -> None:
        self._state.publish(self.session.ros.std.String(data=text))
        super()._report(text)
