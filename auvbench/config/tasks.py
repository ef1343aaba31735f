"""Define the schemas of the `task` group, and the specs of auvbench's own tasks.

Importing this module imports no task.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from auvbench import metrics, record
from auvbench.config.schema import choice, choice_of, later, number
from auvbench.config.schema import name as plain_name
from auvbench.errors import ConfigError, closest
from auvbench.metrics import Metric
from auvbench.registry import TASKS, Spec
from auvbench.untrusted.text import short

THESIS_BLOCKS = ("yaw_error", "position_error", "previous_action")
STATE = ("velocity", "angular_velocity", "gravity", "depth_margin")
ERRORS = ("yaw_error", "position_error", "velocity_error", *STATE, "previous_action")
BLOCKS = (*ERRORS, "preview", "goal_error")
"""observation blocks that a task may have"""


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
    history: int = later(number(1, 64), 1)


@dataclass(kw_only=True)
class Waypoint(Task):
    """Waypoint task (section 3 of the original study)."""

    start: list[float]
    waypoint_low: list[float]
    waypoint_high: list[float]
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m


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


@dataclass(frozen=True, slots=True)
class TaskSpec(Spec):
    """Description of one value of `task.name`, available without importing its code."""

    base: ClassVar[type] = TaskConfig

    name: str
    title: str
    """title in tables and sentences"""
    factory: str
    """`module:class` of the task"""
    primary: str
    """measure that ranks the agents (`analysis.measures`)"""
    blocks: tuple[str, ...]
    """observation blocks that the task can supply"""
    outcomes: tuple[str, ...]
    """outcomes of its episodes, names in `record.OUTCOMES`"""
    rewards: tuple[str, ...]
    """rewards that suit the task"""
    needs_thrusters: bool = True
    """whether the task needs a vehicle with thrust along each axis and about the vertical"""
    has_yaw: bool = True
    """whether the reference has its own yaw; otherwise its yaw is its bearing"""
    schema: type | None = None
    """schema of its configuration; in a package, derived from `TaskConfig`"""
    failures: tuple[str, ...] = ("collision", "out_of_bounds")
    """outcomes of a failed episode, in which every error counts as its bound (`Metric.failed`)"""
    metrics: tuple[Metric, ...] = ()
    """additional metrics of an installed package (`metrics.column`), besides `metrics.SHARED`"""

    @property
    def code(self) -> str:
        """Return `module:class` of the task."""
        return self.factory

    def fault(self) -> str:
        for what, values, known in (
            ("block", self.blocks, BLOCKS),
            ("outcome", self.outcomes, record.OUTCOMES),
        ):
            for value in values:
                if value not in known:
                    return f"declares the {what} {short(repr(value))}; {closest(str(value), known)}"
        for metric in self.metrics:
            column = isinstance(metric, Metric) and metric.kind in ("episode", "scenario")
            if not column or not re.fullmatch(r"[a-z]\w*", metric.name) or not metric.low < metric.high:
                return f"declares {short(repr(metric))} as a metric; make it by auvbench.plugin.column"
        own = tuple(metric.measure for metric in self.metrics if metric.better)
        ranks = (*record.measure_names(), *own)
        if self.primary not in ranks:
            return f"is ranked by {short(repr(self.primary))}, which is not a measure; {closest(self.primary, ranks)}"
        return ""

    def enter(self) -> None:
        metrics.add(self.name, self.metrics)
        record.forget()

    def leave(self) -> None:
        metrics.drop(self.name)
        record.forget()


_FOUR_ENDS = ("success", "collision", "timeout", "out_of_bounds")
_TRACKING = ("tracking", "exponential", "marinegym_hover")

waypoint = TaskSpec(
    "waypoint",
    "waypoint",
    "auvbench.tasks.waypoint:WaypointTask",
    "par1_time_s",
    ("yaw_error", "position_error", *STATE, "previous_action"),
    ("success", "collision", "timeout"),
    ("thesis", "goal", "tracking", "exponential"),
    needs_thrusters=False,
    has_yaw=False,
    schema=Waypoint,
)
station_keeping = TaskSpec(
    "station_keeping",
    "station keeping",
    "auvbench.tasks.station_keeping:StationKeepingTask",
    "mean_position_error_rms_m",
    ERRORS,
    _FOUR_ENDS,
    _TRACKING,
    schema=StationKeeping,
)
trajectory_tracking = TaskSpec(
    "trajectory_tracking",
    "trajectory tracking",
    "auvbench.tasks.trajectory_tracking:TrajectoryTrackingTask",
    "mean_position_error_rms_m",
    (*ERRORS, "preview"),
    ("success", "collision", "out_of_bounds"),
    _TRACKING,
    schema=TrajectoryTracking,
)
path_following = TaskSpec(
    "path_following",
    "path following",
    "auvbench.tasks.path_following:PathFollowingTask",
    "mean_cross_track_rms_m",
    (*ERRORS, "preview"),
    _FOUR_ENDS,
    ("path", *_TRACKING, "gym_auv_path"),
    needs_thrusters=False,
    failures=("collision", "timeout", "out_of_bounds"),
    schema=PathFollowing,
)
docking = TaskSpec(
    "docking",
    "docking",
    "auvbench.tasks.docking:DockingTask",
    "par1_time_s",
    (*ERRORS, "goal_error"),
    _FOUR_ENDS,
    ("goal", "tracking", "exponential", "gym_dockauv"),
    schema=Docking,
)


def primary_of(name: str) -> str:
    """Return the measure that ranks the agents of a task; for an unknown task, the waypoint task's."""
    return TASKS.get(name, TASKS["waypoint"]).primary


def blocks(task: Any) -> Sequence[str]:
    """Return the blocks of a task's observation, without an empty `preview`."""
    none = {"preview"} if isinstance(task, Tracked) and task.preview.points == 0 else set()
    return [name for name in task.observation if name not in none]


def check_observation(task: Task) -> None:
    """Raise ConfigError for an observation that the task cannot supply.

    Raises:
        ConfigError: the message names the block and the closest one, or what is missing.
    """
    known = TASKS[task.name].blocks
    for name in task.observation:
        if name not in known:
            raise ConfigError(
                f"task.observation: {name} is not a block of task={task.name}; {closest(name, known)}"
            )
        if task.observation.count(name) > 1:
            raise ConfigError(f"task.observation: {name} is there twice")
    if not task.observation:
        raise ConfigError(f"task.observation=[]: must have at least one block: {', '.join(known)}")
