"""The schema of the configuration: types and admissible ranges, no defaults.

The YAML files in `conf/` hold the only defaults and the comments that explain them. A field's range is checked
by `validate.validate_fields`, its type by OmegaConf while Hydra composes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, is_dataclass
from typing import Any, get_args, get_type_hints

from auvbench.record import PRIMARY, measure_names
from auvbench.registry import TRACKERS

INF = math.inf


def number(low: float = -INF, high: float = INF, *, open_low: bool = False) -> Any:
    """A field with a range [low, high], or (low, high] with `open_low`; infinities and NaN are never valid."""
    return field(metadata={"low": low, "high": high, "open_low": open_low})


def choice(*names: str) -> Any:
    """A field that takes one of a few names."""
    return choice_of(lambda: names)


def choice_of(names: Callable[[], Collection[str]]) -> Any:
    """A field that takes one of the names of a registry, which is complete when a value is checked."""
    return field(metadata={"choices": names})


def later(declared: Any, default: Any = None) -> Any:
    """A field that runs of earlier versions do not have: they load with the value under which it changes nothing."""
    return field(default=default, metadata=declared.metadata)


def name() -> Any:
    """A field that becomes part of a path: letters, digits, dots, dashes and underscores."""
    return field(metadata={"name": True})


def keys(kind: type, prefix: str = "") -> dict[str, Any]:
    """Return the dotted keys of a schema, those of nested schemas too, with their types."""
    found = {}
    for key, hint in get_type_hints(kind).items():
        found[f"{prefix}{key}"] = hint
        for kind in (hint, *get_args(hint)):  # a part may be null
            if isinstance(kind, type) and is_dataclass(kind):
                found |= keys(kind, f"{prefix}{key}.")
    return found


@dataclass(kw_only=True)
class Step:
    """The agent's clock."""

    frequency: float = number(0.0, 1000.0, open_low=True)  # Hz


@dataclass(kw_only=True)
class Range:
    """Magnitude of uniform noise."""

    low: float = number(0.0, 1e6)
    high: float = number(0.0, 1e6)


@dataclass(kw_only=True)
class Noise:
    """Uniform noise on the readings and on the commands."""

    name: str = name()
    position: Range
    yaw: Range
    command: Range
    command_unit: str = choice("physical", "normalised")
    sign: str = choice("both", "positive")
    scale: float = number(0.0, 1e3)


@dataclass(kw_only=True)
class GaussMarkov:
    """First-order Gauss-Markov fluctuation of the current about its mean."""

    sigma: float = number(
        0.0, 10.0
    )  # m/s, stationary standard deviation of the east and of the north component
    sigma_vertical: float = number(0.0, 10.0)  # m/s, of the vertical component
    mu: float = number(0.0, 1e3, open_low=True)  # 1/s, inverse of the correlation time


@dataclass(kw_only=True)
class CurrentProfile:
    """Mean current over depth: linear between two depths, constant above and below."""

    top: float = number(0.0, 1e4)  # m, positive down
    bottom: float = number(0.0, 1e4, open_low=True)  # m, positive down
    factor: float = number(-10.0, 10.0)  # speed at `bottom` over speed at `top`
    turn: float = number(-math.pi, math.pi)  # rad, direction at `bottom` less direction at `top`


@dataclass(kw_only=True)
class Current:
    """The water's motion."""

    speed: float = number(0.0, 10.0)  # m/s
    speed_high: float | None = number(0.0, 10.0)  # m/s
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    elevation: float = number(-math.pi / 2, math.pi / 2)  # rad
    gauss_markov: GaussMarkov
    profile: CurrentProfile


@dataclass(kw_only=True)
class Waves:
    """Waves on deep water."""

    height: float = number(0.0, 30.0)  # m, significant
    period: float = number(0.5, 30.0)  # s, of the spectrum's peak
    spectrum: str = choice("jonswap", "pierson_moskowitz")
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    spreading: float | None = number(1.0, 1000.0)  # exponent of cos^n


def _still() -> Waves:
    """Return no waves: those of runs of earlier versions."""
    return Waves(height=0.0, period=7.5, spectrum="jonswap", direction=None, spreading=2.0)


@dataclass(kw_only=True)
class Fault:
    """One actuator of the vehicle fails in an episode."""

    mode: str = choice("none", "dead", "weak", "stuck", "any")
    probability: float = number(0.0, 1.0)  # per episode
    actuator: str | None
    time: float = number(0.0, 1e9)  # s
    time_high: float | None = number(0.0, 1e9)  # s
    factor: float = number(0.0, 1.0)  # of the force of a weak thruster


@dataclass(kw_only=True)
class Delay:
    """Dead times between the agent and the vehicle."""

    action: float = number(0.0, 10.0)  # s
    observation: float = number(0.0, 10.0)  # s


@dataclass(kw_only=True)
class Channels:
    """A number per reading."""

    x: float = number(0.0, 1e3)
    y: float = number(0.0, 1e3)
    z: float = number(0.0, 1e3)
    yaw: float = number(0.0, 1e3)


@dataclass(kw_only=True)
class Sensor:
    """Errors of the position and yaw readings, on top of `noise`."""

    gaussian: Channels  # m and rad, standard deviation
    bias: Channels  # m and rad, standard deviation over episodes
    drift: Channels  # m/sqrt(s) and rad/sqrt(s)


@dataclass(kw_only=True)
class Scale:
    """Range of a factor."""

    low: float = number(0.01, 100.0)
    high: float = number(0.01, 100.0)


SCALES = ("mass", "buoyancy", "inertia", "added_mass", "damping", "thrust")
"""Factors of `Randomisation`, in the order in which simulators take them"""


@dataclass(kw_only=True)
class Randomisation:
    """Another vehicle in each episode: factors on the numbers of its sheet."""

    distribution: str = choice("uniform", "log_uniform")
    keep_trim: bool
    mass: Scale
    buoyancy: Scale
    inertia: Scale
    added_mass: Scale
    damping: Scale
    thrust: Scale


@dataclass(kw_only=True)
class Disturbance:
    """What the water, the actuators, the sensors and the sheet's uncertainty do to an episode."""

    name: str = name()
    current: Current
    waves: Waves = field(default_factory=_still)
    fault: Fault
    delay: Delay
    sensor: Sensor
    randomisation: Randomisation

    @property
    def sea(self) -> Waves | None:
        """The waves; None in still water."""
        return self.waves if self.waves.height > 0.0 else None


@dataclass(kw_only=True)
class Checkpoint:
    """How often a run is saved; never changes its result."""

    steps: int = number(0, 1 << 62)
    seconds: float = number(0.0, 1e9)
    keep: int = number(1, 1000)


@dataclass(kw_only=True)
class Train:
    """The budget of training and how it is watched."""

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
    """A condition of a test: the scenarios under changed configuration values."""

    # The one place where a default is in code: an entry of a list has no file of its own to hold it.
    name: str = ""
    frequency: float | None = later(number(0.0, 1000.0, open_low=True))
    overrides: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class Protocol:
    """A test: which scenarios, at which frequency, under which conditions."""

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
    """Everything that `auvbench evaluate` composes."""

    protocol: Protocol


@dataclass(kw_only=True)
class Analysis:
    """The primary analysis that an experiment declares before its runs; never changes a result."""

    measure: str = choice_of(lambda: (PRIMARY, *measure_names()))
    baseline: str | None
    margin: float | None = number(0.0, open_low=True)  # unit of the measure, percentage points for a rate
    seeds: int | None = number(1, 1_000_000)
    protocol: str = later(name(), "test")
    conditions: list[str] | None = None  # the verdicts are about the first; null: all of the protocol
    episodes: int | None = later(number(1, 1_000_000))  # of a condition; null: as the protocol says


@dataclass(kw_only=True)
class TrainConfig:
    """Everything that `auvbench train` composes."""

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


def whole(text: str) -> int | None:
    """Return the whole number that a text stands for: 1e6 is one, 1.5 is not.

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
    # Beyond 2^53 a float does not say which whole number is meant.
    return int(number) if number.is_integer() and abs(number) <= 2**53 else None


def step_limit(task: Any, frequency: float) -> int:
    """Return the agent steps after which an episode times out: `task.time_limit` in steps, else `task.max_steps`.

    Args:
        task: the task's configuration.
        frequency: agent steps per second, Hz.
    """
    return int(task.max_steps if task.time_limit is None else round(task.time_limit * frequency))


def discount(algo: Any, frequency: float) -> float:
    """Return the discount per agent step: exp(-1/(frequency horizon)) if `algo.horizon_s` is set, else `algo.gamma`.

    A reward `horizon_s` seconds ahead then weighs 1/e at every frequency. The original study's 0.99 per step is a
    horizon of -1/(f ln 0.99): 9.95 s at 10 Hz, 1.81 s at 55 Hz.

    >>> from types import SimpleNamespace
    >>> round(discount(SimpleNamespace(gamma=0.5, horizon_s=9.95), 10.0), 5)
    0.99
    """
    horizon = algo.horizon_s
    return float(algo.gamma if horizon is None else math.exp(-1.0 / (frequency * horizon)))
