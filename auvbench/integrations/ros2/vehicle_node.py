"""Run the node of one vehicle on a server: topics, services and parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.schema import SCALES
from auvbench.integrations.ros2 import interface
from auvbench.integrations.ros2.sensors import Topics, write_covariances

if TYPE_CHECKING:
    from auvbench.integrations.ros2.server import Server

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Settings:
    """Settings of the world: parameters of the first vehicle's node."""

    step_duration: float  # s
    pace: float  # simulated seconds per second; 0: as fast as possible
    steps: int = 1  # number of steps that one call of the service `step` makes


MEANING = {
    "start_pose": "pose after a reset: x y z (m, world) qw qx qy qz (body to world)",
    "start_velocity": "velocity after a reset: u v w (m/s) p q r (rad/s), body axes",
    "scales": "factors from the next reset on: mass, buoyancy, inertia, added mass, damping, thrust",
    "effectiveness": "factor on each thruster's force: 1 healthy, 0 dead; a reset sets 1",
    "current": "water's velocity, world axes, m/s: 3 numbers, or 3 at the top, 3 at the bottom and their depths in m",
    "step_duration": "time between two odometry messages in s",
    "pace": "simulated seconds per second; 0 as fast as possible",
    "steps": "number of steps of the service step",
}

FASTEST = 20.0
"""largest component of a current, m/s; in a faster current, the motion of some vehicles becomes infinite"""

ALLOWED = {
    "start_pose": "7 doubles: x y z in -1e9 .. 1e9 m and a unit quaternion w x y z",
    "start_velocity": "6 doubles in -1e9 .. 1e9",
    "scales": "6 doubles in 0.1 .. 10",
    "effectiveness": "a double in 0 .. 1 for each actuator",
    "current": f"3 or 8 doubles: velocities in -{FASTEST:g} .. {FASTEST:g} m/s, and depths in -1e9 .. 1e9 m",
    "step_duration": "a double in 0.0001 .. 60 s",
    "pace": "a double in 0 .. 1000000",
    "steps": "an integer in 1 .. 1000000",
}
"""Type and range of the parameters that can be set."""


class VehicleNode:
    """All topics, services and parameters of one vehicle.

    Args:
        server: the vehicle's server.
        index: index of the vehicle on the server.
        namespace: namespace of the vehicle.
        start: pose (7,) after a `reset`.
        about: read-only parameters.
    """

    def __init__(
        self, server: Server, index: int, namespace: str, start: Sequence[float], about: dict[str, str]
    ) -> None:
        self.server, self.index = server, index
        session = server.session
        ros = session.ros
        self.node = node = session.node(interface.NODE, namespace, parameters=True)
        names = interface.Names(namespace)
        self._odometry = interface.odometry(ros, namespace)
        self._pose = ros.geometry.Pose()
        self._publishers = (
            node.create_publisher(ros.nav.Odometry, names.odometry, session.qos),
            node.create_publisher(ros.geometry.Pose, names.pose, session.qos),
        )
        self._sensors = server.sensed and Topics(session, node, namespace, server.sensed, index)
        for a, actuator in enumerate(server.actuators):
            receive = partial(self._command, a)
            node.create_subscription(ros.std.Float64, names.command(actuator), receive, session.qos)
        node.create_service(ros.services.Trigger, names.reset, self._reset)
        if index == 0:
            node.create_service(ros.services.SetBool, names.pause, self._pause)
            node.create_service(ros.services.Trigger, names.step, self._step)
            node.create_service(ros.services.SetBool, names.lockstep, self._lockstep)
        self._declare(start, about)

    @property
    def start(self) -> tuple[Floats, Floats, Floats]:
        """Return pose (7,), velocity (6,) and scales (6,) of the next reset."""
        get = self.node.get_parameter
        pose, velocity, scales = (
            np.array(get(name).value, dtype=np.float64) for name in ("start_pose", "start_velocity", "scales")
        )
        return pose, velocity, scales

    def sense(self, time: int) -> None:
        """Publish the readings that are new at `time` in ns."""
        if self._sensors is not None:
            self._sensors.publish(time)

    def publish(self, true_pose: list[float], pose: list[float], velocity: list[float], time: int) -> None:
        """Publish the vehicle's true pose, and its estimated pose and velocity, at `time` in ns."""
        # Serialising a message without a reader takes as long as stepping a vehicle.
        if self._publishers[0].get_subscription_count():
            odometry = self._odometry
            interface.write_time(odometry.header.stamp, time)
            interface.write_pose(odometry.pose.pose, pose)
            interface.write_twist(odometry.twist.twist, velocity)
            sensed = self.server.sensed
            if sensed is not None and sensed.navigation.is_filter:
                write_covariances(odometry, sensed.navigation.covariance[self.index])
            self._publishers[0].publish(odometry)
        if self._publishers[1].get_subscription_count():
            interface.write_pose(self._pose, true_pose)
            self._publishers[1].publish(self._pose)

    def restore_thrusters(self) -> None:
        """Restore the full force of all thrusters."""
        if min(self.node.get_parameter("effectiveness").value) != 1.0:
            parameter = self.server.session.ros.parameter.Parameter
            healthy = [1.0] * len(self.server.actuators)
            self.node.set_parameters([parameter("effectiveness", value=healthy)])

    def _declare(self, start: Sequence[float], about: dict[str, str]) -> None:
        ros, settings = self.server.session.ros, self.server.settings
        describe = ros.interfaces.ParameterDescriptor
        values: dict[str, Any] = {
            "start_pose": [float(x) for x in start],
            "start_velocity": [0.0] * 6,
            "scales": [1.0] * len(SCALES),
            "effectiveness": [1.0] * len(self.server.actuators),
            "current": [0.0] * 3,
        }
        if self.index == 0:
            values |= {
                "step_duration": settings.step_duration,
                "pace": settings.pace,
                "steps": settings.steps,
            }
        for name, value in values.items():
            # Dynamic typing lets this node reject a wrong type itself, with a message that names the valid type.
            descriptor = describe(
                description=MEANING[name], additional_constraints=ALLOWED[name], dynamic_typing=True
            )
            self.node.declare_parameter(name, value, descriptor)
        for name, text in (about | {"actuators": " ".join(self.server.actuators)}).items():
            self.node.declare_parameter(name, text, describe(description="about the server", read_only=True))
        self.node.add_on_set_parameters_callback(self._set)

    def _set(self, parameters: list[Any]) -> Any:
        """Check and apply the parameters that a client sets."""
        result = self.server.session.ros.interfaces.SetParametersResult
        rules = self._rules()
        for parameter in parameters:
            name, check = parameter.name, rules.get(parameter.name)
            wrong = ""
            if check is not None:
                typed = parameter.type_ == self.node.get_parameter(name).type_
                # 1 is an integer in ROS, and 1.0 a double.
                wrong = (
                    check(parameter.value)
                    if typed
                    else f"is {_kind(parameter)} (1 is an integer, 1.0 a double)"
                )
            if wrong:
                return result(successful=False, reason=f"{name}: must be {ALLOWED[name]}, but {wrong}")
        try:
            for parameter in parameters:
                self._apply(parameter.name, parameter.value)
        except Exception as error:
            return result(successful=False, reason=str(error))
        return result(successful=True)

    def _rules(self) -> dict[str, Callable[[Any], str]]:
        n_u = len(self.server.actuators)
        return {
            "start_pose": _is_pose,
            "start_velocity": lambda value: _numbers(value, (6,)),
            "scales": lambda value: _numbers(value, (len(SCALES),), low=0.1, high=10.0),
            "effectiveness": lambda value: _numbers(value, (n_u,), low=0.0, high=1.0),
            "current": is_current,
            "step_duration": self._is_duration,
            "pace": lambda value: "" if 0.0 <= value <= 1e6 else f"is {value}",
            "steps": lambda value: "" if 1 <= value <= 1_000_000 else f"is {value}",
        }

    def _is_duration(self, value: float) -> str:
        fixed = self.server.settings.step_duration
        if self.server.sensed is not None and value != fixed:
            return f"is {value}; with sensors it stays {fixed:g} s (step.frequency)"
        return "" if 1e-4 <= value <= 60.0 else f"is {value}"

    def _apply(self, name: str, value: Any) -> None:
        server = self.server
        if name == "effectiveness":
            server.simulator.effectiveness[self.index] = value
        elif name == "current":
            water = np.array(value, dtype=np.float64)
            server.currents[self.index] = water if water.size == 8 else [*water, *water, 0.0, 1.0]
            server.apply_currents()
        elif name in ("step_duration", "pace", "steps"):
            setattr(server.settings, name, value)

    def _command(self, actuator: int, message: Any) -> None:
        self.server.command(self.index, actuator, message.data)

    def _reset(self, _request: Any, response: Any) -> Any:
        response.message = self.server.reset([self.index])
        response.success = not response.message
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        self.server.set_paused(request.data)
        response.success = True
        return response

    def _step(self, _request: Any, response: Any) -> Any:
        self.server.set_paused(True)
        steps = self.server.settings.steps
        steps_done = 0
        while steps_done < steps and self.server.goes_on():
            self.server.advance()
            steps_done += 1
        response.success = steps_done == steps
        response.message = "" if response.success else f"the server stops after {steps_done} of {steps} steps"
        return response

    def _lockstep(self, request: Any, response: Any) -> Any:
        refused = self.server.set_lockstep(request.data)
        response.success = not refused
        response.message = refused or str(self.server.time)
        return response


def _kind(parameter: Any) -> str:
    """Return a parameter's type in words, e.g. "an integer array"."""
    words = str(parameter.type_.name).lower().replace("_", " ")
    return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"


def _numbers(value: Any, sizes: tuple[int, ...], low: float = -1e9, high: float = 1e9) -> str:
    """Return what is wrong with an array; '' if the array is valid."""
    if len(value) not in sizes:
        return f"has {len(value)}"
    wrong = next((x for x in value if not low <= x <= high), None)
    return "" if wrong is None else f"one is {wrong}"


def _is_pose(value: Any) -> str:
    wrong = _numbers(value, (7,))
    if wrong:
        return wrong
    length = float(np.linalg.norm(value[3:]))
    return "" if abs(length - 1.0) < 1e-3 else f"its quaternion has length {length:.4g}"


def is_current(value: Any) -> str:
    """Return what is wrong with a current; '' if the current is valid."""
    wrong = _numbers(value, (3, 8)) or _numbers(value[:6], (3, 6), -FASTEST, FASTEST)
    if not wrong and len(value) == 8 and not value[7] > value[6]:
        wrong = f"the depth of the bottom, {value[7]:g} m, is not larger than the depth of the top, {value[6]:g} m"
    return wrong
