"""Serve a simulator over ROS 2: vehicles that take commands and publish poses, and a clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.errors import AuvbenchError
from auvbench.integrations.ros2 import interface
from auvbench.integrations.ros2.middleware import SLICE, InterfaceError, Session
from auvbench.integrations.ros2.sensors import Sensed
from auvbench.integrations.ros2.vehicle_node import ALLOWED, Settings, VehicleNode, is_current
from auvbench.untrusted.text import say

Floats = NDArray[np.float64]

SINCE = "since_"
"""prefix of a node's name in each vehicle's namespace; the server's start time follows, so that the later of two servers can exit"""


class Simulated(Protocol):
    """The part of `auvbench.simulators.base.Simulator` that a server uses."""

    n: int
    pose: Floats
    velocity: Floats
    effectiveness: Floats

    def reset(
        self,
        indices: NDArray[np.integer[Any]],
        pose: ArrayLike,
        velocity: ArrayLike,
        scales: ArrayLike | None = None,
    ) -> None: ...

    def set_current(
        self, velocity: ArrayLike, bottom: ArrayLike | None = None, depths: tuple[ArrayLike, ArrayLike] = ...
    ) -> None: ...

    def step(self, command: ArrayLike, duration: float) -> None: ...


class Server:
    """Server of N vehicles in one world.

    Args:
        simulator: simulator that takes commands as `commands` returns them.
        commands: function that converts physical quantities (n, n_u), newtons for thrusters, to the
            simulator's commands (n, n_u).
        actuators: names of the actuators, in the order of a command's columns.
        neutral: physical quantities that the server applies until the first command, (n_u,).
        namespaces: namespaces of the n vehicles.
        start: pose at the start, (7,); also the pose after `reset`, unless a client sets the parameter `start_pose`.
        step_duration: time in s between two messages; also the step of the service `step`.
        pace: simulated seconds per second; 0: as fast as possible.
        lockstep: whether to begin in lock-step.
        about: read-only parameters.

    Raises:
        ConfigError: ROS 2 does not start.
    """

    def __init__(
        self,
        simulator: Simulated,
        commands: Callable[[Floats], Floats],
        actuators: Sequence[str],
        neutral: Floats,
        namespaces: Sequence[str],
        *,
        start: Sequence[float],
        step_duration: float,
        pace: float = 1.0,
        lockstep: bool = False,
        about: dict[str, str] | None = None,
    ) -> None:
        self.simulator = simulator
        self.sensed = simulator if isinstance(simulator, Sensed) else None
        """the simulator, if its vehicles have sensors"""
        self.commands = commands
        self.actuators = tuple(actuators)
        self.namespaces = list(namespaces)
        self.settings = Settings(step_duration=step_duration, pace=pace)
        self.lockstep = lockstep
        self.paused = False
        self.time = 0
        """simulated time in ns"""
        n, n_u = simulator.n, len(self.actuators)
        self.neutral = np.array(neutral, dtype=np.float64)
        self.quantities: Floats = np.tile(self.neutral, (n, 1))
        self.new = np.zeros((n, n_u), dtype=np.bool_)
        """(n, n_u) whether a command has come since the last step"""
        self.currents: Floats = np.zeros((n, 8))
        """(n, 8) currents: velocity at the top (3) and at the bottom (3) in m/s, depth of the top and of the bottom in m"""
        self.currents[:, 7] = 1.0
        self.session = Session()
        self._missing = n * n_u
        self._refused: tuple[float, ...] | None = None
        self.goes_on: Callable[[], bool] = lambda: True
        """function that returns whether to continue; long services call it between two steps"""
        self._due = time.monotonic()
        ros = self.session.ros
        self.vehicles = [
            VehicleNode(self, i, name, start, about or {}) for i, name in enumerate(self.namespaces)
        ]
        # Each start time has 19 digits, so the names sort by start time.
        self.since = f"{SINCE}{time.time_ns()}"
        for name in self.namespaces:
            self.session.node(self.since, name)
        first = self.vehicles[0].node
        self._clock = first.create_publisher(ros.rosgraph.Clock, interface.CLOCK, self.session.qos)
        self._now = ros.rosgraph.Clock()
        first.create_subscription(
            ros.geometry.Vector3, interface.CURRENT, self._set_current, self.session.qos
        )
        if self.sensed is not None:
            self.sensed.sampled = self._sense
        self.session.renew()
        self.reset(range(n))

    # Called by the vehicles' nodes.

    def command(self, vehicle: int, actuator: int, quantity: float) -> None:
        """Take a command; in lock-step, the last missing command starts the step."""
        if not np.isfinite(quantity):
            return  # the previous command stays
        self.quantities[vehicle, actuator] = quantity
        if not self.new[vehicle, actuator]:
            self.new[vehicle, actuator] = True
            self._missing -= 1
        if self.lockstep and not self._missing:
            self.advance()

    def reset(self, indices: Sequence[int]) -> str:
        """Put vehicles at the poses and velocities in their parameters; return why this failed, or ''.

        The commands become neutral and the thrusters healthy.
        """
        for i in indices:
            vehicle = self.vehicles[i]
            pose, velocity, scales = vehicle.start
            plain = None if bool(np.all(scales == 1.0)) else scales[None]
            try:
                self.simulator.reset(np.array([i]), pose[None], velocity[None], plain)
            except AuvbenchError as error:
                return str(error)
            self.quantities[i] = self.neutral
            vehicle.restore_thrusters()
        self.discard_commands(indices)
        self.publish(indices)
        return ""

    def discard_commands(self, indices: Sequence[int]) -> None:
        """Mark the commands received so far as not new, so that lock-step waits for new commands."""
        self.new[list(indices)] = False
        self._missing = int(self.new.size - np.count_nonzero(self.new))

    def apply_currents(self) -> None:
        """Set the simulator's currents."""
        now = self.currents
        self.simulator.set_current(now[:, :3], now[:, 3:6], (now[:, 6], now[:, 7]))

    def set_paused(self, paused: bool) -> None:
        """Pause the world, or continue it."""
        self.paused = paused
        self._due = time.monotonic()

    def set_lockstep(self, lockstep: bool) -> str:
        """Enter or leave lock-step; return why that failed, or ''."""
        if lockstep:
            for name in self.namespaces:
                topic = interface.Names(name).command(self.actuators[0])
                if self.vehicles[0].node.count_publishers(topic) > 1:
                    return f"{topic}: has several publishers, but lock-step allows only one"
        self.lockstep = lockstep
        self._due = time.monotonic()
        self.discard_commands(range(self.simulator.n))
        self.publish(range(self.simulator.n))
        return ""

    # The world.

    def advance(self) -> None:
        """Make one step of the world, and publish its state."""
        duration = self.settings.step_duration
        self.simulator.step(self.commands(self.quantities), duration)
        self.time += interface.nanoseconds(duration)
        self.new[:] = False
        self._missing = self.new.size
        self.publish(range(self.simulator.n))

    def publish(self, indices: Sequence[int]) -> None:
        """Publish the state of vehicles, and the time."""
        poses, velocities = self.simulator.pose.tolist(), self.simulator.velocity.tolist()
        seen = (poses, velocities)
        if self.sensed is not None:
            seen = self.sensed.navigation.pose.tolist(), self.sensed.navigation.velocity.tolist()
        for i in indices:
            self.vehicles[i].publish(poses[i], seen[0][i], seen[1][i], self.time)
        if self._clock.get_subscription_count():
            interface.write_time(self._now.clock, self.time)
            self._clock.publish(self._now)

    def _sense(self, left: float) -> None:
        """Publish the sensor readings that were sampled `left` s before the end of a step."""
        now = self.time + interface.nanoseconds(self.settings.step_duration - left)
        for vehicle in self.vehicles:
            vehicle.sense(now)

    def _set_current(self, message: Any) -> None:
        water = (message.x, message.y, message.z)
        if wrong := is_current(water):
            if water != self._refused:  # report a rejected current only once, although clients may repeat it
                say(f"auvbench: {interface.CURRENT}: must be {ALLOWED['current']}, but {wrong}; ignored")
            self._refused = water
        else:
            self.currents[:, :3] = self.currents[:, 3:6] = water
            self.apply_currents()

    def run(self, go_on: Callable[[], bool]) -> None:
        """Serve while `go_on()` returns True.

        Raises:
            AuvbenchError: the simulator failed, or an earlier server has one of the namespaces.
        """
        self.goes_on = go_on
        self._due = look = time.monotonic()
        while go_on():
            self.spin_once()
            if time.monotonic() >= look:
                # On a busy machine another server is discovered late.
                self._leave_to(self._claimed(by="server"))
                look = time.monotonic() + 1.0

    def spin_once(self) -> None:
        """Handle messages for at most `SLICE` s, and make a step if it is due."""
        if self.lockstep or self.paused:
            self.session.spin_once(SLICE)
            return
        pace = self.settings.pace
        wait = min(max(self._due - time.monotonic(), 0.0), SLICE) if pace > 0.0 else 0.0
        if self.session.spin_once(wait) and wait > 0.0:
            return
        now = time.monotonic()
        # A client may just have requested lock-step, or a pause.
        if self.lockstep or self.paused or (pace > 0.0 and now < self._due):
            return
        self.advance()
        if pace > 0.0:
            period = self.settings.step_duration / pace
            # If more than five steps late, skip the missed steps instead of making them all at once.
            self._due = now if now - self._due > 5 * period else self._due + period

    def check_alone(self, seconds: float) -> None:
        """Check for `seconds` whether another program publishes these vehicles' odometry.

        Raises:
            InterfaceError: another program publishes the odometry, and that program is not a server that started after this one.
        """
        self.session.discovered(lambda: bool(self._claimed()), seconds)
        self._leave_to(self._claimed())

    def _leave_to(self, topic: str) -> None:
        if topic:
            raise InterfaceError(
                f"{topic}: another server publishes this topic; stop one of the servers, or "
                "choose another name with --namespace"
            )

    def _claimed(self, by: Literal["any", "server"] = "any") -> str:
        """Return an odometry topic of these vehicles that an earlier program also publishes; '' without such a topic.

        Args:
            by: "any": consider all publishers except later servers; "server": consider only servers, since any other
                publisher may have started later.
        """
        node = self.vehicles[0].node
        for name in self.namespaces:
            topic = interface.Names(name).odometry
            if node.count_publishers(topic) > 1:
                nodes = node.get_node_names_and_namespaces()
                began = [
                    name_found
                    for name_found, space in nodes
                    if space == f"/{name}" and name_found.startswith(SINCE)
                ]
                if min(began, default=self.since) < self.since or (by == "any" and len(began) < 2):
                    return topic
        return ""

    def close(self) -> None:
        """Leave the network."""
        self.session.close()
