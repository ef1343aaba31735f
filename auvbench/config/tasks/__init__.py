"""Define the base classes of the schemas in the `task` group, and the spec of a task.

Each of auvbench's own tasks has one module here, with the task's schema, metrics and spec. Importing a module of this
package imports no code of a task.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from auvbench import metrics, record
from auvbench.config.ranges import Ranges, key_of
from auvbench.config.schema import choice, choice_of, later, number
from auvbench.config.schema import name as plain_name
from auvbench.config.worlds import World
from auvbench.errors import ConfigError, closest
from auvbench.metrics import Metric
from auvbench.registry import BLOCKS, TASKS, WORLDS, Spec
from auvbench.untrusted.text import short

MISSING: Any = "???"
"""OmegaConf's mark of a missing value (`omegaconf.MISSING`), written out so that OmegaConf is not imported"""
THESIS_BLOCKS = ("yaw_error", "position_error", "previous_action")
STATE = ("velocity", "angular_velocity", "gravity", "depth_margin")
"""blocks that every task supplies, in addition to THESIS_BLOCKS"""
ERRORS = ("yaw_error", "position_error", "velocity_error", *STATE, "previous_action")
"""blocks of a task whose reference has a velocity"""

FOUR_ENDS = ("success", "collision", "timeout", "out_of_bounds")
TRACKING = ("tracking", "exponential", "marinegym_hover")


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
    # Release of the package that provides a block, by the block's name; `complete` writes this key.
    block_packages: dict[str, str] = field(default_factory=dict)
    history: int = later(number(1, 64), 1)
    # Keys of the observed range sensors; `complete` removes the keys of all other sensors. The default is not None, because None
    # would replace the values of `conf/range`.
    range: Ranges | None = MISSING

    def __post_init__(self) -> None:
        if self.range == MISSING:
            self.range = None

    @property
    def team(self) -> int:
        """Number of vehicles in an episode."""
        return 1

    def check(self) -> None:
        """Refuse values with which no episode can succeed.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """

    def check_length(self, frequency: float) -> None:
        """Refuse episodes that are too short for the task's measures, or so long that the reference leaves the water.

        Args:
            frequency: agent steps per second, Hz.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        """Return the largest position error in m that can occur along each axis of `position_frame`.

        Args:
            speed: largest speed over ground, m/s.
            seconds: length of an episode.
            frequency: agent steps per second, Hz.
        """
        raise NotImplementedError

    def card(self) -> dict[str, Any]:
        """Return the entries that only this task adds to the card of an exported policy."""
        return {}


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

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        most = self.bounds + speed / frequency  # The last step may lead out of bounds.
        return most, most, most


@dataclass(kw_only=True)
class TaskConfig(Tracked):
    """Keys of a task from an installed package; a subclass adds its own keys."""

    name: str = plain_name()
    package: str


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
    """possible outcomes of the task's episodes, names in `record.OUTCOMES`"""
    rewards: tuple[str, ...]
    """rewards that the task may use, in addition to the rewards that name the task (`RewardSpec.tasks`)"""
    needs_thrusters: bool = True
    """whether the task needs a vehicle with thrust along each axis and about the vertical"""
    has_yaw: bool = True
    """whether the task prescribes a yaw; otherwise the reference yaw is the bearing from the vehicle to the reference"""
    schema: type | None = None
    """schema of the task's keys; in a package, derived from `TaskConfig`"""
    failures: tuple[str, ...] = ("collision", "out_of_bounds")
    """outcomes that count as failures; a failed episode gets the worst value in each error metric (`Metric.failed`)"""
    goal: str = "goal"
    """Name of the final reference in sentences and pictures"""
    reached: str = ""
    """plural noun for what a successful episode reaches, such as "waypoints"; empty: sentences count episodes"""
    fixed_start: bool = False
    """whether each episode begins at `task.start`"""
    free_goal: bool = False
    """whether `reset` has the options `waypoint` and `distance`, which place the goal; the task needs a fixed start"""
    path: bool = False
    """whether the reference is a path, on which the reference point advances with the vehicle"""
    holds: bool = False
    """whether the vehicle must stay at the reference until the time limit"""
    bottom: bool = False
    """whether the task needs a world with a bottom"""
    at_rest: bool = False
    """whether the reference is a single fixed pose, which a pilot takes from /goal_pose"""
    budget: int = 0
    """number of environment steps below which published learners did not learn the task; 0: unknown"""
    short_of_budget: str = ""
    """text that says what published trainings below the budget reached, with the study"""
    shared: tuple[str, ...] = metrics.SHARED
    """metrics that the task shares with other tasks, names in `metrics.SHARED`"""
    metrics: tuple[Metric, ...] = ()
    """metrics that only this task has (`metrics.column`)"""

    @property
    def has_goal(self) -> bool:
        """Whether an episode has a goal in addition to the reference."""
        return "goal_error" in self.blocks

    def fault(self) -> str:
        for what, values, valid in (
            ("block", self.blocks, BLOCKS.names()),
            ("outcome", self.outcomes, record.OUTCOMES),
        ):
            for value in values:
                if value not in valid:
                    return f"declares the {what} {short(repr(value))}; {closest(str(value), valid)}"
        for metric in self.metrics:
            column = isinstance(metric, Metric) and metric.kind in ("episode", "scenario")
            if not column or not re.fullmatch(r"[a-z]\w*", metric.name) or not metric.low < metric.high:
                return (
                    f"declares {short(repr(metric))} as a metric; must be a result of auvbench.plugin.column"
                )
            if metric.after not in (places := [general.name for general in metrics.METRICS]):
                return f"places the metric {metric.name} after {short(repr(metric.after))}; {closest(metric.after, places)}"
        if self.free_goal and not self.fixed_start:
            return "has a free goal without a fixed start; set fixed_start=True too"
        own = tuple(metric.measure for metric in self.metrics if metric.better)
        ranks = (*record.measure_names(), *own)
        if self.primary not in ranks:
            return f"is ranked by {short(repr(self.primary))}, which is not a measure; {closest(self.primary, ranks)}"
        return ""

    def enter(self) -> None:
        other_names = {metric.name for metric in metrics.registered() if metric.tasks != (self.name,)}
        for metric in self.metrics:
            if metric.name in other_names:
                raise ValueError(
                    f"has the metric {metric.name}, a name that another metric has; choose another name"
                )
        record.forget()

    def leave(self) -> None:
        record.forget()


def blocks(task: Any) -> Sequence[str]:
    """Return the blocks of a task's observation that have values.

    `preview` has no values without preview points, and `messages` has none with one vehicle in the episode.
    """
    none = {"preview"} if isinstance(task, Tracked) and task.preview.points == 0 else set()
    none |= {"messages"} if task.team == 1 else set()
    return [name for name in task.observation if name not in none]


def check_observation(task: Task) -> None:
    """Raise ConfigError for an observation that the task cannot supply.

    Raises:
        ConfigError: the message names the block and the closest valid block, or the missing key.
    """
    own = TASKS[task.name].blocks
    sensors = tuple(name for name in BLOCKS.own if BLOCKS[name].sensor)
    estimated = tuple(name for name in BLOCKS.own if "navigation" in BLOCKS[name].reads)
    valid = tuple(
        dict.fromkeys(
            [*own, *sensors, *estimated, *(name for name in BLOCKS.names() if name not in BLOCKS.own)]
        )
    )
    for name in task.observation:
        if name in task.block_packages:
            _check_reads(task, name)
        elif name in sensors:
            _check_sensor(task, name)
        elif name not in (*own, *estimated):
            raise ConfigError(
                f"task.observation: {name} is not a block of task={task.name}; {closest(name, valid)}"
            )
        if task.observation.count(name) > 1:
            raise ConfigError(f"task.observation: {name} occurs twice")
    if not task.observation:
        raise ConfigError(f"task.observation=[]: must have at least one block: {', '.join(valid)}")


def _check_sensor(task: Task, name: str) -> None:
    """Check the keys of a range sensor; do nothing for the block `solids`, which has no keys."""
    key = key_of(name)
    if not key:
        return
    sensor = getattr(task.range, key, None) if task.range else None
    if sensor is None:
        raise ConfigError(f"task.range.{key}: a value is missing, since task.observation has {name}")
    sensor.check(f"task.range.{key}.")


def _check_reads(task: Task, name: str) -> None:
    """Refuse a package's block that reads data which the task does not have."""
    spec, reads = TASKS[task.name], BLOCKS[name].reads
    own = spec.blocks
    points = task.preview.points if isinstance(task, Tracked) and "preview" in own else 0
    for what, able, hint in (
        ("goal", spec.has_goal, ""),
        ("preview", points > 0, "; task.preview.points sets it" if "preview" in own else ""),
        ("task", name in own, ""),
        ("team", "messages" in own, ""),
    ):
        if what in reads and not able:
            lacking = f"fields that only other tasks have, not task={task.name}" if what == "task" else ""
            raise ConfigError(
                f"task.observation: {name} of {task.block_packages[name]} reads "
                f"{lacking or f'the {what}, which task={task.name} does not have here'}{hint}"
            )


def check_solids(task: Task, world: World) -> None:
    """Refuse a task without the bottom that it needs, and a range sensor in a world without solids.

    Args:
        task: checked task.
        world: checked world.

    Raises:
        ConfigError: the message names the task or block, and the worlds that suit it.
    """
    if TASKS[task.name].bottom and not world.has_bottom:
        raise ConfigError(
            f"task={task.name}: needs a bottom, and world={world.name} has none; use world=rough, seabed, slope or tank"
        )
    if world.solid:
        return
    worlds = " or ".join(f"world={other}" for other in WORLDS.own if other != world.name)
    for name in task.observation:
        if "solids" in BLOCKS[name].reads:
            raise ConfigError(
                f"task.observation: {name} has nothing to measure in world={world.name}; use {worlds}"
            )


def primary_of(name: str) -> str:
    """Return the measure that ranks the agents of a task; for an unknown task, return the measure of the waypoint task."""
    return TASKS.get(name, TASKS["waypoint"]).primary
