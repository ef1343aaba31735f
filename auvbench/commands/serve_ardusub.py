"""`auvbench serve --face ardusub`: physics for an unmodified ArduSub."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.grammar import number, whole
from auvbench.errors import UserError

if TYPE_CHECKING:
    from auvbench.ardusub.physics import Physics

START = ("task.depth_low=-10000", "task.depth_high=0", "task.start=[0,0,0]")
"""ArduSub takes the depth at which it starts for the surface"""
FLAGS = ("port", "address", "battery", "thrust", "motors", "give_up")


def add_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags of this face."""
    group = parser.add_argument_group("--face ardusub")
    group.add_argument(
        "--port",
        type=whole(1, 65535),
        default=9002,
        help="UDP port of the first vehicle (default: 9002); the next: 10 more",
    )
    group.add_argument(
        "--address",
        default="127.0.0.1",
        help="to listen at (default: 127.0.0.1; 0.0.0.0: all of this machine)",
    )
    group.add_argument(
        "--battery",
        type=number(6.0, 24.0),
        default=16.0,
        metavar="V",
        help="voltage; thrust is in proportion (default: 16)",
    )
    group.add_argument(
        "--thrust", default="t200", help="force by PWM: t200, its measured curve, or sheet (default: t200)"
    )
    group.add_argument(
        "--motors",
        metavar="NAME,-NAME,...",
        help="thrusters in the order of ArduSub's motors, - reversed (default: by where they push)",
    )
    group.add_argument(
        "--give-up",
        type=number(0.001, 1e9),
        metavar="S",
        help="end after so many seconds without ArduSub (default: wait)",
    )


def serve(given: argparse.Namespace) -> int:
    """Serve until Ctrl-C.

    Raises:
        UserError: a flag's value is out of range, or what `Server` raises.
    """
    last = 65535 - 10 * (given.vehicles - 1)
    if given.port > last:
        raise UserError(f"--port {given.port}: must be at most {last} for {given.vehicles} vehicles")
    from auvbench.ardusub.server import Server
    from auvbench.runs import interruption

    with interruption.deferred() as request:
        vehicles = _vehicles(given)
        server = Server(
            vehicles,
            given.address,
            given.port,
            give_up=given.give_up,
        )
        try:
            server.compile()
            _print_interface(given, vehicles[0])
            server.run(lambda: request.signal is None)
        finally:
            server.close()
    print("auvbench: stopped", flush=True)
    return 0


def _vehicles(given: argparse.Namespace) -> list[Physics]:
    from auvbench.ardusub.physics import Physics
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config

    config = train_config(compose("train", [*START, *given.overrides], folder=Path("conf")))
    motors = given.motors.split(",") if given.motors else None
    return [
        Physics(config, motors=motors, thrust=given.thrust, voltage=given.battery)
        for _ in range(given.vehicles)
    ]


def _print_interface(given: argparse.Namespace, physics: Physics) -> None:
    """Print what is served, and how ArduSub finds it."""
    from auvbench.ardusub.server import started

    motors, name = physics.motors, physics.vehicle.name
    count = len(motors.order)
    frame = f"FRAME_CONFIG {motors.frame.config} ({motors.frame.name})" if motors.frame else "motors as given"
    last = "" if given.vehicles == 1 else f", ... {given.port + 10 * (given.vehicles - 1)}"
    print(
        f"serving {name} for ArduSub on UDP {given.address}:{given.port}{last}: {frame}, channels 1 to {count}"
    )
    print(f"waiting for ArduSub: ardusub {started(given.address, given.port)}; Ctrl-C stops", flush=True)
