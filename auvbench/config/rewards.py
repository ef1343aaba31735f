"""Define the schemas of the `reward` group.

A reward function in `tasks.rewards` reads each field as an attribute of its argument `p`, for example `p.length`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from auvbench.config.fields import below
from auvbench.config.schema import choice_of, later, number
from auvbench.config.schema import keys as schema_keys
from auvbench.config.schema import name as plain_name
from auvbench.errors import ConfigError
from auvbench.registry import REWARDS, TASKS, Spec


@dataclass(kw_only=True)
class Reward:
    """Keys of every reward."""

    name: str = choice_of(lambda: REWARDS.own)
    k: float = number(0.0, 1e6)

    def check(self) -> None:
        """Refuse values that contradict each other.

        Raises:
            ConfigError: names the key, the value and the valid range.
        """


@dataclass(kw_only=True)
class RewardConfig(Reward):
    """Keys of a reward from an installed package; a subclass adds its own keys, which must all be numbers."""

    name: str = plain_name()
    package: str


@dataclass(kw_only=True)
class Thesis(Reward):
    """Reward of the original study (equation 2.1)."""

    length: float = number(0.0, 1e6, open_low=True)  # m
    success: float = number(-1e9, 1e9)
    collision: float = number(-1e9, 1e9)
    regress: float = number(-1e9, 1e9)


@dataclass(kw_only=True)
class Tracking(Reward):
    """Reward for small errors and little effort; the reward `path` has the same formula with other values."""

    length: float = number(0.0, 1e6, open_low=True)  # m
    yaw: float = number(0.0, 1e6)
    yaw_length: float = number(0.0, 1e6, open_low=True)  # rad
    velocity: float = number(0.0, 1e6)
    velocity_length: float = number(0.0, 1e6, open_low=True)  # m/s
    effort: float = number(0.0, 1e6)
    change: float = number(0.0, 1e6)
    success: float = number(-1e9, 1e9)
    failure: float = number(-1e9, 1e9)


@dataclass(kw_only=True)
class Goal(Tracking):
    """The reward `tracking` with one more term, which grows only near the goal."""

    fine: float = later(number(0.0, 1e6), 0.0)
    fine_length: float = later(number(0.0, 1e6, open_low=True), 1.0)  # m


@dataclass(kw_only=True)
class Exponential(Reward):
    """Reward for small position errors only."""

    rate: float = number(0.0, 1e6)  # 1/m
    failure: float = number(-1e9, 1e9)


@dataclass(kw_only=True)
class MarineGymHover(Reward):
    """The reward of MarineGym's hovering task."""

    scale: float = number(0.0, 1e6)  # 1/m
    effort: float = number(0.0, 1e6)


@dataclass(kw_only=True)
class GymAuvPath(Reward):
    """The reward of gym-auv's path following in three dimensions."""

    look_ahead: float = number(0.0, 1e4, open_low=True)  # m
    course: float = number(0.0, 1e6)
    roll: float = number(0.0, 1e6)
    roll_rate: float = number(0.0, 1e6)
    effort: float = number(0.0, 1e6)


@dataclass(kw_only=True)
class GymDockauv(Reward):
    """The reward of gym_dockauv."""

    distance: float = number(0.0, 1e6)
    near: float = number(0.0, 1e4, open_low=True)  # m
    far: float = number(0.0, 1e4, open_low=True)  # m
    elevation: float = number(0.0, 1e6)
    heading: float = number(0.0, 1e6)
    attitude: float = number(0.0, 1e6)
    rates: float = number(0.0, 1e6)
    effort: float = number(0.0, 1e6)
    success: float = number(-1e9, 1e9)
    out_of_bounds: float = number(-1e9, 1e9)
    timeout: float = number(-1e9, 1e9)
    collision: float = number(-1e9, 1e9)

    def check(self) -> None:
        below("reward.near", self.near, "reward.far", self.far, strictly=True)


@dataclass(kw_only=True)
class GymDockauvObstacles(GymDockauv):
    """The reward of gym_dockauv including its term for obstacles."""

    avoidance: float = number(0.0, 1e6)


@dataclass(frozen=True, slots=True)
class RewardSpec(Spec):
    """Description of one value of `reward.name`, available without importing its code."""

    base: ClassVar[type] = RewardConfig

    name: str
    """value of `reward.name`"""
    function: str
    """`module:function`, the reward of a step (`tasks.rewards`)"""
    schema: type
    """schema of the reward's keys; in a package, derived from `RewardConfig`"""
    tasks: tuple[str, ...] = ()
    """tasks that may use the reward, in addition to the tasks whose specs name it (`TaskSpec.rewards`)"""
    sight: str = ""
    """`module:function(e, v, p, solids, heights)` of a term that the reward adds in a world with solids; empty: no such term"""

    @property
    def code(self) -> str:
        """Return `module:function` of the reward."""
        return self.function

    def fault(self) -> str:
        keys = {key: hint for key, hint in schema_keys(self.schema).items() if key not in ("name", "package")}
        for key, hint in keys.items():
            if hint not in (int, float):
                return f"has the parameter {key}, which is not a number; must be an int or a float"
        return ""


thesis = RewardSpec("thesis", "auvbench.tasks.rewards:thesis", Thesis)
tracking = RewardSpec("tracking", "auvbench.tasks.rewards:tracking", Tracking)
exponential = RewardSpec("exponential", "auvbench.tasks.rewards:exponential", Exponential)
marinegym_hover = RewardSpec("marinegym_hover", "auvbench.tasks.rewards:marinegym_hover", MarineGymHover)
gym_auv_path = RewardSpec(
    "gym_auv_path", "auvbench.tasks.rewards:gym_auv_path", GymAuvPath, ("path_following",)
)
gym_dockauv = RewardSpec("gym_dockauv", "auvbench.tasks.rewards:gym_dockauv", GymDockauv, ("docking",))
gym_dockauv_radar = RewardSpec(
    "gym_dockauv_radar",
    gym_dockauv.code,
    GymDockauvObstacles,
    ("docking",),
    "auvbench.tasks.sights:gym_dockauv_sight",
)
goal = RewardSpec("goal", "auvbench.tasks.rewards:goal", Goal)
path = RewardSpec("path", tracking.code, Tracking)


def suitable(task: str) -> tuple[str, ...]:
    """Return the rewards that are available for a task."""
    return (*TASKS[task].rewards, *(name for name, spec in REWARDS.items() if task in spec.tasks))


def check_reward(task: str, reward: str) -> None:
    """Raise ConfigError for a reward that is not available for the task.

    Raises:
        ConfigError: the message names the available rewards.
    """
    able = suitable(task)
    if reward not in able:
        raise ConfigError(
            f"reward.name={reward}: is not available for task={task}; use reward={' or '.join(able)}"
        )
