"""`auvbench pilot`: steer a vehicle over ROS 2 or MAVLink with an exported policy or a classical controller.

The command can run on the vehicle's own computer: it needs NumPy, ONNX Runtime and rclpy or pymavlink, but no compiler,
torch or Hydra (a test checks this).
"""

from __future__ import annotations

import argparse
import math
import os
import select
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from auvbench import registry
from auvbench.errors import ConfigError, UserError, closest
from auvbench.grammar import Parser, number
from auvbench.pilot import excite
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.untrusted.text import short
from auvbench.vehicles import signals
from auvbench.vehicles.inspect import AXES

if TYPE_CHECKING:
    from auvbench.config import tasks
    from auvbench.observation import ObservationSpec
    from auvbench.pilot.loop import Pilot
    from auvbench.pilot.steering import Filter, Limits, Steering
    from auvbench.policies.exported import Card
    from auvbench.vehicles.vehicle_model import VehicleModel

ANSWER = 1
"""longest processor time in s for one action of the policy; the pilot disarms if an action takes longer, or takes
more than five times as much wall time
"""

_EPILOG = """examples:
  auvbench pilot policy.onnx --goal 5 3 -12 --record missions/first
  auvbench pilot pid --depth -30 -2
  auvbench pilot lqr --task station_keeping --goal 0 0 -10 --yaw 90
  ros2 service call /bluerov2_2026/pilot/arm std_srvs/srv/SetBool '{data: true}'
  auvbench pilot policy.onnx --mavlink udp:127.0.0.1:14550 --goal 5 3 -12 --arm
  auvbench pilot policy.onnx --goal 5 3 -12 --filter cbf --tank 20 12 15
  auvbench pilot excite --axis yaw heave --mavlink udp:127.0.0.1:14550 --depth -8 -1 --arm

The pilot starts disarmed. It steers to the waypoint on /goal_pose, or keeps station at that pose. It commands zero thrust while the pose is
too old or outside the depth limits, without a waypoint, after stop, on any error and on Ctrl-C; with --mavlink also on Enter. If the pilot dies
or sends nothing for 1 s (or --pose-timeout, if longer), its supervisor commands zero thrust. Topics and rules: docs/ros2.md; ArduSub:
docs/mavlink.md.

excite pushes the vehicle back and forth along --axis without a controller, from the place of arming. auvbench identify reads a log of this
manoeuvre (docs/identify-your-vehicle.md). The manoeuvre needs room: --reach, the depth limits and Ctrl-C end it early.
"""


def parser() -> Parser:
    parser = Parser(
        prog="auvbench pilot",
        description="Steer a vehicle over ROS 2 or MAVLink with an exported policy or a classical controller, until Ctrl-C.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "controller",
        metavar="POLICY.onnx",
        help=f"an exported policy, or one of {', '.join((*controllers(), excite.NAME))}",
    )
    parser.add_argument("--vehicle", help="vehicle sheet (default: the policy's; else bluerov2_2026)")
    parser.add_argument("--namespace", help="namespace of the topics (default: the vehicle's name)")
    parser.add_argument(
        "--task", help=f"task: {' or '.join(_tasks())} (default: the policy's; else waypoint)"
    )
    parser.add_argument(
        "--frequency", type=number(0.001, 1000), help="rate of actions in Hz (default: the policy's; else 10)"
    )
    parser.add_argument(
        "--goal",
        type=number(-1e6, 1e6),
        nargs=3,
        metavar=("X", "Y", "Z"),
        help="first waypoint or station in m: x east, y north, z up",
    )
    parser.add_argument(
        "--yaw",
        type=number(-360, 360),
        help="heading to hold at the station --goal, in degrees (default: 0, east)",
    )
    parser.add_argument(
        "--depth",
        type=number(-1e4, 1.0),  # The estimated height of a vehicle at the surface may be slightly above 0.
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="lowest and highest z in m (default: the policy's; else -60 -1)",
    )
    parser.add_argument(
        "--goal-radius",
        type=number(0.001, 1000),
        help="distance in m at which a waypoint is reached (default: the policy's; else 3)",
    )
    parser.add_argument(
        "--pose-timeout",
        type=number(0.001, 60),
        default=0.5,
        help="largest age in s of the pose; if the pose is older, the pilot commands zero thrust (default: 0.5)",
    )
    parser.add_argument(
        "--axis",
        nargs="+",
        choices=AXES,
        metavar="AXIS",
        help=f"with excite: one or more axes to push along, one after another: {', '.join(AXES)}",
    )
    parser.add_argument(
        "--amplitude",
        type=number(0.1, 1.0),
        help=f"with excite: force, as a fraction of the largest force along the axis (default: {excite.AMPLITUDE:g})",
    )
    parser.add_argument(
        "--seconds",
        type=number(1.0, 3600.0),
        help=f"with excite: duration for each axis in s (default: {excite.SECONDS:g})",
    )
    parser.add_argument(
        "--reach",
        type=number(0.1, 1000.0),
        help=f"with excite: largest distance in m from the place of arming; the pilot disarms beyond it (default: {excite.REACH:g})",
    )
    parser.add_argument(
        "--filter", choices=("cbf",), help="safety filter: changes commands that would lead to a contact"
    )
    parser.add_argument(
        "--tank",
        type=number(0.1, 1e4),
        nargs=3,
        metavar=("LENGTH", "WIDTH", "DEPTH"),
        help="with --filter: keep off the walls and the bottom of a tank of this size in m, with its centre at x = y = 0",
    )
    parser.add_argument(
        "--bottom",
        metavar="FILE",
        help="with --filter: a .npz or .csv file with the bottom's x_m, y_m and z_m or depth_m",
    )
    parser.add_argument("--record", type=Path, metavar="DIR", help="record missions in a new folder")
    parser.add_argument(
        "--sim-time",
        action="store_true",
        help="step by /clock, or ArduSub's time, instead of this machine's clock",
    )
    parser.add_argument(
        "--mavlink",
        metavar="ADDRESS",
        help="steer ArduSub over MAVLink instead of ROS 2: udp:HOST:PORT to listen, tcp:HOST:PORT to connect",
    )
    parser.add_argument(
        "--arm",
        action="store_true",
        help="with --mavlink: arm at once (default: wait until the vehicle is armed)",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    given = parser().read(arguments)
    _check(given)

    from auvbench.pilot.mission import Logbook
    from auvbench.runs import interruption

    setup = _setup(given)
    if given.filter is not None:
        setup.filter = protection(given, setup)
    if given.goal is not None and not setup.limits.within(given.goal[2]):
        raise UserError(f"--goal: z={given.goal[2]:g} must be within {setup.limits.depths}; see --depth")
    if (
        given.goal is not None
        and setup.filter is not None
        and (why := setup.filter.refusal(np.array(given.goal)))
    ):
        x, y, z = given.goal
        raise UserError(f"--goal {x:g} {y:g} {z:g}: {why}")
    options = {"sim_time": given.sim_time, "say": lambda text: print(f"pilot: {text}", flush=True)}
    # Until the vehicle is found, Ctrl-C exits at once.
    pilot, begin, stopped = (_over_ros if given.mavlink is None else _over_mavlink)(given, setup, options)
    with interruption.deferred() as request:
        try:
            if given.record is not None:
                setup.logbook = Logbook(given.record, _about(setup))
            if given.goal is not None:
                pilot.steer_to(given.goal, yaw=math.radians(given.yaw or 0.0))
            begin()
            pilot.run(lambda: request.signal is None and not pilot.finished and not stopped())
        finally:
            pilot.close("the pilot was ended")
    if given.record is not None:
        print(f"missions: {given.record} (auvbench replay {given.record})")
    return 0


def _check(given: argparse.Namespace) -> None:
    """Reject combinations of flags that have no meaning."""
    if given.depth is not None and not given.depth[0] < given.depth[1]:
        low, high = given.depth
        raise UserError(f"--depth {low:g} {high:g}: LOW must be below HIGH (z, up)")
    if given.mavlink is None and given.arm:
        raise UserError("--arm: needs --mavlink; over ROS 2 arm with the service pilot/arm")
    if given.mavlink is not None and given.namespace is not None:
        raise UserError(f"--namespace {given.namespace}: is for ROS 2, not for --mavlink; leave it out")
    exciting = given.controller == excite.NAME
    if not exciting and not given.controller.endswith(".onnx") and given.controller not in controllers():
        raise _unknown(given.controller)
    own = ("axis", "amplitude", "seconds", "reach")
    for flag in own if not exciting else ("goal", "yaw", "task", "goal_radius"):
        if getattr(given, flag) is not None:
            raise UserError(
                f"--{flag.replace('_', '-')}: is {'not ' if exciting else ''}for {excite.NAME}; leave it out"
            )
    for flag in ("tank", "bottom"):
        if getattr(given, flag) is not None and given.filter is None:
            raise UserError(f"--{flag}: needs --filter cbf, which keeps the vehicle away from it")
    if given.tank is not None and given.bottom is not None:
        raise UserError("--bottom: a tank has a bottom; leave out --tank or --bottom")
    if given.yaw is not None and given.goal is None:
        raise UserError(f"--yaw {given.yaw:g}: needs --goal X Y Z, because it is the heading at that station")
    if exciting and given.frequency is not None and given.frequency < excite.SLOWEST:
        raise UserError(
            f"--frequency {given.frequency:g}: must be at least {excite.SLOWEST:g} Hz for {excite.NAME}, whose shortest push"
            f" lasts {signals.SHORT:g} s"
        )
    if exciting and given.axis is None:
        raise UserError(f"{excite.NAME}: needs --axis; valid: {', '.join(AXES)}")
    if given.mavlink is not None and given.goal is None and not exciting:
        raise UserError("--mavlink: needs --goal X Y Z, the waypoint or station")


Opened = tuple["Pilot", Callable[[], object], Callable[[], bool]]
"""the pilot, a function to call before the pilot runs, and a function that returns whether the pilot must stop"""


def _over_ros(given: argparse.Namespace, setup: Steering, options: dict[str, Any]) -> Opened:
    from auvbench.integrations.ros2 import discovery
    from auvbench.integrations.ros2.pilot import Pilot

    pilot = Pilot(given.namespace or setup.vehicle.name, setup, **options)

    def begin() -> None:
        names = pilot.names
        print(
            f"{setup.name} steers {names.namespace} at {setup.frequency:g} Hz; arm it: "
            f"ros2 service call {names.of('pilot/arm')} std_srvs/srv/SetBool '{{data: true}}'",
            flush=True,
        )
        pilot.wait_for_odometry(discovery.FOUND)

    return pilot, begin, lambda: False


def _over_mavlink(given: argparse.Namespace, setup: Steering, options: dict[str, Any]) -> Opened:
    from auvbench.integrations.mavlink.pilot import Pilot

    pilot = Pilot(given.mavlink, setup, **options)

    def begin() -> None:
        print(pilot.about())
        when = "" if given.arm else f" {pilot.cue}"
        print(
            f"{setup.name} steers {pilot.vehicle.who} at {setup.frequency:g} Hz{when}; Enter or Ctrl-C disarms",
            flush=True,
        )
        if given.arm and (why := pilot.arm()):
            raise UserError(f"--arm: {why}")

    return pilot, begin, enter


def _setup(given: argparse.Namespace) -> Steering:
    from auvbench.pilot.steering import Steering
    from auvbench.vehicles import sheet

    word = str(given.controller)
    if word == excite.NAME:
        return _excitation(given)
    if word.endswith(".onnx"):
        from auvbench.policies import exported

        policy = exported.load(word, seconds=ANSWER)
        card = policy.card
        if card is None:
            raise UserError(
                f"{word}: its card is missing; put it next to the file, or write both with auvbench export"
            )
        vehicle = sheet.load(given.vehicle or card.vehicle.name)
        if card.actuators != vehicle.actuators:
            raise UserError(
                f"{word}: commands {', '.join(card.actuators)}, but {vehicle.name} has {', '.join(vehicle.actuators)};"
                " choose another sheet with --vehicle"
            )
        task, spec = task_of_policy(word, card, given.task, vehicle)
        frequency = given.frequency or card.frequency_hz
        name = card.name
        controller: Any = SimpleNamespace(
            reset=lambda episodes: None, act=policy.act
        )  # a policy in a file has no state
    else:
        from auvbench.tasks.observation_spec import observation_spec

        vehicle = sheet.load(given.vehicle or sheet.DEFAULT)
        frequency = given.frequency or 10.0
        task = task_of(given.task or DEFAULT_TASK, "--task")
        name, spec = word, observation_spec(task, vehicle.actuators)
        controller = classical(word, vehicle, frequency, task)
    radius = getattr(task, "goal_radius", getattr(task, "tolerance", 0.0))
    limits = _limits(
        given,
        task,
        goal_radius=float(given.goal_radius or radius),
        max_steps=int(task.max_steps),
        holds=registry.TASKS[task.name].holds,
    )
    return Steering(controller, vehicle, frequency, spec, limits, name)


def _excitation(given: argparse.Namespace) -> Steering:
    """Return the controller and limits for one identification manoeuvre, which starts where the vehicle is armed."""
    from auvbench.pilot.steering import Steering
    from auvbench.tasks.observation_spec import observation_spec
    from auvbench.vehicles import sheet

    vehicle = sheet.load(given.vehicle or sheet.DEFAULT)
    frequency = given.frequency or excite.FREQUENCY
    controller = excite.Excite(
        vehicle,
        given.axis,
        given.amplitude or excite.AMPLITUDE,
        given.seconds or excite.SECONDS,
        frequency,
    )
    task = task_of(DEFAULT_TASK, "--task")
    limits = _limits(
        given, task, goal_radius=0.0, max_steps=controller.steps, reach=given.reach or excite.REACH
    )
    spec = observation_spec(task, vehicle.actuators)
    return Steering(controller, vehicle, frequency, spec, limits, excite.NAME, once=True)


def protection(given: argparse.Namespace, setup: Steering) -> Filter:
    """Return the safety filter that --filter, --tank and --bottom describe.

    Raises:
        UserError: a package that only the filter needs is not installed, or the bottom cannot be read.
        ConfigError: the vehicle cannot brake in every direction.
    """
    try:
        from auvbench.config import worlds
        from auvbench.config.filters import Barrier
        from auvbench.tasks.filters.flight import Protection
        from auvbench.worlds import grids
    except ModuleNotFoundError as error:
        raise UserError(f"--filter {given.filter}: needs {error.name}: pip install {error.name}") from error
    world: Any = None
    if given.tank is not None:
        length, width, depth = given.tank
        world = worlds.Tank(**defaults("world", "tank") | {"length": length, "width": width, "depth": depth})
    elif given.bottom is not None:
        try:
            grids.read(given.bottom, "")
        except ValueError as error:
            raise UserError(f"--bottom {given.bottom}: {error}") from error
        # x and y in the file have the same origin and axes as the vehicle's poses.
        file = worlds.BottomFile(file=given.bottom, sha256="", origin=[0.0, 0.0])
        world = worlds.Bottom(**defaults("world", "bottom") | {"bottom": file})
    limits = setup.limits
    settings = Barrier(**defaults("filter", given.filter))
    if limits.depth_high - limits.depth_low <= 2.0 * settings.margin:
        raise UserError(
            f"--filter {given.filter}: the depth limits {limits.depths} must be more than {2.0 * settings.margin:g} m apart; see --depth"
        )
    return Protection(settings, setup.vehicle, setup.frequency, (limits.depth_low, limits.depth_high), world)


def _limits(given: argparse.Namespace, task: tasks.Task, **options: Any) -> Limits:
    from auvbench.pilot.steering import Limits

    low, high = given.depth or (task.depth_low, task.depth_high)
    return Limits(
        depth_low=float(low),
        depth_high=float(high),
        pose_timeout=given.pose_timeout,
        lost_after=max(5.0, 2.0 * given.pose_timeout),
        patience=max(1.0, given.pose_timeout),
        **options,
    )


def controllers() -> list[str]:
    """Return the names of the controllers that need neither compiler nor torch."""
    return [name for name, spec in registry.AGENTS.items() if spec.pilots]


def classical(name: str, vehicle: VehicleModel, frequency: float, task: tasks.Task | None = None) -> Any:
    """Return a classical controller for the observations of a task, with the gains of its configuration file.

    The default task is waypoint.

    Raises:
        ConfigError: the name is unknown, or the controller cannot steer this vehicle.
    """
    if name not in controllers():
        raise _unknown(name)
    spec = registry.AGENTS[name]
    gains = spec.schema(**defaults("algo", name))
    step = SimpleNamespace(frequency=frequency)
    config = SimpleNamespace(algo=gains, step=step, task=task or task_of(DEFAULT_TASK, "--task"))
    return registry.resolve(spec.code)(config, vehicle)


def _unknown(name: str) -> ConfigError:
    known = (*controllers(), excite.NAME)
    return ConfigError(f"{name}: is neither a POLICY.onnx nor a controller; {closest(name, known)}")


def _about(setup: Steering) -> dict[str, Any]:
    limits = setup.limits
    return {
        "controller": setup.name,
        **({} if setup.filter is None else {"filter": setup.filter.name}),
        "vehicle": setup.vehicle.name,
        "actuators": list(setup.vehicle.actuators),
        "frequency_hz": setup.frequency,
        "goal_radius_m": limits.goal_radius,
        "depth_low_m": limits.depth_low,
        "depth_high_m": limits.depth_high,
        "max_steps": limits.max_steps if math.isfinite(limits.max_steps) else None,
    }


def _tasks() -> tuple[str, ...]:
    """Return the tasks whose reference is a pose at rest, the kind that `/goal_pose` gives."""
    return tuple(name for name in registry.TASKS.own if registry.TASKS[name].at_rest)


def task_of(name: str, where: str) -> tasks.Task:
    """Return a task with the values of its configuration file.

    Raises:
        ConfigError: the task's reference is not a pose at rest.
    """
    from auvbench.config import tasks

    if name not in _tasks():
        raise ConfigError(
            f"{where} {short(name, 40)}: a pilot cannot give this task's reference, which must be a pose at "
            f"rest (/goal_pose); {closest(name, _tasks())}"
        )
    values = defaults("task", name)
    if "preview" in values:
        values["preview"] = tasks.Preview(**values["preview"])
    made: tasks.Task = registry.TASKS[name].keys(**values)
    return made


def task_of_policy(
    word: str, card: Card, asked: str | None, vehicle: VehicleModel
) -> tuple[tasks.Task, ObservationSpec]:
    """Return the task and the observation that the card of a policy declares.

    Raises:
        UserError: a pilot cannot give the reference of the task, or cannot supply an observation.
    """
    from auvbench.pilot.live_observation import supplied
    from auvbench.tasks.observation_spec import observation_spec

    named = card.document["task"]
    trained = str(named.get("name", DEFAULT_TASK))
    if asked not in (None, trained):
        raise UserError(
            f"--task {asked}: the card of {word} says task={short(trained, 40)}; leave --task out"
        )
    task = task_of(trained, f"{word}: its task is")
    packages = _block_packages(word, named)
    known = supplied()
    # "velocity_x" and "velocity_error_x" both begin with "velocity", so the longest matching name of a block is chosen.
    blocks = [max((b for b in known if label.startswith(b)), key=len, default="") for label in card.observed]
    try:
        changed: dict[str, Any] = {
            "depth_low": float(named["depth_low_m"]),
            "depth_high": float(named["depth_high_m"]),
            "max_steps": int(named["max_steps"]),
        }
        if hasattr(task, "goal_radius"):
            changed["goal_radius"] = float(named["goal_radius_m"])
    except (KeyError, TypeError, ValueError) as error:
        raise UserError(f"{word}: its card has an invalid task entry: {short(error)}") from error
    observation = list(dict.fromkeys(filter(None, blocks))) or [*known]
    changed |= {"observation": observation, "block_packages": packages}
    task = replace(task, position_frame=card.task.position_frame, **changed)
    spec = observation_spec(task, vehicle.actuators)
    offered = [entry["name"] for entry in spec.card()]
    if offered != list(card.observed):
        wrong = next((name for name in card.observed if name not in offered), card.observed[-1])
        raise UserError(
            f"{word}: observes {short(wrong, 40)}, which a pilot cannot supply; valid: {', '.join(known)}"
        )
    return task, spec


def _block_packages(word: str, task: Any) -> dict[str, str]:
    """Register the observation blocks that a policy's card takes from packages; return the package release of each block.

    Raises:
        UserError: the card's entry is invalid, or the named release of a package is not installed.
    """
    packages = task.get("block_packages", {})
    if not isinstance(packages, dict) or not all(isinstance(value, str) for value in packages.values()):
        raise UserError(f"{word}: its card has an invalid task entry: block_packages={short(packages)}")
    for name, release in packages.items():
        registry.BLOCKS.choose(str(name), release)
    return packages


def defaults(group: str, name: str) -> dict[str, Any]:
    """Return the values of a configuration file, read without Hydra."""
    import yaml

    text = (resources.files("auvbench.conf") / group / f"{name}.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text)
    values.pop("defaults", None)
    return dict(values)


def enter() -> bool:
    """Return whether Enter was pressed since the last call; always False without a terminal in the foreground."""
    try:
        number = sys.stdin.fileno()
        # A background process that reads from its terminal is stopped by the system.
        if not os.isatty(number) or os.tcgetpgrp(number) != os.getpgrp():
            return False
        return bool(select.select([number], [], [], 0.0)[0]) and b"\n" in os.read(number, 1024)
    except (OSError, ValueError, AttributeError):  # a closed standard input
        return False
