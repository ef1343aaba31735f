"""Load rclpy when needed, and serve its wait set without rclpy's executor.

The executor creates a task for each message and rebuilds its lists at each wait. On one core, lock-step with
six commands and one odometry message per step reached 770 steps a second with the executor, and 3500 without it.
The loop here waits on the same wait set, as rclpy's `wait_for_message` does.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from auvbench import isolation
from auvbench.errors import ConfigError, MissingExtraError, closest
from auvbench.integrations.ros2 import interface
from auvbench.untrusted.text import first_line

LAST_DOMAIN = 232
"""Highest domain whose ports are below 65536."""

SLICE = 0.05
"""Longest single wait in s; signals are handled between two waits."""

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable that names a file with profiles for Fast DDS in ROS 2 Jazzy."""

DISCOVERY = Path(__file__).with_name("discovery.xml")

_MODULES = {
    "rclpy": "rclpy",
    "node": "rclpy.node",
    "context": "rclpy.context",
    "duration": "rclpy.duration",
    "qos": "rclpy.qos",
    "signals": "rclpy.signals",
    "parameter": "rclpy.parameter",
    "implementation": "rclpy.impl.implementation_singleton",
    "std": "std_msgs.msg",
    "geometry": "geometry_msgs.msg",
    "nav": "nav_msgs.msg",
    "rosgraph": "rosgraph_msgs.msg",
    "services": "std_srvs.srv",
    "interfaces": "rcl_interfaces.msg",
    "parameters": "rcl_interfaces.srv",
}


class InterfaceError(ConfigError):
    """A topic or service is missing, or a service refuses; the message names the topic or service and says what to check."""


@cache
def load() -> Any:
    """Return the required modules of ROS 2, by the names in `_MODULES`.

    Raises:
        MissingExtraError: rclpy or a package of messages is not installed.
        ConfigError: rclpy does not load, or an environment variable is wrong.
    """
    check_surroundings()  # with a wrong value the middleware would kill the process
    os.environ.update(isolation.DDS)
    os.environ.setdefault(PROFILES, str(DISCOVERY))
    modules = {}
    for name, module in _MODULES.items():
        try:
            modules[name] = import_module(module)
        except ModuleNotFoundError as error:
            raise MissingExtraError(
                f"{(error.name or module).partition('.')[0]} (ROS 2 Jazzy)",
                extra="ros2",
                purpose="simulator=ros2, auvbench serve and auvbench pilot",
            ) from error
        except (ImportError, OSError) as error:
            raise ConfigError(f"ROS 2 is installed but does not load: {first_line(error)}") from error
    return SimpleNamespace(**modules)


def surroundings() -> str:
    """Return the environment variables that decide which programs discover each other, as text for messages."""
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    return f"ROS_DOMAIN_ID={domain}, ROS_AUTOMATIC_DISCOVERY_RANGE={reach}"


def check_surroundings() -> None:
    """Reject environment variables whose values would make the middleware kill the process.

    Raises:
        ConfigError: ROS_DOMAIN_ID or RMW_IMPLEMENTATION is wrong.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not domain.isdecimal() or not 0 <= int(domain) <= LAST_DOMAIN:
        raise ConfigError(f"ROS_DOMAIN_ID={domain}: must be a whole number from 0 to {LAST_DOMAIN}")
    wanted = os.environ.get("RMW_IMPLEMENTATION")
    if wanted:
        implementations = _implementations()
        if wanted not in implementations:
            raise ConfigError(
                f"RMW_IMPLEMENTATION={wanted}: not installed; {closest(wanted, implementations)}"
            )


def _implementations() -> list[str]:
    """Return the names of the installed middlewares.

    Without a sourced ROS 2 (packages from an index) only Fast DDS is installed.
    """
    if not os.environ.get("AMENT_PREFIX_PATH"):
        return ["rmw_fastrtps_cpp"]
    return sorted(import_module("ament_index_python").get_resources("rmw_typesupport"))


@dataclass(slots=True)
class Answer:
    """Answer of a service; `value` is None until it arrives."""

    value: Any = None


class Session:
    """Nodes of one process, with the loop that serves them; for one thread only.

    Raises:
        ConfigError: the middleware does not start.
    """

    def __init__(self) -> None:
        self.ros = load()
        check_surroundings()
        self.context = self.ros.context.Context()
        try:
            # Signals stay with the caller; rclpy would take over SIGINT and SIGTERM.
            no = self.ros.signals.SignalHandlerOptions.NO
            self.ros.rclpy.init(args=[], context=self.context, signal_handler_options=no)
        except Exception as error:  # errors of the C library: RCLError, RuntimeError, ImportError of an rmw
            raise ConfigError(
                f"ROS 2 does not start: {first_line(error)} (check ROS_DOMAIN_ID, RMW_IMPLEMENTATION and the network;"
                f" here {surroundings()})"
            ) from error
        self._nodes: list[Any] = []
        self._set: Any = None
        self._entities: tuple[list[Any], list[Any], list[Any]] = ([], [], [])
        self._waiting: dict[tuple[int, int], Answer] = {}
        policies = self.ros.qos
        self.qos = policies.QoSProfile(
            depth=interface.DEPTH,
            history=policies.HistoryPolicy.KEEP_LAST,
            reliability=policies.ReliabilityPolicy.RELIABLE,
            durability=policies.DurabilityPolicy.VOLATILE,
        )

    def node(self, name: str, namespace: str = "", *, parameters: bool = False) -> Any:
        """Return a new node; with `parameters`, the node has parameter services.

        Raises:
            ConfigError: the middleware cannot create the node.
        """
        try:
            node = self.ros.node.Node(
                name,
                context=self.context,
                namespace=namespace,
                use_global_arguments=False,
                start_parameter_services=parameters,
                enable_rosout=False,  # auvbench does not use /rosout, where two clients would have the same logger name
            )
        except Exception as error:
            raise ConfigError(
                f"ROS 2 cannot make the node {name}: {first_line(error)} (check the network; here {surroundings()})"
            ) from error
        self._nodes.append(node)
        self._set = None
        return node

    def renew(self) -> None:
        """Rebuild the wait set, after adding or removing topics, services or clients."""
        self._set = None

    def spin_once(self, seconds: float) -> bool:
        """Wait at most `seconds` for messages, requests and answers, and handle them; return whether any came.

        Raises:
            ConfigError: the middleware failed.
        """
        if self._set is None:
            self._collect()
        subscriptions, services, clients = self._entities
        wait = self._set
        wait.clear_entities()
        for subscription in subscriptions:
            wait.add_subscription(subscription.handle)
        for service in services:
            wait.add_service(service.handle)
        for client in clients:
            wait.add_client(client.handle)
        wait.wait(max(0, int(seconds * 1e9)))
        came = False
        for kind, entities, take in (
            ("subscription", subscriptions, self._read),
            ("service", services, self._serve),
            ("client", clients, self._hear),
        ):
            ready = set(wait.get_ready_entities(kind))
            if ready:
                came = True
                for entity in entities:
                    if entity.handle.pointer in ready:
                        take(entity)
        return came

    def _collect(self) -> None:
        subscriptions = [one for node in self._nodes for one in node.subscriptions]
        services = [one for node in self._nodes for one in node.services]
        clients = [one for node in self._nodes for one in node.clients]
        self._entities = (subscriptions, services, clients)
        wait_set = self.ros.implementation.rclpy_implementation.WaitSet
        self._set = wait_set(len(subscriptions), 0, 0, len(clients), len(services), 0, self.context.handle)

    def _read(self, subscription: Any) -> None:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is not None:
            subscription.callback(taken[0])

    def _serve(self, service: Any) -> None:
        request, header = service.handle.service_take_request(service.srv_type.Request)
        if header is not None:
            response = service.callback(request, service.srv_type.Response())
            service.send_response(response, header)

    def _hear(self, client: Any) -> None:
        header, response = client.handle.take_response(client.srv_type.Response)
        if header is not None:
            number = header.request_id.sequence_number
            answer = self._waiting.pop((client.handle.pointer, number), None)
            if answer is not None:
                answer.value = response

    def ask(self, client: Any, request: Any) -> Answer:
        """Send a request and return its answer, which a later `spin_once` fills in."""
        answer = Answer()
        number = client.handle.send_request(request)
        self._waiting[(client.handle.pointer, number)] = answer
        return answer

    def until(self, condition: Callable[[], bool], seconds: float, turn: float = SLICE) -> bool:
        """Handle messages until the condition is true, for at most `seconds`; return whether it is true.

        The condition is checked after each message, and at least every `turn` s.
        """
        end = time.monotonic() + seconds
        while not condition():
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            self.spin_once(min(left, turn))
        return True

    def discovered(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Do the same as `until`, but check the condition every 10 ms, since a discovery does not end the wait for messages."""
        return self.until(condition, seconds, turn=0.01)

    def close(self) -> None:
        """Remove the nodes from the network."""
        if self.context.ok():
            for node in self._nodes:
                node.destroy_node()
            self._nodes.clear()
            self.ros.rclpy.shutdown(context=self.context)
