"""Specs of tasks, which describe a task without an import of its code, and the specs of auvbench's own tasks."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from auvbench import metrics, record
from auvbench.config import tasks
from auvbench.errors import closest
from auvbench.metrics import Metric
from auvbench.registry import BLOCKS, TASKS, Spec
from auvbench.untrusted.text import short


@dataclass(frozen=True, slots=True)
class TaskSpec(Spec):
    """Description of one value of `task.name`, available without importing its code."""

    base: ClassVar[type] = tasks.TaskConfig

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
    goal: str = "goal"
    """what the reference at the end is called in sentences and pictures"""
    reached: str = ""
    """plural of what a successful agent reaches, for sentences; empty: it succeeds in episodes"""
    fixed_start: bool = False
    """whether each episode begins at `task.start`"""
    free_goal: bool = False
    """whether `reset` may place the goal, as seen from a fixed start: options waypoint and distance"""
    path: bool = False
    """whether the reference is a path, and its point of now goes along with the vehicle"""
    holds: bool = False
    """whether the vehicle is to stay at the reference until the time is up"""
    at_rest: bool = False
    """whether the reference is one pose at rest, which a pilot takes from /goal_pose"""
    metrics: tuple[Metric, ...] = ()
    """additional metrics of an installed package (`metrics.column`), besides `metrics.SHARED`"""

    @property
    def code(self) -> str:
        """Return `module:class` of the task."""
        return self.factory

    def fault(self) -> str:
        for what, values, known in (
            ("block", self.blocks, BLOCKS.names()),
            ("outcome", self.outcomes, record.OUTCOMES),
        ):
            for value in values:
                if value not in known:
                    return f"declares the {what} {short(repr(value))}; {closest(str(value), known)}"
        for metric in self.metrics:
            column = isinstance(metric, Metric) and metric.kind in ("episode", "scenario")
            if not column or not re.fullmatch(r"[a-z]\w*", metric.name) or not metric.low < metric.high:
                return f"declares {short(repr(metric))} as a metric; make it by auvbench.plugin.column"
        if self.free_goal and not self.fixed_start:
            return "has a free goal without a fixed start"
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
    ("yaw_error", "position_error", *tasks.STATE, "previous_action"),
    ("success", "collision", "timeout"),
    ("thesis", "goal", "tracking", "exponential"),
    needs_thrusters=False,
    has_yaw=False,
    schema=tasks.Waypoint,
    goal="waypoint",
    reached="waypoints",
    fixed_start=True,
    free_goal=True,
    at_rest=True,
)
station_keeping = TaskSpec(
    "station_keeping",
    "station keeping",
    "auvbench.tasks.station_keeping:StationKeepingTask",
    "mean_position_error_rms_m",
    tasks.ERRORS,
    _FOUR_ENDS,
    _TRACKING,
    schema=tasks.StationKeeping,
    holds=True,
    at_rest=True,
)
trajectory_tracking = TaskSpec(
    "trajectory_tracking",
    "trajectory tracking",
    "auvbench.tasks.trajectory_tracking:TrajectoryTrackingTask",
    "mean_position_error_rms_m",
    (*tasks.ERRORS, "preview"),
    ("success", "collision", "out_of_bounds"),
    _TRACKING,
    schema=tasks.TrajectoryTracking,
)
path_following = TaskSpec(
    "path_following",
    "path following",
    "auvbench.tasks.path_following:PathFollowingTask",
    "mean_cross_track_rms_m",
    (*tasks.ERRORS, "preview"),
    _FOUR_ENDS,
    ("path", *_TRACKING, "gym_auv_path"),
    needs_thrusters=False,
    failures=("collision", "timeout", "out_of_bounds"),
    schema=tasks.PathFollowing,
    path=True,
)
docking = TaskSpec(
    "docking",
    "docking",
    "auvbench.tasks.docking:DockingTask",
    "par1_time_s",
    (*tasks.ERRORS, "goal_error"),
    _FOUR_ENDS,
    ("goal", "tracking", "exponential", "gym_dockauv"),
    schema=tasks.Docking,
)


def primary_of(name: str) -> str:
    """Return the measure that ranks the agents of a task; for an unknown task, the waypoint task's."""
    return TASKS.get(name, TASKS["waypoint"]).primary
