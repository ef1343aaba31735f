"""Define the schemas of the `task` group; `task_specs` has the specs of auvbench's own tasks.

Importing this module imports no task.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from auvbench.config import feasible
from auvbench.config.schema import choice, choice_of, later, number
from auvbench.config.schema import name as plain_name
from auvbench.errors import ConfigError, closest
from auvbench.registry import BLOCKS, TASKS

THESIS_BLOCKS = ("yaw_error", "position_error", "previous_action")
STATE = ("velocity", "angular_velocity", "gravity", "depth_margin")
ERRORS = ("yaw_error", "position_error", "velocity_error", *STATE, "previous_action")


@dataclass(kw_only=True)
class Task:
    """Keys of every task."""

    name: str = choice_of(lambda: TASKS.own)
    depth_low: float = number(-1e4, 0.0)  # m
    depth_high: float = number(-1e4, 0.0)  # m
    max_steps: int = number(1, 10_000_000)
    time_limit: float | None = later(number(0.0, 1e7, open_low=True))  # s
    position_frame: str = choice("world", "body")
    observation: list[str] = field(default_factory=lambda: [*THESIS_BLOCKS])
    block_packages: dict[str, str] = field(default_factory=dict)  # releases by block; `complete` writes them
    history: int = later(number(1, 64), 1)

    def check(self) -> None:
        """Refuse values with which no episode can succeed.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """

    def check_length(self, frequency: float) -> None:
        """Refuse episodes that are too short for the measure, or so long that the reference leaves the water.

        Args:
            frequency: agent steps per second, Hz.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """

    def card(self) -> dict[str, Any]:
        """Return what the card of an exported policy says of the task, beyond what it says of each task."""
        return {}


@dataclass(kw_only=True)
class Waypoint(Task):
    """Waypoint task (section 3 of the original study)."""

    start: list[float]
    waypoint_low: list[float]
    waypoint_high: list[float]
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m

    def check(self) -> None:
        feasible.check_waypoints(self)

    def card(self) -> dict[str, Any]:
        return {
            "start_m": list(self.start),
            "waypoint_low_m": list(self.waypoint_low),
            "waypoint_high_m": list(self.waypoint_high),
            "goal_radius_m": self.goal_radius,
        }


@dataclass(kw_only=True)
class Preview:
    """Future points of the reference."""

    points: int = number(0, 32)
    interval: float = number(0.0, 1e3, open_low=True)  # s


@dataclass(kw_only=True)
class Tracked(Task):
    """Keys of every task whose reference has its own yaw."""

    position_frame: str = choice("body")
    bounds: float = number(0.0, 1e4, open_low=True)  # m, largest distance from the reference
    preview: Preview


@dataclass(kw_only=True)
class TaskConfig(Tracked):
    """Task of an installed package; a subclass adds its own keys."""

    name: str = plain_name()
    package: str


@dataclass(kw_only=True)
class StationKeeping(Tracked):
    """Hold a position and a yaw."""

    station: list[float]
    yaw: float = number(-math.pi, math.pi)  # rad
    start_radius: float = number(0.0, 1e4)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    yaw_tolerance: float = number(0.0, math.pi, open_low=True)  # rad
    settling: float = number(0.0, 1e7)  # s
    hold_time: float = number(0.0, 1e7, open_low=True)  # s
    hold_share: float = number(0.0, 1.0)

    def check(self) -> None:
        feasible.check_start_radius(self)

    def check_length(self, frequency: float) -> None:
        feasible.check_hold(self, frequency)


@dataclass(kw_only=True)
class TrajectoryTracking(Tracked):
    """Follow a curve in time."""

    curve: str = choice("circle", "helix", "lemniscate", "random", "any")
    centre: list[float]
    size_low: float = number(0.0, 1e4, open_low=True)  # m
    size_high: float = number(0.0, 1e4, open_low=True)  # m
    speed_low: float = number(0.0, 10.0, open_low=True)  # m/s
    speed_high: float = number(0.0, 10.0, open_low=True)  # m/s
    start_radius: float = number(0.0, 1e4)  # m
    start_yaw: float = number(0.0, math.pi)  # rad

    def check(self) -> None:
        feasible.check_start_radius(self)

    def check_length(self, frequency: float) -> None:
        feasible.check_curve(self, frequency)


@dataclass(kw_only=True)
class PathFollowing(Tracked):
    """Follow a path at a speed."""

    start: list[float]
    waypoints: int = number(2, 16)
    spacing: float = number(0.0, 1e4, open_low=True)  # m
    turn: float = number(0.0, math.pi)  # rad
    climb: float = number(0.0, math.pi / 2)  # rad
    speed: float = number(0.0, 10.0, open_low=True)  # m/s
    start_radius: float = number(0.0, 1e4)  # m
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m

    def check(self) -> None:
        feasible.check_start_radius(self)
        feasible.check_path(self)

    @property
    def overshoot(self) -> float:
        """Return the largest height in m of the path above (or depth below) the two points that enclose it.

        A cubic Hermite curve leaves the range of its ends by at most a quarter of the larger slope; in a
        Catmull-Rom curve that slope is the mean of two rises between points.
        """
        return 0.25 * self.spacing * math.sin(self.climb)


@dataclass(kw_only=True)
class Docking(Tracked):
    """Enter a dock."""

    dock: list[float]
    start_low: float = number(0.0, 1e4, open_low=True)  # m
    start_high: float = number(0.0, 1e4, open_low=True)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    yaw_tolerance: float = number(0.0, math.pi, open_low=True)  # rad
    speed: float = number(0.0, 10.0, open_low=True)  # m/s
    cone: float = number(0.0, math.pi / 2, open_low=True)  # rad
    clearance: float = number(0.0, 1e3)  # m
    standoff: float = number(0.0, 1e3, open_low=True)  # m
    tilt: float | None = later(number(0.0, math.pi, open_low=True))  # rad

    def check(self) -> None:
        feasible.check_dock(self)


def blocks(task: Any) -> Sequence[str]:
    """Return the blocks of a task's observation, without an empty `preview`."""
    none = {"preview"} if isinstance(task, Tracked) and task.preview.points == 0 else set()
    return [name for name in task.observation if name not in none]


def check_observation(task: Task) -> None:
    """Raise ConfigError for an observation that the task cannot supply.

    Raises:
        ConfigError: the message names the block and the closest one, or what is missing.
    """
    own = TASKS[task.name].blocks
    known = tuple(dict.fromkeys([*own, *(name for name in BLOCKS.names() if name not in BLOCKS.own)]))
    for name in task.observation:
        if name in task.block_packages:
            _check_reads(task, name)
        elif name not in own:
            raise ConfigError(
                f"task.observation: {name} is not a block of task={task.name}; {closest(name, known)}"
            )
        if task.observation.count(name) > 1:
            raise ConfigError(f"task.observation: {name} occurs twice")
    if not task.observation:
        raise ConfigError(f"task.observation=[]: must have at least one block: {', '.join(known)}")


def _check_reads(task: Task, name: str) -> None:
    """Refuse a package's block that reads what the task does not have."""
    own, reads = TASKS[task.name].blocks, BLOCKS[name].reads
    points = task.preview.points if isinstance(task, Tracked) and "preview" in own else 0
    for what, able, hint in (
        ("goal", "goal_error" in own, ""),
        ("preview", points > 0, "; task.preview.points sets it" if "preview" in own else ""),
        ("task", name in own, ""),
    ):
        if what in reads and not able:
            thing = f"fields that only other tasks have, not task={task.name}" if what == "task" else ""
            raise ConfigError(
                f"task.observation: {name} of {task.block_packages[name]} reads "
                f"{thing or f'the {what}, which task={task.name} does not have here'}{hint}"
            )
