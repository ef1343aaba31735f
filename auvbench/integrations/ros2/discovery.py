"""Find a server and its vehicles, and check that each topic and service exists and has only one user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.errors import closest
from auvbench.integrations.ros2 import interface
from auvbench.integrations.ros2.middleware import InterfaceError, Session, surroundings

SETTLE = 0.4
"""time in s to wait for other publishers of a topic after its first publisher is discovered"""

FOUND = 3.0
"""time in s in which a running server is discovered, unless the machine is very busy"""

LEAVING = 5.0
"""time in s after which a client that has closed is no longer discovered"""

LEASE = 25.0
"""time in s after which a killed client is no longer discovered; Fast DDS keeps it for 20 s"""


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Publishers and clients of one vehicle."""

    names: interface.Names
    commands: Mapping[str, Any]  # publishers of commands, in the order of the actuators
    reset: Any  # client of the service reset
    parameters: Any  # client of the service set_parameters


def find_server(
    session: Session, node: Any, namespace: str, timeout: float
) -> tuple[list[interface.Names], dict[str, str]]:
    """Wait for a server; return the names of its vehicles and its read-only parameters.

    Args:
        session: the session of `node`.
        node: node that searches.
        namespace: namespace of the vehicle, or the common part of several vehicles' namespaces.
        timeout: time to wait, s.

    Raises:
        InterfaceError: no server was found, or the server has a different namespace.
    """
    count = node.count_publishers
    single, first = (interface.Names(name) for name in (namespace, f"{namespace}_1"))

    def there() -> bool:
        return bool(count(single.odometry) > 0 or count(first.odometry) > 0)

    if not session.discovered(there, timeout):
        raise InterfaceError(
            f"{explain_absence(node, namespace, 'simulator.namespace')} (waited {timeout:g} s)"
        )
    if count(single.odometry) > 0:
        return [single], _about(session, node, single, timeout)
    about = _about(session, node, first, timeout)
    try:
        n = int(about.get("vehicles", "1"))
    except ValueError:
        n = 1
    # The name of a server's only vehicle may also end with _1, so `n`, not the name, gives the number of vehicles.
    return [interface.Names(name) for name in interface.namespaces(namespace, max(n, 2))][:n], about


def check_endpoints(session: Session, node: Any, vehicles: Sequence[Endpoints], timeout: float) -> None:
    """Check that each topic and service of the vehicles exists, and that no other program uses it.

    Raises:
        InterfaceError: a topic or service is missing after `timeout` s, or another program uses it.
    """
    count, discovered = node.count_publishers, session.discovered
    for ends in vehicles:
        topic = ends.names.odometry
        if not discovered(lambda topic=topic: count(topic) > 0, timeout):  # type: ignore[misc]
            raise InterfaceError(f"{topic}: no publisher, though the server has {len(vehicles)} vehicles")
    discovered(lambda: False, SETTLE)
    for ends in vehicles:
        names = ends.names
        if count(names.odometry) > 1:
            raise InterfaceError(
                f"{names.odometry}: {count(names.odometry)} publishers: several servers in the namespace"
                f" {names.namespace}; stop all but one, or give each its own namespace"
            )
        for topic, publisher in ends.commands.items():
            if not discovered(lambda p=publisher: p.get_subscription_count() > 0, timeout):  # type: ignore[misc]
                raise InterfaceError(
                    f"{topic}: no subscriber, so the server's vehicle has other actuators (check vehicle= on both sides, and"
                    " ros2 topic list)"
                )
            # A client that has just left is still known for a moment.
            if not discovered(lambda topic=topic: count(topic) <= 1, LEAVING):  # type: ignore[misc]
                raise InterfaceError(
                    f"{topic}: another client commands this vehicle; stop it, or do one run at a time"
                    " (evaluate workers=1, train launcher.workers=1)"
                )
        for client, service in ((ends.reset, names.reset), (ends.parameters, names.parameters)):
            if not discovered(client.service_is_ready, timeout):
                raise InterfaceError(
                    f"{service}: no such service; an episode cannot begin without it (ros2 service list; auvbench serve"
                    " offers it)"
                )


def list_namespaces(node: Any) -> list[str]:
    """Return the namespaces in which odometry is published at present."""
    return sorted(
        topic.removesuffix("/odom").strip("/")
        for topic, _ in node.get_topic_names_and_types()
        if topic.endswith("/odom") and node.count_publishers(topic) > 0
    )


def explain_absence(node: Any, namespace: str, option: str) -> str:
    """Return why a namespace has no vehicle: the existing namespaces, or the settings that limit discovery.

    Args:
        node: node that has searched for a while.
        namespace: requested namespace.
        option: option that sets the namespace, for the message.
    """
    topic = interface.Names(namespace).odometry
    if others := list_namespaces(node):
        return f"{topic}: no publisher; {option} {namespace}: {closest(namespace, others)}"
    return f"{topic}: no publisher; is a server running (auvbench serve) in the same domain? Here {surroundings()}"


def _about(session: Session, node: Any, names: interface.Names, timeout: float) -> dict[str, str]:
    """Return the server's read-only parameters; empty if the server does not answer."""
    ros = session.ros
    client = node.create_client(ros.parameters.GetParameters, names.of(f"{interface.NODE}/get_parameters"))
    session.renew()
    # The service set_parameters, which every run needs, appears together with get_parameters, so this wait costs no time.
    if not session.discovered(client.service_is_ready, timeout):
        return {}
    request = ros.parameters.GetParameters.Request(names=["simulator", "vehicle", "auvbench", "vehicles"])
    answer = session.ask(client, request)
    if not session.until(lambda: answer.value is not None, timeout):
        return {}
    entries = zip(request.names, answer.value.values, strict=False)
    return {name: value.string_value for name, value in entries if value.string_value}
