"""A vehicle of ROS 2 for the campaign, in a process of its own: DDS does not survive a fork."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from auvbench.integrations.ros2 import interface
from auvbench.integrations.ros2.middleware import Session
from auvbench.integrations.ros2.pilot import Pilot
from tests import dds
from tests.soak.pilot_faults import Fault

PERIOD = 0.02
"""s between two poses"""


def lie_still(folder: Path) -> None:
    """Publish a pose, and write the commands that come into a file."""
    session = Session()
    ros, node = session.ros, session.node("tank")
    commands, pushed = [0.0] * 6, False

    def heard(a: int, value: float) -> None:
        nonlocal pushed
        commands[a] = value
        pushed |= value != 0.0
        staged = folder / ".commands"
        staged.write_text(json.dumps([pushed, commands]))
        os.replace(staged, folder / "commands")

    for a in range(6):
        topic = f"/bluerov2/cmd_thruster{a + 1}"
        node.create_subscription(ros.std.Float64, topic, lambda m, a=a: heard(a, m.data), session.qos)
    odometry = node.create_publisher(ros.nav.Odometry, "/bluerov2/odom", session.qos)
    session.renew()
    due = 0.0
    while True:
        if time.monotonic() >= due:
            due = time.monotonic() + PERIOD
            message = interface.odometry(ros, "bluerov2")
            interface.write_time(message.header.stamp, time.monotonic_ns())
            interface.write_pose(message.pose.pose, [0.0, 0.0, -10.0, 1.0, 0.0, 0.0, 0.0])
            odometry.publish(message)
        session.spin_once(PERIOD)


@contextlib.contextmanager
def over_ros(fault: Fault, folder: Path) -> Iterator[tuple[int, Callable[[], bool], Callable[[], bool]]]:
    """As `pilot.over_mavlink`."""
    from tests.soak.pilot import end, fly, forked

    def state() -> tuple[bool, list[float]]:
        try:
            pushed, commands = json.loads((folder / "commands").read_text())
        except FileNotFoundError:
            return False, []
        return pushed, commands

    with dds.domain():
        vehicle = forked(lambda: lie_still(folder))
        number = forked(lambda: fly(lambda steering: Pilot("bluerov2", steering, say=print), fault, folder))
        try:
            yield number, lambda: state()[0], lambda: not any(state()[1])
        finally:
            end(number)
            end(vehicle)
