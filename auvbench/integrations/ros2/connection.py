"""Connect to a server, and move its N vehicles step by step with one of three clocks.

`lockstep`: before each step, the server waits for a command to every actuator; after the step, the server sends odometry with the
time at the end of the step, so that the client notices a lost message. `clock`: the server's `/clock` ends a step. `wall`: this
machine's clock ends a step, as in the original study.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import TrainingError
from auvbench.integrations.ros2 import discovery, interface
from auvbench.integrations.ros2.discovery import FOUND, LEASE, LEAVING, SETTLE
from auvbench.integrations.ros2.middleware import Answer, InterfaceError, Session

Floats = NDArray[np.float64]

CLOCKS = ("lockstep", "clock", "wall")

NEAR = 1.0
"""largest distance in m between the requested pose of a reset and the next odometry; it is not 0, since vehicles move
while a client waits
"""


class Connection:
    """All N vehicles of one server.

    Args:
        namespace: namespace of the vehicle, or the common part of several vehicles' namespaces.
        actuators: names of the actuators, in the order of a command's columns.
        clock: one of CLOCKS, or auto for the first of CLOCKS that the server offers.
        timeout: time in s without an answer after which the connection is lost.

    Raises:
        ConfigError: ROS 2 does not start.
        InterfaceError: a topic or service is missing, or another program uses it.

    Attributes:
        clock: the clock in use, one of CLOCKS.
        lost: whether this connection cannot continue, because the server did not answer or another client moved the
            server's vehicles.
        pose: (n, 7) last poses; `velocity` (n, 6) last velocities.

    """

    def __init__(
        self, namespace: str, actuators: Sequence[str], clock: str = "auto", timeout: float = 10.0
    ) -> None:
        self.namespace = interface.namespaces(namespace, 1)[0]
        self.actuators = tuple(actuators)
        self.timeout = timeout
        self.lost = False
        self.session = Session()
        try:
            self.node = self.session.node("auvbench_client")
            self.names, self.about = discovery.find_server(self.session, self.node, self.namespace, timeout)
            self._prepare()
            self._make()
            discovery.check_endpoints(self.session, self.node, self._endpoints, timeout)
            self._server = self._publishers()
            self.clock = self._choose(clock)
            self._begin()
        except BaseException:
            self.session.close()
            raise

    def _prepare(self) -> None:
        """Set up the vehicles' state before the first message."""
        self.n = len(self.names)
        self.pose: Floats = np.zeros((self.n, 7))
        self.pose[:, 3] = 1.0
        self.velocity: Floats = np.zeros((self.n, 6))
        self.owner: object = None
        """the simulator that uses the vehicles at present; only one at a time"""
        self._received = np.zeros(self.n, dtype=np.int64)
        """(n,) number of poses received"""
        self._stamp = np.full(self.n, -1, dtype=np.int64)
        self._time = -1
        self._duration = float("nan")
        self._behind = self.n
        self._expected = -1
        self._reached = 0
        self._due = 0.0

    # Connecting.

    @property
    def usable(self) -> bool:
        """Return whether the server of this connection is the only server that publishes the first vehicle's odometry.

        A restarted server has the same topics, but its clock begins at 0.
        """
        return not self.lost and self._publishers() == self._server

    def _publishers(self) -> list[bytes]:
        """Return the identifiers of the publishers of the first vehicle's odometry."""
        endpoints = self.node.get_publishers_info_by_topic(self.names[0].odometry)
        return sorted(bytes(endpoint.endpoint_gid) for endpoint in endpoints)

    def _make(self) -> None:
        ros, session = self.session.ros, self.session
        node = self.node
        self._float = ros.std.Float64()
        self._endpoints = []
        for i, names in enumerate(self.names):
            receive = self._odometry(i)
            node.create_subscription(ros.nav.Odometry, names.odometry, receive, session.qos, raw=True)
            topics = [names.command(actuator) for actuator in self.actuators]
            self._endpoints.append(
                discovery.Endpoints(
                    names,
                    {topic: node.create_publisher(ros.std.Float64, topic, session.qos) for topic in topics},
                    node.create_client(ros.services.Trigger, names.reset),
                    node.create_client(ros.parameters.SetParameters, names.parameters),
                )
            )
        self._current = node.create_publisher(ros.geometry.Vector3, interface.CURRENT, session.qos)
        self._lockstep = node.create_client(ros.services.SetBool, self.names[0].lockstep)
        session.renew()

    def _choose(self, clock: str) -> str:
        """Return the clock that ends steps.

        Raises:
            InterfaceError: the server lacks the requested clock.
        """
        offered = {
            "lockstep": self._lockstep.service_is_ready,
            "clock": lambda: self.node.count_publishers(interface.CLOCK) > 0,
            "wall": lambda: True,
        }
        choice = clock
        if clock == "auto":
            # auvbench's own server offers lock-step, even if the service is not discovered yet.
            ours = "auvbench" in self.about
            self.session.discovered(lambda: ours or offered["lockstep"]() or offered["clock"](), FOUND)
            choice = "lockstep" if ours else next(name for name in CLOCKS if offered[name]())
        if not self.session.discovered(offered[choice], self.timeout):
            topic = self.names[0].lockstep if choice == "lockstep" else interface.CLOCK
            raise InterfaceError(
                f"{topic}: the server does not offer it, but simulator.clock={clock} needs it; use simulator.clock=auto"
            )
        if choice == "clock" and self.node.count_publishers(interface.CLOCK) > 1:
            raise InterfaceError(
                f"{interface.CLOCK}: {self.node.count_publishers(interface.CLOCK)} publishers: several servers in"
                " this domain; stop all but one, or set another ROS_DOMAIN_ID for each"
            )
        if choice == "clock":
            ros = self.session.ros
            self.node.create_subscription(ros.rosgraph.Clock, interface.CLOCK, self._clock, self.session.qos)
            self.session.renew()
        return choice

    def _begin(self) -> None:
        """Enter lock-step if it is used, and wait for the first messages."""
        begun = time.monotonic()
        deadline = begun + self.timeout
        since = 0
        while True:
            if self.clock == "lockstep":
                try:
                    since = self._enter_lockstep()
                except InterfaceError:
                    # A client that was killed may still be known to the server.
                    if time.monotonic() > begun + (LEAVING if self._is_shared() else LEASE):
                        raise
                    self.session.discovered(lambda: False, 0.1)
                    continue
            self._reached = since
            if self.session.until(lambda since=since: bool(np.all(self._stamp >= since)), SETTLE):  # type: ignore[misc]
                break
            if time.monotonic() > deadline:
                silent = self.names[int(np.argmin(self._stamp))].odometry
                raise InterfaceError(
                    f"{silent}: silent for {self.timeout:g} s; is the server paused, or stopped?"
                )
        if self.clock == "clock" and not self.session.until(lambda: self._time >= 0, self.timeout):
            raise InterfaceError(f"{interface.CLOCK}: silent for {self.timeout:g} s; is the server paused?")

    def _is_shared(self) -> bool:
        """Return whether another client commands a vehicle."""
        return any(
            self.node.count_publishers(topic) > 1 for ends in self._endpoints for topic in ends.commands
        )

    # Messages.

    def _odometry(self, i: int) -> Callable[[Any], None]:
        pose, velocity = np.zeros(7), np.zeros(6)

        def receive(message: bytes) -> None:
            try:
                stamp = interface.read_odometry(message, pose, velocity)
            except (ValueError, struct.error) as error:
                raise InterfaceError(f"{self.names[i].odometry}: {error}") from error
            if stamp < self._stamp[i]:
                return  # this message is older than the last message
            self._stamp[i] = stamp
            self._received[i] += 1
            self.pose[i], self.velocity[i] = pose, velocity
            if stamp >= self._expected >= 0:
                self._behind -= 1

        return receive

    def _clock(self, message: Any) -> None:
        self._time = interface.read_time(message.clock)

    # Services.

    def _answers(self, asked: Sequence[tuple[Answer, str]]) -> list[Any]:
        """Return the answers of services.

        Raises:
            TrainingError: an answer did not come in time.
        """
        self.session.until(lambda: all(answer.value is not None for answer, _ in asked), self.timeout)
        for answer, service in asked:
            if answer.value is None:
                raise self._give_up(
                    f"{service}: no answer within {self.timeout:g} s; does the server still run (ros2 node list)?"
                )
        return [answer.value for answer, _ in asked]

    def _enter_lockstep(self) -> int:
        """Request lock-step; return the server's time in ns.

        Raises:
            InterfaceError: the server refuses.
        """
        request = self.session.ros.services.SetBool.Request(data=True)
        service = self.names[0].lockstep
        (answer,) = self._answers([(self.session.ask(self._lockstep, request), service)])
        if not answer.success:
            raise InterfaceError(f"{service}: refused: {answer.message}")
        if not str(answer.message).isdecimal():
            raise InterfaceError(f"{service}: answered {answer.message!r}, must answer a time in ns")
        return int(answer.message)

    def set(self, values: dict[int, dict[str, Any]]) -> None:
        """Set parameters (floats or lists of floats) by vehicle index and parameter name.

        Raises:
            InterfaceError: the server rejects a parameter.
        """
        ros = self.session.ros
        asked = []
        for i, entries in values.items():
            request = ros.parameters.SetParameters.Request(
                parameters=[
                    ros.parameter.Parameter(name, value=value).to_parameter_msg()
                    for name, value in entries.items()
                ]
            )
            asked.append((self.session.ask(self._endpoints[i].parameters, request), self.names[i].parameters))
        for answer, (_, service) in zip(self._answers(asked), asked, strict=True):
            for result in answer.results:
                if not result.successful:
                    raise InterfaceError(f"{service}: refused: {result.reason}")

    def reset(self, indices: Sequence[int], parameters: dict[int, dict[str, Any]]) -> None:
        """Set parameters by vehicle, then reset vehicles `indices`.

        Raises:
            InterfaceError: the server refuses.
        """
        self.set(parameters)
        request = self.session.ros.services.Trigger.Request()
        asked = [(self.session.ask(self._endpoints[i].reset, request), self.names[i].reset) for i in indices]
        for answer, (_, service) in zip(self._answers(asked), asked, strict=True):
            if not answer.success:
                raise InterfaceError(f"{service}: refused: {answer.message}")
        self._due = 0.0  # the next step does not follow an earlier one

    def await_poses(self, indices: Sequence[int], poses: Floats) -> None:
        """Wait until vehicles are near `poses` (k, 7), since the answer to a reset may arrive before the first odometry after the reset."""
        which = list(indices)
        before = self._received[which].copy()

        def near() -> bool:
            distance = np.linalg.norm(self.pose[which, :3] - poses[:, :3], axis=1)
            return bool(np.all((distance < NEAR) & (self._received[which] > before)))

        self.session.until(near, self.timeout)

    def publish_current(self, current: Floats) -> bool:
        """Publish a current (3,) in m/s for all vehicles; return whether a server listens."""
        water = self.session.ros.geometry.Vector3()
        water.x, water.y, water.z = current.tolist()
        self._current.publish(water)
        return bool(self._current.get_subscription_count())

    # Steps.

    def step(self, quantities: Floats, duration: float) -> None:
        """Send commands as physical quantities, (n, n_u), and wait until the vehicles have moved for `duration` s.

        Raises:
            TrainingError: the server stopped sending, or another client makes steps on the same server.
        """
        if self.clock == "lockstep":
            if duration != self._duration:
                self.set({0: {"step_duration": duration}})
                self._duration = duration
            self.session.spin_once(0.0)
            self._check_time()
            self._expected = self._reached + interface.nanoseconds(duration)
            self._behind = self.n
            self._publish(quantities)
            self._wait(lambda: self._behind <= 0)
            self._reached = self._expected
            self._check_time()
            return
        now = self._time / 1e9 if self.clock == "clock" else time.monotonic()
        # Steps follow each other without a gap, unless the policy took longer than a step.
        self._due = (
            now + duration if not 0.0 <= self._due - now + duration <= duration else self._due + duration
        )
        before = self._received.copy()
        self._publish(quantities)
        if self.clock == "clock":
            self._wait(lambda: self._time / 1e9 >= self._due - 1e-9)
        else:
            self.session.until(lambda: time.monotonic() >= self._due, duration + self.timeout)
        self._wait(lambda: bool(np.all(self._received > before)))

    def _check_time(self) -> None:
        """Raise TrainingError if the server's clock is ahead of this run's own steps."""
        ahead = (int(self._stamp.max()) - self._reached) / 1e9
        if ahead > 0.0:
            raise self._give_up(
                f"{self.names[0].odometry}: is {ahead:g} s ahead of this run's own steps: another client steps or"
                " commands the same server (ros2 topic info -v on its commands)"
            )

    def _publish(self, quantities: Floats) -> None:
        message = self._float
        for ends, row in zip(self._endpoints, quantities.tolist(), strict=True):
            for publisher, value in zip(ends.commands.values(), row, strict=True):
                message.data = value
                publisher.publish(message)

    def _wait(self, condition: Callable[[], bool]) -> None:
        if self.session.until(condition, self.timeout):
            return
        i = int(np.argmin(self._stamp))
        topic = interface.CLOCK if self.clock == "clock" else self.names[i].odometry
        if self.node.count_publishers(self.names[i].odometry) == 0:
            why = "the server has stopped; start it again, and run the same command to continue"
        elif self.clock == "lockstep":
            why = (
                "was the server killed or halted, or did it leave lock-step? Start it again, and run the same command"
                f" to continue; if it runs, see what arrives: ros2 topic echo {self.names[i].command(self.actuators[0])}"
            )
        else:
            why = "was the server killed or paused, or is it slower than simulator.timeout?"
        raise self._give_up(f"{topic}: silent for {self.timeout:g} s; {why}")

    def _give_up(self, message: str) -> TrainingError:
        """Mark the connection as lost, and return the error to raise."""
        self.lost = True
        return TrainingError(message)

    def close(self) -> None:
        """Leave lock-step, so that the world runs at its own pace, and remove this client from the network."""
        if not self.session.context.ok():
            return
        try:
            if self.clock == "lockstep" and self._lockstep.service_is_ready():
                answer = self.session.ask(
                    self._lockstep, self.session.ros.services.SetBool.Request(data=False)
                )
                self.session.until(lambda: answer.value is not None, 0.5)
        finally:
            self.session.close()
