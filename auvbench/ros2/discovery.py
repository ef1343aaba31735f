"""Which vehicles a server has, and whether everything that they need is on the network, and once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.errors import closest
from auvbench.ros2 import interface
from auvbench.ros2.middleware import InterfaceError, Session, surroundings

SETTLE = 0.4
"""s that are given to what is discovered after the first of its kind"""

LEAVING = 2.0
"""s that are given to those who were here before"""


@dataclass(frozen=True, slots=True)
class Ends:
    """This end of all that goes to one vehicle."""

    names: interface.Names
    commands: Mapping[str, Any]  # publishers by topic, in the order of the actuators
    reset: Any  # a client of the service
    parameters: Any  # likewise


def find(
    session: Session, node: Any, namespace: str, timeout: float
) -> tuple[list[interface.Names], dict[str, str]]:
    """Waits until there is a server; its vehicles, and what it says of itself.

    Args:
        session: the node's.
        node: asks.
        namespace: of the vehicle, or what its vehicles' namespaces begin with.
        timeout: s.

    Raises:
        InterfaceError: nobody is there, or in another namespace.
    """
    count = node.count_publishers
    one, first = (interface.Names(name) for name in (namespace, f"{namespace}_1"))

    def there() -> bool:
        return bool(count(one.odometry) > 0 or count(first.odometry) > 0)

    if not session.seen(there, timeout):
        raise InterfaceError(f"{one.odometry}: nobody publishes it{_elsewhere(node, namespace, timeout)}")
    if count(one.odometry) > 0:
        return [one], _about(session, node, one, timeout)
    about = _about(session, node, first, timeout)
    try:
        n = int(about.get("vehicles", "1"))
    except ValueError:
        n = 1
    # A server of one vehicle whose name ends with _1 has no others.
    return [interface.Names(name) for name in interface.namespaces(namespace, max(n, 2))][:n], about


def check(session: Session, node: Any, vehicles: Sequence[Ends], timeout: float) -> None:
    """Whether everything that the vehicles need is there, and once.

    Raises:
        InterfaceError: it is not, within `timeout` s.
    """
    count, seen = node.count_publishers, session.seen
    for ends in vehicles:
        topic = ends.names.odometry
        if not seen(lambda topic=topic: count(topic) > 0, timeout):  # type: ignore[misc]
            raise InterfaceError(f"{topic}: nobody publishes it, of {len(vehicles)} vehicles of the server")
    seen(lambda: False, SETTLE)
    for ends in vehicles:
        names = ends.names
        if count(names.odometry) > 1:
            raise InterfaceError(
                f"{names.odometry}: {count(names.odometry)} publish it: several servers in the namespace"
                f" {names.namespace}; stop all but one, or give them namespaces of their own"
            )
        for topic, publisher in ends.commands.items():
            if not seen(lambda p=publisher: p.get_subscription_count() > 0, timeout):  # type: ignore[misc]
                raise InterfaceError(
                    f"{topic}: nobody listens, so that the server's vehicle is another one than this vehicle"
                    " (check vehicle= on both sides, and ros2 topic list)"
                )
            # Whoever has just left is still known for a moment.
            if not seen(lambda topic=topic: count(topic) <= 1, LEAVING):  # type: ignore[misc]
                raise InterfaceError(
                    f"{topic}: somebody else commands this vehicle; stop it, or let runs go one after the other"
                    " (workers=1 of evaluate, launcher.workers=1 of train)"
                )
        for client, service in ((ends.reset, names.reset), (ends.parameters, names.parameters)):
            if not seen(client.service_is_ready, timeout):
                raise InterfaceError(
                    f"{service}: no such service, without which no episode can begin at its start"
                    " (ros2 service list; auvbench serve offers it)"
                )


def _elsewhere(node: Any, namespace: str, timeout: float) -> str:
    """Where vehicles are instead, and what decides whether they are seen."""
    others = [
        topic.removesuffix("/odom").strip("/")
        for topic, _ in node.get_topic_names_and_types()
        if topic.endswith("/odom") and node.count_publishers(topic) > 0
    ]
    if others:
        return f", but there are other namespaces; simulator.namespace: {closest(namespace, others)}"
    return (
        f" within {timeout:g} s: is a server running (auvbench serve), in the same domain?"
        f" Here {surroundings()}"
    )


def _about(session: Session, node: Any, names: interface.Names, timeout: float) -> dict[str, str]:
    """What the server says of itself, if it says anything."""
    ros = session.ros
    client = node.create_client(ros.parameters.GetParameters, names.of(f"{interface.NODE}/get_parameters"))
    session.renew()
    if not session.seen(client.service_is_ready, 3 * SETTLE):
        return {}
    request = ros.parameters.GetParameters.Request(names=["simulator", "vehicle", "auvbench", "vehicles"])
    answer = session.ask(client, request)
    if not session.until(lambda: answer.value is not None, timeout):
        return {}
    found = zip(request.names, answer.value.values, strict=False)
    return {name: value.string_value for name, value in found if value.string_value}
