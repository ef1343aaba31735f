"""Define the schema of the configuration: types and valid ranges, no defaults.

Defaults, and the comments that explain them, are only in the YAML files in `conf/`.
`validate.validate_fields` checks a field's range; OmegaConf checks its type while Hydra composes.
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
    """Return a field with the range [low, high], or (low, high] with `open_low`; infinities and NaN are never
    valid.
    """
    return field(metadata={"low": low, "high": high, "open_low": open_low})


def choice(*names: str) -> Any:
    """Return a field that takes one of a few names."""
    return choice_of(lambda: names)


def choice_of(names: Callable[[], Collection[str]]) -> Any:
    """Return a field that takes a name of a registry; the registry is read when a value is checked."""
    return field(metadata={"choices": names})


def later(declared: Any, default: Any = None) -> Any:
    """Return a field that is missing in runs of earlier versions; they load with `default`, which changes nothing."""
    return field(default=default, metadata=declared.metadata)


def name() -> Any:
    """Return a field for a part of a path: letters, digits, dots, dashes and underscores."""
    return field(metadata={"name": True})


def keys(kind: type, prefix: str = "") -> dict[str, Any]:
    """Return the dotted keys of a schema and of its nested schemas, with their types."""
    types = {}
    for key, hint in get_type_hints(kind).items():
        types[f"{prefix}{key}"] = hint
        for kind in (hint, *get_args(hint)):  # A nested schema may be null.
            if isinstance(kind, type) and is_dataclass(kind):
                types |= keys(kind, f"{prefix}{key}.")
    return types


@dataclass(kw_only=True)
class Step:
    """Rate of the agent's steps."""

    frequency: float = number(0.0, 1000.0, open_low=True)  # Hz


@dataclass(kw_only=True)
class Range:
    """Amplitude of uniform noise."""

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
class GaussMarkov:
    """First-order Gauss-Markov fluctuation of the current about its mean."""

    sigma: float = number(0.0, 10.0)  # m/s, stationary standard deviation of the east and the north component
    sigma_vertical: float = number(0.0, 10.0)  # m/s, stationary standard deviation of the vertical component
    mu: float = number(0.0, 1e3, open_low=True)  # 1/s, inverse of the correlation time


@dataclass(kw_only=True)
class CurrentProfile:
    """Mean current over depth: linear between two depths, constant above and below."""

    top: float = number(0.0, 1e4)  # m, positive down
    bottom: float = number(0.0, 1e4, open_low=True)  # m, positive down
    factor: float = number(-3.0, 3.0)  # speed at `bottom` over speed at `top`; undercurrents reach about 3
    turn: float = number(-math.pi, math.pi)  # rad, direction at `bottom` less direction at `top`


@dataclass(kw_only=True)
class Current:
    """Motion of the water."""

    speed: float = number(0.0, 10.0)  # m/s
    speed_high: float | None = number(0.0, 10.0)  # m/s
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    elevation: float = number(-math.pi / 2, math.pi / 2)  # rad
    gauss_markov: GaussMarkov
    profile: CurrentProfile


@dataclass(kw_only=True)
class Waves:
    """Waves on deep water."""

    height: float = number(0.0, 30.0)  # m, significant wave height
    period: float = number(0.5, 30.0)  # s, peak period of the spectrum
    spectrum: str = choice("jonswap", "pierson_moskowitz")
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    spreading: float | None = number(1.0, 1000.0)  # exponent n of cos^n


def _still() -> Waves:
    """Return no waves, as in runs of earlier versions."""
    return Waves(height=0.0, period=7.5, spectrum="jonswap", direction=None, spreading=2.0)


@dataclass(kw_only=True)
class Fault:
    """Failure of one actuator in an episode."""

    mode: str = choice("none", "dead", "weak", "stuck", "any")
    probability: float = number(0.0, 1.0)  # probability per episode
    actuator: str | None
    time: float = number(0.0, 1e9)  # s
    time_high: float | None = number(0.0, 1e9)  # s
    factor: float = number(0.0, 1.0)  # share of its force that a weak thruster keeps


@dataclass(kw_only=True)
class Delay:
    """Dead times between the agent and the vehicle."""

    action: float = number(0.0, 10.0)  # s
    observation: float = number(0.0, 10.0)  # s


@dataclass(kw_only=True)
class Channels:
    """One number per sensor reading."""

    x: float = number(0.0, 1e3)
    y: float = number(0.0, 1e3)
    z: float = number(0.0, 1e3)
    yaw: float = number(0.0, 1e3)


@dataclass(kw_only=True)
class Sensor:
    """Errors of the position and yaw readings, in addition to `noise`."""

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
    """Randomised vehicle in each episode: factors on the numbers of its sheet."""

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
    """Disturbances of an episode: water, actuators, sensors, and the uncertainty of the sheet."""

    name: str = name()
    current: Current
    waves: Waves = field(default_factory=_still)
    fault: Fault
    delay: Delay
    sensor: Sensor
    randomisation: Randomisation

    @property
    def sea(self) -> Waves | None:
        """Return the waves; None for still water."""
        return self.waves if self.waves.height > 0.0 else None


@dataclass(kw_only=True)
class Checkpoint:
    """How often a run is saved; has no effect on its result."""

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

    # The only default in code: an entry of a list has no YAML file of its own.
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
    """Primary analysis that an experiment declares before its runs; has no effect on a result."""

    measure: str = choice_of(lambda: (PRIMARY, *measure_names()))
    baseline: str | None
    margin: float | None = number(0.0, open_low=True)  # unit of the measure, percentage points for a rate
    seeds: int | None = number(1, 1_000_000)
    protocol: str = later(name(), "test")
    # conditions of the protocol, the verdicts are about the first; null: all of the protocol
    conditions: list[str] | None = None
    episodes: int | None = later(number(1, 1_000_000))  # episodes of a condition; null: as the protocol says


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


def whole(text: str) -> int | None:
    """Return the whole number that a text stands for, e.g. 1e6; None for 1.5.

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
    """Return the agent steps after which an episode times out: `task.time_limit` in steps, else `task.max_steps`.

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
