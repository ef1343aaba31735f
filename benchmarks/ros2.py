"""Measure agent steps over ROS 2 in lock-step, with `auvbench serve` and this process on one core."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import psutil

from auvbench.errors import ConfigError
from auvbench.integrations.ros2.spec import Ros2
from auvbench.vehicles import sheet
from benchmarks.timing import best

Row = tuple[str, str, str, str]


def ros2() -> Iterator[Row]:
    """Measure round trips: six commands to each vehicle, its odometry back."""
    from auvbench.integrations.ros2 import middleware

    try:
        middleware.load()
    except ConfigError as error:
        yield ("agent steps over ROS 2", "-", "steps/s", str(error))
        return
    # A DDS domain that no other process uses, only on this machine.
    os.environ |= {
        "ROS_DOMAIN_ID": str(random.SystemRandom().randint(1, 100)),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        for n in (1, 8):
            yield from _served(n)
    finally:
        os.sched_setaffinity(0, before)


def _processor_time(simulator: Any, action: Any, server: psutil.Process) -> float:
    """Return the processor time of a step in s, of both processes. Other processes change it less than the wall time."""
    steps = 400

    def spent() -> float:
        times = server.cpu_times()
        return time.process_time() + float(times.user + times.system)

    begun = spent()
    for _ in range(steps):
        simulator.step(action, 0.1)
    return (spent() - begun) / steps


def _served(n: int) -> Iterator[Row]:
    from auvbench.integrations.ros2 import simulator as client

    server = subprocess.Popen(
        [sys.executable, "-m", "auvbench", "serve", "--lockstep", "--vehicles", str(n)],
        stdout=subprocess.DEVNULL,
    )
    try:
        vehicle = sheet.load("bluerov2")
        simulator = client.Ros2Simulator(
            vehicle, n, Ros2(name="ros2", namespace=None, clock="lockstep", timeout=60.0)
        )
        pose = np.tile([0.0, 0.0, -20.0, 1.0, 0.0, 0.0, 0.0], (n, 1))
        simulator.reset(np.arange(n), pose, np.zeros((n, 6)))
        action = np.random.default_rng(0).uniform(-0.5, 0.5, (n, 6))
        simulator.step(action, 0.1)
        wall = best(lambda: simulator.step(action, 0.1), seconds=3.0)
        spent = min(_processor_time(simulator, action, psutil.Process(server.pid)) for _ in range(5))
        yield (
            f"agent steps over ROS 2 in lock-step, {n} vehicle{'s' if n > 1 else ''}",
            f"{n / spent:,.0f}",
            "steps/s",
            f"per second of processor time of server and client on one core; {1e3 * wall:.2f} ms a round trip by the clock",
        )
        client.leave()
    finally:
        server.terminate()
        server.wait(30)
