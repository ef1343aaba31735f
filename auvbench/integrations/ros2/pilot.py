"""Pilot a vehicle as a ROS 2 node, which sends commands and receives poses and waypoints."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.integrations.ros2 import discovery, interface, sender
from auvbench.integrations.ros2.middleware import Session
from auvbench.pilot import loop
from auvbench.pilot.guard import Guard
from auvbench.pilot.live_observation import yaw_of
from auvbench.pilot.possible import is_turn
from auvbench.pilot.steering import Steering

Floats = NDArray[np.float64]

NODE = "pilot"
GOAL = "/goal_pose"
RESTS = 5
"""number of zero commands that the supervisor sends at the end, since some may be lost"""


class Pilot(loop.Pilot):
    """Pilot that is a ROS 2 node.

    Args:
        namespace: namespace of the vehicle.
        steering: see `loop.Pilot`.
        options: see `loop.Pilot`; `sim_time` steps by `/clock`.

    Raises:
        ConfigError: ROS 2 does not start.
    """

    def __init__(self, namespace: str, steering: Steering, **options: Any) -> None:
        super().__init__(steering, **options)
        self.names = interface.Names(interface.namespaces(namespace, 1)[0])
        self.source = self.names.odometry
        self.session = Session()
        self._publishers: list[Any] = []  # used when the supervisor is lost
        try:
            self._make()
        except BaseException:
            self.session.close()
            raise
        self._set_state("disarmed")

    def _make(self) -> None:
        ros, session = self.session.ros, self.session
        self.node = node = session.node(NODE, self.names.namespace)
        self._topics = [self.names.command(name) for name in self.steering.vehicle.actuators]
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
        self._supervisor = f"pilot_supervisor_{os.getpid()}"
        words = (sender.__file__, str(interface.DEPTH), self._supervisor, *self._topics)
        self.guard = Guard(*words, patience=self.limits.patience)
        self.guard.leave_will([_content(self.physical.neutral)] * RESTS)

    def wait_for_odometry(self, seconds: float) -> bool:
        """Wait at most `seconds` for a publisher of the vehicle's odometry; return whether a publisher was found.

        If no publisher was found, the existing namespaces are reported.
        """
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
        elif self.limits.holds and not is_turn(pose):
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

    # Methods by which `loop.Pilot` uses the network.

    def _receive(self, seconds: float) -> None:
        self.guard.live()
        self.session.spin_once(seconds)

    def _command(self, quantities: Floats) -> None:
        if not self.guard.forward(_content(quantities)):
            self._publish(quantities)

    def _publish(self, quantities: Floats) -> None:
        """Publish a command from this process, because the supervisor is lost."""
        if not self._publishers:
            kind, qos = self.session.ros.std.Float64, self.session.qos
            self._publishers = [self.node.create_publisher(kind, topic, qos) for topic in self._topics]
            matched = [publisher.get_subscription_count for publisher in self._publishers]
            self.session.discovered(lambda: all(count() > 0 for count in matched), discovery.FOUND)
        for publisher, value in zip(self._publishers, quantities.tolist(), strict=True):
            publisher.publish(self.session.ros.std.Float64(data=value))

    def _take_over(self) -> str:
        node = self.node
        if node.count_publishers(self.names.odometry) > 1:
            return f"{self.names.odometry}: several publishers"
        for topic in self._topics:
            names = [info.node_name for info in node.get_publishers_info_by_topic(topic)]
            if any(name != self._supervisor for name in names):
                return f"{topic}: another client commands this vehicle"
            if node.count_subscribers(topic) == 0:
                return f"{topic}: no subscriber"
        return ""

    def _leave(self, was_armed: bool) -> None:
        try:
            self.guard.close()
            duration = self.session.ros.duration.Duration(seconds=1.0)
            for publisher in self._publishers:
                publisher.wait_for_all_acked(duration)
        finally:
            self.session.close()

    def _report(self, text: str) -> None:
        self._state.publish(self.session.ros.std.String(data=text))
        super()._report(text)


def _content(quantities: Floats) -> bytes:
    """Return commands, (n_u,), as the bytes that the supervisor's `Sender` takes."""
    return np.asarray(quantities, dtype=np.float64).tobytes()
