"""Define the schema of the configuration: types and valid ranges.

The YAML files in `conf/` have the defaults and the comments that explain the keys. A field has a default here only if runs
of earlier versions lack the field (`fields.later`), if it is an optional block, or if it belongs to an entry of a list.
`validate.validate_fields` checks a field's range; OmegaConf checks its type while Hydra composes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from typing import Any

from auvbench.config.disturbances import SCALES as SCALES
from auvbench.config.disturbances import (
    Current,
    Delay,
    Factor,
    Fault,
    Sensor,
    Waves,
    asking,
    still,
)
from auvbench.config.disturbances import Randomisation as Randomisation
from auvbench.config.fields import choice as choice
from auvbench.config.fields import choice_of as choice_of
from auvbench.config.fields import keys as keys
from auvbench.config.fields import later as later
from auvbench.config.fields import name as name
from auvbench.config.fields import number as number
from auvbench.config.filters import unfiltered
from auvbench.config.navigation import Sensors as NavigationSensors
from auvbench.config.navigation import no_sensors, truth
from auvbench.config.worlds import open_water
from auvbench.record import PRIMARY, measure_names, record_columns
from auvbench.registry import TRACKERS


@dataclass(kw_only=True)
class Step:
    """Rate of the agent's steps."""

    frequency: float = number(0.0, 1000.0, open_low=True)  # Hz


@dataclass(kw_only=True)
class Range:
    """Range of the magnitude of uniform noise."""

    low: float = number(0.0, 1e6)
    high: float = number(0.0, 1e6)


@dataclass(kw_only=True)
class Noise:
    """Uniform noise on sensor readings and commands."""

    name: str = name()
    position: Range
    yaw: Range
    command: Range
    command_unit: str = choice("physical", "normalised")
    sign: str = choice("both", "positive")
    scale: float = number(0.0, 1e3)


@dataclass(kw_only=True)
class Disturbance:
    """Disturbances of an episode, with the keys that every configuration has.

    `with_disturbances` adds the keys of the other disturbances that a configuration chooses.
    """

    name: str = name()
    current: Current
    waves: Waves = field(default_factory=still)
    fault: Fault
    delay: Delay
    sensor: Sensor
    randomisation: Randomisation

    def factors(self) -> Iterator[tuple[str, Factor]]:
        """Yield the name and the keys of each disturbance."""
        for part in fields(self):
            value = getattr(self, part.name)
            if isinstance(value, Factor):
                yield part.name, value

    def active(self) -> Iterator[tuple[str, Factor]]:
        """Yield the name and the keys of each disturbance that has an effect."""
        for part, factor in self.factors():
            with asking(part, factor, "active"):
                active = factor.active
            if active:
                yield part, factor


@cache
def with_disturbances(more: tuple[tuple[str, type], ...]) -> type[Disturbance]:
    """Return the schema of `disturbance` with the keys of additional disturbances; `more` are pairs of name and schema."""
    # Workers receive pickled values. pickle needs `__reduce__`, since it cannot find this class in any module.
    pickled = {"__reduce__": lambda self: (_disturbance, (more, vars(self)))}
    return make_dataclass("Disturbance", more, bases=(Disturbance,), kw_only=True, namespace=pickled)


def _disturbance(more: tuple[tuple[str, type], ...], values: dict[str, Any]) -> Disturbance:
    return with_disturbances(more)(**values)


@dataclass(kw_only=True)
class Checkpoint:
    """How often a run is saved; these keys have no effect on the run's result."""

    steps: int = number(0, 1 << 62)
    seconds: float = number(0.0, 1e9)
    keep: int = number(1, 1000)


@dataclass(kw_only=True)
class Train:
    """Training budget and validation during training."""

    total_steps: int = number(1, 1 << 62)
    evaluate_every: int = later(number(0, 1 << 62), 0)
    normalise_observations: bool
    normalise_rewards: bool
    clip_observations: float = number(0.0, 1e6, open_low=True)
    clip_rewards: float = number(0.0, 1e6, open_low=True)
    checkpoint: Checkpoint
    progress: bool
    log: str = later(choice_of(lambda: ("tensorboard", *TRACKERS.names())), "tensorboard")


@dataclass(kw_only=True)
class Condition:
    """One test condition: changed configuration values for the scenarios of the protocol."""

    # An entry of a list has no YAML file of its own, so its default is here.
    name: str = ""
    frequency: float | None = later(number(0.0, 1000.0, open_low=True))
    overrides: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class Protocol:
    """Test protocol: its scenarios, frequency and conditions."""

    name: str = name()
    scenarios: str = later(choice("test", "validation"), "test")
    episodes: int = number(1, 1_000_000)
    seed: int = number(0, (1 << 32) - 1)
    frequency: float | None = number(0.0, 1000.0, open_low=True)
    batch: int = number(1, 65_536)
    trajectories: int = number(0, 100_000)
    overrides: list[str]
    conditions: list[Condition]


@dataclass(kw_only=True)
class EvaluateConfig:
    """Configuration of `auvbench evaluate`."""

    protocol: Protocol


@dataclass(kw_only=True)
class Analysis:
    """Primary analysis that an experiment declares before its runs; it has no effect on the results of the runs."""

    measure: str = choice_of(lambda: (PRIMARY, *measure_names()))
    baseline: str | None
    # smallest difference of interest, in the unit of the measure; for a rate, in percentage points
    margin: float | None = number(0.0, open_low=True)
    seeds: int | None = number(1, 1_000_000)
    protocol: str = later(name(), "test")
    # conditions of the protocol that are reported; the verdicts are about the first condition; null: all conditions
    conditions: list[str] | None = None
    episodes: int | None = later(number(1, 1_000_000))  # episodes per condition; null: the protocol's number


@dataclass(kw_only=True)
class TrainConfig:
    """Configuration of `auvbench train`."""

    seed: int = number(0, (1 << 32) - 1)
    name: str = name()
    output: str
    vehicle: Any
    simulator: Any
    task: Any
    reward: Any
    step: Step
    noise: Noise
    disturbance: Disturbance
    algo: Any
    train: Train
    launcher: Any
    analysis: Analysis | None = None
    world: Any = None
    sensors: NavigationSensors = field(default_factory=no_sensors)
    navigation: Any = None
    filter: Any = None

    def __post_init__(self) -> None:
        if self.world is None:  # runs of earlier versions
            self.world = open_water()
        if self.navigation is None:
            self.navigation = truth()
        if self.filter is None:
            self.filter = unfiltered()


def columns_of(config: TrainConfig) -> tuple[str, ...]:
    """Return the columns of the records of runs with this configuration."""
    return record_columns(config.task.name, config.world.name, config.navigation.name, config.filter.acts)


def whole(text: str) -> int | None:
    """Parse a whole number, also in the form 1e6; return None for any other text, such as 1.5.

    >>> whole("1e6"), whole("2_000"), whole("1.5"), whole("many")
    (1000000, 2000, None, None)
    """
    try:
        return int(text)
    except ValueError:
        pass
    try:
        number = float(text)
    except ValueError:
        return None
    # Beyond 2^53 a float does not identify one whole number.
    return int(number) if number.is_integer() and abs(number) <= 2**53 else None


def step_limit(task: Any, frequency: float) -> int:
    """Return the number of agent steps after which an episode times out: `task.time_limit` in steps, else `task.max_steps`.

    Args:
        task: configuration of the task.
        frequency: agent steps per second, Hz.
    """
    return int(task.max_steps if task.time_limit is None else round(task.time_limit * frequency))


def discount(algo: Any, frequency: float) -> float:
    """Return the discount per agent step: exp(-1/(frequency horizon)) if `algo.horizon_s` is set, else `algo.gamma`.

    A reward `horizon_s` seconds ahead then has the weight 1/e at every frequency. The original study's
    discount of 0.99 per step is a horizon of -1/(f ln 0.99): 9.95 s at 10 Hz, 1.81 s at 55 Hz.

    >>> from types import SimpleNamespace
    >>> round(discount(SimpleNamespace(gamma=0.5, horizon_s=9.95), 10.0), 5)
    0.99
    """
    horizon = algo.horizon_s
    return float(algo.gamma if horizon is None else math.exp(-1.0 / (frequency * horizon)))
