"""`auvbench serve`: connect a simulator to ROS 2 topics and services, or to an unmodified ArduSub."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from auvbench import registry
from auvbench.errors import ConfigError, UserError, closest
from auvbench.grammar import Parser, number, whole

if TYPE_CHECKING:
    from auvbench.config.schema import TrainConfig
    from auvbench.integrations.ardusub.physics import Physics
    from auvbench.integrations.ros2.sensors import Sensed
    from auvbench.integrations.ros2.server import Server
    from auvbench.simulators.base import Simulator
    from auvbench.vehicles.vehicle_model import VehicleModel

BOTH = ("vehicle", "simulator", "task.start", "step.frequency", "disturbance")
KEYS = (*BOTH, "sensors", "navigation", "world", "seed")
ARDUSUB_KEYS = (*BOTH, "seed")
ROS2_FLAGS = ("namespace", "pace", "lockstep", "paused")
ARDUSUB_FLAGS = ("port", "address", "battery", "thrust", "motors", "give_up")
FACES = ("ros2", "ardusub")

ARDUSUB_START = ("task.depth_low=-10000", "task.depth_high=0", "task.start=[0,0,0]")
"""overrides that start the vehicle at the surface, since ArduSub takes its starting depth as the surface"""

_EPILOG = """examples:
  auvbench serve                                            the BlueROV2 on the embedded simulator, in real time
  auvbench serve simulator=gazebo vehicle=bluerov2_heavy    another vehicle, on Gazebo in this process
  auvbench serve --pace 10                                  ten times as fast; --pace max as fast as possible
  auvbench serve --lockstep --vehicles 4                    for simulator=ros2: each step waits for commands
  auvbench serve sensors=dvl_usbl navigation=ekf world=seabed   publishes sensors; odom is the filter's estimate
  auvbench serve --face ardusub vehicle=bluerov2_heavy disturbance=sea_state_2   for ArduSub's --model JSON

keys: vehicle=, simulator=, task.start=[x,y,z], step.frequency= (messages per second), disturbance= (vehicles with drawn
parameters may need a smaller physics step), seed=; with --face ros2 also sensors=, navigation=, world=.
Topics, services and parameters: docs/ros2.md; ArduSub: docs/ardusub.md.
"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench serve",
        description="Serve a simulator behind the ROS 2 interface of Centrale Nantes' BlueROV2, or to ArduSub, until Ctrl-C.",
        epilog=_EPILOG,
    )
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help=f"configuration: {', '.join(KEYS)}")
    parser.add_argument(
        "--face", default=FACES[0], help=f"interface: {' or '.join(FACES)} (default: {FACES[0]})"
    )
    parser.add_argument(
        "--vehicles",
        type=whole(1, 1000),
        default=1,
        help="number of vehicles in one world: NAME_1, NAME_2, ... (default: 1)",
    )
    ros2 = parser.add_argument_group("--face ros2")
    ros2.add_argument("--namespace", help="namespace of the topics (default: the vehicle's name)")
    ros2.add_argument(
        "--pace", type=_pace, default=1.0, help="simulated seconds per second, or max (default: 1)"
    )
    ros2.add_argument(
        "--lockstep", action="store_true", help="each step waits for a command to every actuator"
    )
    ros2.add_argument("--paused", action="store_true", help="begin with the world paused")
    _add_ardusub_flags(parser)
    return parser


def _pace(text: str) -> float:
    return 0.0 if text == "max" else number(1e-6, 1e6)(text)


def main(arguments: Sequence[str]) -> int:
    given = _given(arguments)
    if given.face == "ardusub":
        return _serve_ardusub(given)

    from auvbench.integrations.ros2 import middleware
    from auvbench.runs import interruption

    middleware.load()  # first, so that a missing ROS 2 is reported before anything is compiled
    server = _server(given)
    try:
        with interruption.deferred() as request:
            server.check_alone(1.0)
            _print_interface(server)
            server.run(lambda: request.signal is None)
    finally:
        server.close()
    print("auvbench: stopped", flush=True)
    return 0


def _given(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the options, make the checks that both interfaces share, and return the options."""
    reader = parser()
    given = reader.read(arguments, overrides=True)
    if given.face not in FACES:
        raise UserError(f"--face {given.face}: unknown; {closest(given.face, FACES)}")
    keys = ARDUSUB_KEYS if given.face == "ardusub" else KEYS
    for word in given.overrides:
        key = word.partition("=")[0]
        if "=" not in word:
            raise ConfigError(
                f"serve: {word}: unexpected argument; serve takes KEY=VALUE and flags (auvbench serve --help)"
            )
        if not any(key == known or key.startswith(f"{known}.") for known in keys):
            raise ConfigError(f"{word}: serve has no such key; {closest(key, keys)}")
    for name, face in {
        **dict.fromkeys(ROS2_FLAGS, "ros2"),
        **dict.fromkeys(ARDUSUB_FLAGS, "ardusub"),
    }.items():
        if face != given.face and getattr(given, name) != reader.get_default(name):
            raise UserError(f"--{name.replace('_', '-')}: needs --face {face}")
    return given


def _server(given: argparse.Namespace) -> Server:
    from auvbench import __version__
    from auvbench.config import navigation, simulators
    from auvbench.config.compose import compose
    from auvbench.config.disturbances import needs
    from auvbench.config.validate import train_config
    from auvbench.envs.simulator_factory import make_simulator
    from auvbench.integrations.ros2 import interface, spec
    from auvbench.integrations.ros2.server import Server, Simulated
    from auvbench.vehicles import sheet
    from auvbench.vehicles.physical import PhysicalCommands

    # The server publishes values without noise. A served vehicle may come to the surface; a vehicle in a task may not.
    config = train_config(compose("train", ["noise=none", "task.depth_high=0", *given.overrides]))
    if simulators.is_served(config.simulator):
        able = [f"simulator={name}" for name, spec in registry.SIMULATORS.items() if not spec.served]
        raise ConfigError(f"simulator={config.simulator.name}: cannot be served; use {' or '.join(able)}")
    if config.world.solid and not navigation.is_estimated(config):
        raise ConfigError(
            f"world={config.world.name}: serve simulates no contacts, and no sensor sees the world; use world=open,"
            " or navigation=ekf with sensors"
        )
    for need in needs(config.disturbance):
        if not need.able(spec.simulator.capabilities):
            raise ConfigError(
                f"{need.key}: serve cannot simulate {need.what}; use simulator=fossen without ROS 2"
            )
    vehicle = sheet.load(config.vehicle)
    physical = PhysicalCommands(vehicle)
    namespaces = interface.namespaces(given.namespace or vehicle.name, given.vehicles)
    simulator = make_simulator(config.simulator, vehicle, given.vehicles, config.disturbance, physical.model)
    served: Simulated = simulator
    if navigation.is_estimated(config):
        served = _sensed(config, physical.model, simulator)
    server = Server(
        served,
        physical,
        vehicle.actuators,
        physical.neutral,
        namespaces,
        start=[*config.task.start, 1.0, 0.0, 0.0, 0.0],
        step_duration=1.0 / config.step.frequency,
        pace=given.pace,
        lockstep=given.lockstep,
        about={
            "simulator": config.simulator.name,
            "vehicle": vehicle.name,
            "auvbench": __version__,
            "vehicles": str(given.vehicles),
        },
    )
    server.set_paused(given.paused)
    return server


def _sensed(config: TrainConfig, vehicle: VehicleModel, simulator: Simulator) -> Sensed:
    """Return a simulator with the sensors and the estimator of a configuration; `vehicle` is the simulator's model."""
    from functools import partial

    from auvbench.integrations.ros2.sensors import Sensed
    from auvbench.tasks import base as tasks
    from auvbench.tasks.navigation.estimator import Navigation
    from auvbench.tasks.navigation.readings import readings

    task = tasks.make(config, vehicle, simulator.n, config.seed)
    own = Navigation(config, vehicle, task)
    return Sensed(simulator, own, task.reset, partial(readings, own), config.sensors.names())


def _print_interface(server: Server) -> None:
    from auvbench.integrations.ros2 import interface
    from auvbench.integrations.ros2.middleware import surroundings

    names = interface.Names(server.namespaces[0])
    commands = [names.command(name) for name in server.actuators]
    last = f" ... {commands[-1]}" if len(commands) > 1 else ""
    others = "" if len(server.namespaces) == 1 else f" and {', '.join(server.namespaces[1:])}"
    pace = "as fast as possible" if server.settings.pace == 0.0 else f"{server.settings.pace:g} x real time"
    print(f"serving {names.namespace}{others}: {'lock-step' if server.lockstep else pace}, {surroundings()}")
    print(f"  subscribes {commands[0]}{last} (N), {interface.CURRENT} (m/s)")
    print(f"  publishes  {names.odometry}, {names.pose}, {interface.CLOCK}")
    if server.sensed is not None:
        print(f"  sensors    {', '.join(names.of(name) for name in server.sensed.names)}")
    print(f"  services   {names.reset}, {names.pause}, {names.step}, {names.lockstep}", flush=True)


def _add_ardusub_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("--face ardusub")
    group.add_argument(
        "--port",
        type=whole(1, 65535),
        default=9002,
        help="UDP port of the first vehicle (default: 9002); the ports of consecutive vehicles differ by 10",
    )
    group.add_argument(
        "--address",
        default="127.0.0.1",
        help="address to listen at (default: 127.0.0.1; 0.0.0.0: all addresses of this machine)",
    )
    group.add_argument(
        "--battery",
        type=number(6.0, 24.0),
        default=16.0,
        metavar="V",
        help="supply voltage, to which thrust is proportional (default: 16)",
    )
    group.add_argument(
        "--thrust",
        default="t200",
        help="force for a PWM: t200 (the T200's measured curve) or sheet (default: t200)",
    )
    group.add_argument(
        "--motors",
        metavar="NAME,-NAME,...",
        help="thrusters in the order of ArduSub's motors, - before a reversed thruster (default: match a frame by direction)",
    )
    group.add_argument(
        "--give-up",
        type=number(0.001, 1e9),
        metavar="S",
        help="exit after this many seconds without a packet from ArduSub (default: wait forever)",
    )


def _serve_ardusub(given: argparse.Namespace) -> int:
    """Serve an ArduSub until Ctrl-C.

    Raises:
        UserError: the value of a flag is out of range, or `Server` rejects it.
    """
    last = 65535 - 10 * (given.vehicles - 1)
    if given.port > last:
        raise UserError(f"--port {given.port}: must be at most {last} for {given.vehicles} vehicles")
    from auvbench.integrations.ardusub.server import Server
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
            _print_address(given, vehicles[0])
            server.run(lambda: request.signal is None)
        finally:
            server.close()
    print("auvbench: stopped", flush=True)
    return 0


def _vehicles(given: argparse.Namespace) -> list[Physics]:
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config
    from auvbench.integrations.ardusub.physics import Physics

    config = train_config(compose("train", [*ARDUSUB_START, *given.overrides]))
    motors = given.motors.split(",") if given.motors else None
    return [
        Physics(config, motors=motors, thrust=given.thrust, voltage=given.battery)
        for _ in range(given.vehicles)
    ]


def _print_address(given: argparse.Namespace, physics: Physics) -> None:
    """Print the vehicle and the frame that are served, and the address for ArduSub."""
    from auvbench.integrations.ardusub.server import started

    motors, name = physics.motors, physics.vehicle.name
    count = len(motors.order)
    frame = f"FRAME_CONFIG {motors.frame.config} ({motors.frame.name})" if motors.frame else "motors as given"
    last = "" if given.vehicles == 1 else f", ... {given.port + 10 * (given.vehicles - 1)}"
    print(
        f"serving {name} for ArduSub on UDP {given.address}:{given.port}{last}: {frame}, channels 1 to {count}"
    )
    print(f"waiting for ArduSub: ardusub {started(given.address, given.port)}; Ctrl-C stops", flush=True)
