"""A node that steers a vehicle by a controller, and commands zero thrust in doubt.

It starts disarmed, and commands nothing while disarmed. Armed, it steers only with a young pose within the depth
limits, a waypoint and a finite action; otherwise it commands zero thrust. Zero thrust is also its last command.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import AuvbenchError, RunError
from auvbench.observation import ObservationSpec
from auvbench.ros2 import discovery, interface, messages
from auvbench.ros2.middleware import Session
from auvbench.ros2.mission import Logbook
from auvbench.ros2.observation import yaw_of
from auvbench.ros2.steering import Controller, Limits, Steering
from auvbench.ros2.thrust import SheetThrust

Floats = NDArray[np.float64]

NODE = "pilot"
GOAL = "/goal_pose"
RESTS = 3
"""zero commands at the end: one may be lost"""
TURN = 0.02
"""s, the longest single wait, and so the delay with which an old pose is noticed"""


class Pilot:
    """One vehicle under one controller.

    Args:
        namespace: of the vehicle.
        controller: maps observations to actions.
        thrust: converts its actions into commands.
        frequency: Hz of the controller.
        spec: of its observation.
        limits: that it keeps.
        sim_time: step by `/clock` in place of this machine's clock; ages of poses are by this machine's clock.
        logbook: records missions.
        say: called with each change of state.

    Raises:
        ConfigError: ROS 2 does not start.
    """

    def __init__(
        self,
        namespace: str,
        controller: Controller,
        thrust: SheetThrust,
        *,
        frequency: float,
        spec: ObservationSpec,
        limits: Limits,
        sim_time: bool = False,
        logbook: Logbook | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.names = interface.Names(interface.namespaces(namespace, 1)[0])
        self.thrust, self.limits, self._say = thrust, limits, say
        self.period = 1.0 / frequency  # s
        self.steering = Steering(
            controller, thrust, frequency=frequency, spec=spec, limits=limits, logbook=logbook
        )
        self.armed = False
        self.state = ""
        self.pose: Floats = np.full(7, np.nan)
        self.velocity: Floats = np.zeros(6)
        self._received = -math.inf  # when the pose came, by this machine
        self._stamp = -1
        self._now = -1.0  # of /clock
        self._sim_time = sim_time
        self._slow = 0
        self._due = 0.0
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
            for name in self.thrust.actuators
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
        stamp = messages.read_time(message.header.stamp)
        behind = (self._stamp - stamp) / 1e9  # s
        if behind > self.limits.pose_timeout:
            self._clock_went_back()
        elif behind >= 0.0 and stamp:
            return  # repeated or overtaken: the pose gets no younger
        pose, velocity = np.empty(7), np.empty(6)
        messages.read_pose(message.pose.pose, pose)
        messages.read_twist(message.twist.twist, velocity)
        if not np.all(np.isfinite([*pose, *velocity])) or not _is_turn(pose):
            return
        self._stamp = stamp
        self.pose, self.velocity = pose, velocity
        self._received = time.monotonic()

    def _clock(self, message: Any) -> None:
        now = messages.read_time(message.clock) / 1e9
        if now < self._now - self.limits.pose_timeout:
            self._clock_went_back()
        self._now = now

    def _clock_went_back(self) -> None:
        """Disarm: a clock that goes back is that of another server, whose vehicle may be elsewhere."""
        self.disarm("the clock went back (was the server restarted?)")

    def _goal(self, message: Any) -> None:
        frame = message.header.frame_id.lstrip("/")
        pose = np.empty(7)
        messages.read_pose(message.pose, pose)
        if self.limits.holds and not _is_turn(pose):
            self._report(f"{GOAL}: ignored: the orientation is not a unit quaternion")
            return
        self.steer_to(pose[:3].tolist(), frame, yaw_of(pose))

    def steer_to(self, waypoint: Sequence[float], frame: str = interface.WORLD, yaw: float = 0.0) -> bool:
        """Take a waypoint (3,) in m, and the yaw in rad of a station; return False if it is not allowed."""
        limits = self.limits
        if frame not in ("", interface.WORLD):
            self._report(f"{GOAL}: ignored: the frame is {frame!r}, must be {interface.WORLD!r}")
            return False
        if not np.all(np.isfinite(waypoint)):
            self._report(f"{GOAL}: ignored: not finite")
            return False
        if not limits.within(waypoint[2]):
            self._report(f"{GOAL}: ignored: z = {waypoint[2]:g} m, must be within {limits.depths}")
            return False
        self.steering.end("another waypoint")
        self.steering.waypoint, self.steering.yaw = np.array(waypoint, dtype=np.float64), yaw
        return True

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

    def arm(self) -> str:
        """Let the controller steer; return why it may not, or an empty text."""
        if self.armed:
            return ""
        age = self.age
        count = self.node.count_publishers
        if age > self.limits.pose_timeout:
            return f"{self.names.odometry} " + ("never came" if math.isinf(age) else f"is {age:.2g} s old")
        if count(self.names.odometry) > 1:
            return f"{self.names.odometry}: several publishers"
        if not self.limits.within(self.pose[2]):
            return self._depth()
        for name in self.thrust.actuators:
            topic = self.names.command(name)
            if count(topic) > 1:
                return f"{topic}: another client commands this vehicle"
            if self.node.count_subscribers(topic) == 0:
                return f"{topic}: no subscriber"
        self.armed = True
        self._set_state("armed")
        return ""

    def disarm(self, reason: str) -> None:
        """Command zero thrust, then nothing until armed again."""
        was = self.armed
        self.armed = False
        self.steering.end(reason)
        if was:
            self.stop_thrusters()
        self._set_state(f"disarmed: {reason}")

    # Outgoing messages.

    @property
    def age(self) -> float:
        """Seconds since the pose came."""
        return time.monotonic() - self._received

    def stop_thrusters(self) -> None:
        """Command zero thrust several times."""
        for _ in range(RESTS):
            self._command(self.thrust.neutral)

    def _command(self, quantities: Floats) -> None:
        for publisher, value in zip(self._publishers, quantities.tolist(), strict=True):
            self._float.data = value
            publisher.publish(self._float)

    def _set_state(self, state: str) -> None:
        if state != self.state:
            self.state = state
            self._report(state)

    def _report(self, text: str) -> None:
        self._state.publish(self.session.ros.std.String(data=text))
        self._say(text)

    # Steering.

    def step(self) -> None:
        """Make one step of the controller if it may steer.

        Raises:
            RunError: the controller failed or gave an invalid action; the pilot is then disarmed.
        """
        if not self.armed:
            return
        if not self.may_steer():
            return
        outcome = self.steering.advance(self.pose)
        if outcome:
            self.steering.waypoint = None
            self.steering.end(outcome)
            self._set_state(f"waypoint {'reached' if outcome == 'success' else 'given up: ' + outcome}")
        if self.steering.waypoint is None:
            self._command(self.thrust.neutral)
            return
        self._act(self.steering.waypoint)

    def may_steer(self) -> bool:
        """Check pose and depth; return whether the controller may steer."""
        if not self.armed:
            return False
        age = self.age
        if age > self.limits.lost_after:
            self.disarm(f"{self.names.odometry} is {age:.1f} s old")
        elif age > self.limits.pose_timeout:
            self._hold(f"holding: {self.names.odometry} is {age:.1f} s old")
        elif not self.limits.within(self.pose[2]):
            self.steering.advance(self.pose)
            self.disarm(self._depth())
        else:
            return True
        return False

    def _hold(self, state: str) -> None:
        self.steering.skip_record()
        self._command(self.thrust.neutral)
        if not self.state.startswith("holding"):
            self._set_state(state)

    def _depth(self) -> str:
        return f"z = {self.pose[2]:.2f} m is not within {self.limits.depths}"

    def _act(self, waypoint: Floats) -> None:
        try:
            action = self.steering.act(self.pose, self.velocity)
        except Exception as error:
            raise self._failed(error) from error
        if self.steering.action_time > self.period:
            self._slow += 1
            if self._slow in (1, 10, 100):
                self._report(f"the controller takes longer than its step of {self.period:g} s")
        self._command(self.thrust.quantities(action))
        self._set_state(f"steering to ({waypoint[0]:.1f}, {waypoint[1]:.1f}, {waypoint[2]:.1f})")

    def _failed(self, error: Exception) -> AuvbenchError:
        """Disarm, and return the error with which the command ends."""
        reason = " ".join(str(error).split()) or type(error).__name__
        self.disarm(f"the controller failed: {reason}")
        return error if isinstance(error, AuvbenchError) else RunError(f"the controller failed: {reason}")

    def run(self, go_on: Callable[[], bool]) -> None:
        """Serve and steer while `go_on()`; the end is always zero thrust.

        Raises:
            AuvbenchError: the controller failed, or the logbook cannot be written.
        """
        try:
            while go_on():
                self.spin_once()
        finally:
            self.close("the pilot was ended")

    def spin_once(self) -> None:
        """Serve for a moment, check the pose, and steer when a step is due.

        Raises:
            AuvbenchError: as `run`.
        """
        period = self.period
        now = self._now if self._sim_time else time.monotonic()
        if self._sim_time and now < self._due - 2 * period:
            self._due = now  # the clock of a restarted server
        if now >= self._due:
            self.step()
            self._due = self._due + period if now - self._due < period else now + period
            return
        # How long a step of simulated time lasts here is unknown.
        self.session.spin_once(TURN if self._sim_time else min(self._due - now, TURN))
        self.may_steer()

    def close(self, reason: str) -> None:
        """Command zero thrust, wait until it arrives, and leave the network."""
        if not self.session.context.ok():
            return
        try:
            was = self.armed
            self.disarm(reason)
            if was:
                duration = self.session.ros.duration.Duration(seconds=1.0)
                for publisher in self._publishers:
                    publisher.wait_for_all_acked(duration)
        finally:
            self.session.close()


def _is_turn(pose: Floats) -> bool:
    """Return whether the orientation of a pose (7,) is a unit quaternion."""
    return abs(float(np.linalg.norm(pose[3:])) - 1.0) <= 0.01
