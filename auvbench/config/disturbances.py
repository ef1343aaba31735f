"""Define the disturbances that every configuration has: schemas, specs, and the capabilities that a simulator needs.

Importing this module imports no code of a disturbance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from keyword import iskeyword
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from auvbench.config.fields import below, choice, number
from auvbench.errors import ConfigError
from auvbench.registry import Spec, owned, telling

if TYPE_CHECKING:
    from auvbench.config import schema
    from auvbench.config.simulators import Capabilities

CURRENTS = ("none", "steady", "varying", "sheared")
"""Kinds of current: none, constant in an episode, varying during an episode, and varying with depth. A simulator that
supports one kind also supports all kinds before it.
"""

FASTEST_WATER = 10.0
"""largest speed of the current at any depth, m/s"""

RESERVED = ("name", "factors", "active")
"""names that no disturbance may have, since they are attributes of `schema.Disturbance`"""

READINGS = "readings"
TIMING = "timing"
COMMANDS = "commands"
"""What a disturbance may change between the agent and the vehicle: sensor readings, the times of readings and actions, and
the commands of actuators
"""


class Need(NamedTuple):
    """One capability that a simulator must have for a disturbance."""

    key: str
    what: str
    able: Callable[[Capabilities], bool]


@dataclass(kw_only=True)
class Factor:
    """Keys of one disturbance below `disturbance.NAME`, and properties that depend on these keys."""

    @property
    def active(self) -> bool:
        """Whether the disturbance changes anything."""
        return True

    def check(self, key: str) -> None:
        """Check rules that span several keys.

        Args:
            key: `disturbance.NAME`, for messages.

        Raises:
            ConfigError: a value contradicts another.
        """

    def needs(self, key: str) -> Iterator[Need]:
        """Yield the capabilities that a simulator must have for the disturbance."""
        return iter(())

    def alters(self) -> Mapping[str, str]:
        """Return which of READINGS, TIMING and COMMANDS the disturbance changes, each with the cause.

        The cause is the text that messages append to `disturbance.NAME`, for example `.mode=stuck`; '' names the whole
        disturbance.
        """
        return {}


def forces(key: str) -> Need:
    """Return the need for a simulator that can apply external forces to its vehicles."""
    return Need(key, "forces on vehicles", lambda can: can.forces)


@dataclass(kw_only=True)
class GaussMarkov:
    """First-order Gauss-Markov fluctuation of the current about its mean."""

    sigma: float = number(0.0, 10.0)  # m/s, stationary standard deviation of the east and the north component
    sigma_vertical: float = number(0.0, 10.0)  # m/s, stationary standard deviation of the vertical component
    mu: float = number(0.0, 1e3, open_low=True)  # 1/s, inverse of the correlation time


@dataclass(kw_only=True)
class CurrentProfile:
    """Mean current as a function of depth: linear between two depths, constant above and below them."""

    top: float = number(0.0, 1e4)  # m, positive down
    bottom: float = number(0.0, 1e4, open_low=True)  # m, positive down
    factor: float = number(-3.0, 3.0)  # speed at `bottom` over speed at `top`; undercurrents reach about 3
    turn: float = number(-math.pi, math.pi)  # rad, direction at `bottom` minus direction at `top`


@dataclass(kw_only=True)
class Current(Factor):
    """Motion of the water."""

    speed: float = number(0.0, 10.0)  # m/s
    speed_high: float | None = number(0.0, 10.0)  # m/s
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    elevation: float = number(-math.pi / 2, math.pi / 2)  # rad
    gauss_markov: GaussMarkov
    profile: CurrentProfile

    @property
    def fluctuates(self) -> bool:
        """Whether the current varies within an episode."""
        return self.gauss_markov.sigma > 0.0 or self.gauss_markov.sigma_vertical > 0.0

    @property
    def flows(self) -> bool:
        """Whether the mean current may differ from 0."""
        return (self.speed_high or self.speed) > 0.0

    @property
    def active(self) -> bool:
        return self.flows or self.fluctuates

    @property
    def sheared(self) -> bool:
        """Whether the current changes with depth."""
        return self.active and (self.profile.factor != 1.0 or self.profile.turn != 0.0)

    def check(self, key: str) -> None:
        below(f"{key}.speed", self.speed, f"{key}.speed_high", self.speed_high)
        top, bottom = self.profile.top, self.profile.bottom
        below(f"{key}.profile.top", top, f"{key}.profile.bottom", bottom, strictly=True)
        fastest, factor = max(self.speed, self.speed_high or 0.0), self.profile.factor
        if fastest * abs(factor) > FASTEST_WATER:
            raise ConfigError(
                f"{key}.profile.factor={factor:.12g}: gives a current of {fastest * abs(factor):g} m/s at the bottom; must give at "
                f"most {FASTEST_WATER:g} m/s"
            )

    def needs(self, key: str) -> Iterator[Need]:
        kind, part = "steady", "speed"
        if self.sheared:
            kind, part = "sheared", "profile"
        elif self.fluctuates:
            kind, part = "varying", "gauss_markov"
        least = CURRENTS.index(kind)
        yield Need(f"{key}.{part}", f"a {kind} current", lambda can: CURRENTS.index(can.currents) >= least)


@dataclass(kw_only=True)
class Waves(Factor):
    """Waves on deep water."""

    height: float = number(0.0, 30.0)  # m, significant wave height
    period: float = number(0.5, 30.0)  # s, peak period of the spectrum
    spectrum: str = choice("jonswap", "pierson_moskowitz")
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad
    spreading: float | None = number(1.0, 1000.0)  # exponent n of cos^n

    @property
    def active(self) -> bool:
        return self.height > 0.0

    def check(self, key: str) -> None:
        # Shortest period by DNV-RP-C205, section 3.5.5: with a shorter period, waves of this height would break.
        least = 3.6 * math.sqrt(self.height)
        if self.active and self.period < least:
            raise ConfigError(
                f"{key}.period={self.period:.12g}: must be at least {least:.3g} s for {key}.height={self.height:g}: "
                "steeper waves break"
            )

    def needs(self, key: str) -> Iterator[Need]:
        yield Need(f"{key}.height={self.height:g}", "waves", lambda can: can.waves)


def still() -> Waves:
    """Return the schema that means no waves, for runs of earlier versions."""
    return Waves(height=0.0, period=7.5, spectrum="jonswap", direction=None, spreading=2.0)


@dataclass(kw_only=True)
class Fault(Factor):
    """Failure of one actuator in an episode."""

    mode: str = choice("none", "dead", "weak", "stuck", "any")
    probability: float = number(0.0, 1.0)  # probability per episode
    actuator: str | None
    time: float = number(0.0, 1e9)  # s
    time_high: float | None = number(0.0, 1e9)  # s
    factor: float = number(0.0, 1.0)  # force of a weak thruster, relative to its force without the fault

    @property
    def active(self) -> bool:
        return self.mode != "none" and self.probability > 0.0

    def check(self, key: str) -> None:
        below(f"{key}.time", self.time, f"{key}.time_high", self.time_high)

    def alters(self) -> Mapping[str, str]:
        return {COMMANDS: f".mode={self.mode}"} if self.mode in ("stuck", "any") else {}


@dataclass(kw_only=True)
class Delay(Factor):
    """Dead times between the agent and the vehicle."""

    action: float = number(0.0, 10.0)  # s
    observation: float = number(0.0, 10.0)  # s

    @property
    def active(self) -> bool:
        return self.action > 0.0 or self.observation > 0.0

    def alters(self) -> Mapping[str, str]:
        return {TIMING: ""}


@dataclass(kw_only=True)
class Channels:
    """One number for each of the sensor readings x, y, z and yaw."""

    x: float = number(0.0, 1e3)
    y: float = number(0.0, 1e3)
    z: float = number(0.0, 1e3)
    yaw: float = number(0.0, 1e3)

    def values(self) -> list[float]:
        """Return the numbers for x, y, z and yaw."""
        return [self.x, self.y, self.z, self.yaw]


@dataclass(kw_only=True)
class Sensor(Factor):
    """Errors of the position and yaw readings, in addition to `noise`."""

    gaussian: Channels  # m and rad, standard deviation
    bias: Channels  # m and rad, standard deviation over episodes
    drift: Channels  # m/sqrt(s) and rad/sqrt(s)

    @property
    def active(self) -> bool:
        return any(value > 0.0 for part in (self.gaussian, self.bias, self.drift) for value in part.values())

    def alters(self) -> Mapping[str, str]:
        return {READINGS: ""}


@dataclass(kw_only=True)
class Scale:
    """Range of one random factor."""

    low: float = number(0.01, 100.0)
    high: float = number(0.01, 100.0)


SCALES = ("mass", "buoyancy", "inertia", "added_mass", "damping", "thrust")
"""Factors of `Randomisation`, in the order of the columns of a simulator's `reset(scales=...)`"""


@dataclass(kw_only=True)
class Randomisation(Factor):
    """Random vehicle in each episode: random factors multiply the numbers of the vehicle's sheet."""

    distribution: str = choice("uniform", "log_uniform")
    keep_trim: bool
    mass: Scale
    buoyancy: Scale
    inertia: Scale
    added_mass: Scale
    damping: Scale
    thrust: Scale

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Return the ranges of all factors by name, in the order of `SCALES`."""
        scales: list[tuple[str, Scale]] = [(name, getattr(self, name)) for name in SCALES]
        return {name: (scale.low, scale.high) for name, scale in scales}

    @property
    def active(self) -> bool:
        return any(ends != (1.0, 1.0) for ends in self.ranges().values())

    def check(self, key: str) -> None:
        for name, (low, high) in self.ranges().items():
            below(f"{key}.{name}.low", low, f"{key}.{name}.high", high)

    def needs(self, key: str) -> Iterator[Need]:
        name = next(name for name, ends in self.ranges().items() if ends != (1.0, 1.0))
        yield Need(
            f"{key}.{name}", "drawn vehicles (factors that differ from the sheet)", lambda can: can.scales
        )


@dataclass(kw_only=True)
class DisturbanceConfig(Factor):
    """Keys of a disturbance of an installed package, `disturbance.NAME`; a subclass adds its own keys."""

    package: str


def asking(name: str, factor: Factor, what: str) -> AbstractContextManager[None]:
    """Return a context that turns an exception of a package's disturbance into an error that names the package."""
    if isinstance(factor, DisturbanceConfig):
        return telling(owned(f"disturbance.{name}", factor), f"{what} fails")
    return nullcontext()


def needs(disturbance: schema.Disturbance) -> Iterator[Need]:
    """Yield the capabilities that a simulator must have for the active disturbances."""
    for name, factor in disturbance.active():
        with asking(name, factor, "needs"):
            own = list(factor.needs(f"disturbance.{name}"))
        yield from own


def alterations(disturbance: schema.Disturbance) -> Iterator[tuple[str, str, str]]:
    """Yield what the active disturbances change, as tuples of three texts.

    The texts are the name of the disturbance; READINGS, TIMING or COMMANDS; and the cause of the change (see
    `Factor.alters`).
    """
    for name, factor in disturbance.active():
        with asking(name, factor, "alters"):
            own = dict(factor.alters())
        for altered, part in own.items():
            yield name, altered, part


@dataclass(frozen=True, slots=True)
class DisturbanceSpec(Spec):
    """Description of one disturbance, available without importing its code."""

    base: ClassVar[type] = DisturbanceConfig

    name: str
    """Key below `disturbance`."""
    title: str
    """Short description for tables and help."""
    factory: str
    """`module:class`, a subclass of `auvbench.tasks.disturbances.base.Disturbance`."""
    schema: type
    """Dataclass of the disturbance's keys; in a package, derived from `DisturbanceConfig`."""
    added: bool = False
    """Whether runs of earlier versions lack the disturbance's keys. If so, a fingerprint includes these keys only if the
    disturbance is active.
    """

    def fault(self) -> str:
        good = self.name.isidentifier() and not iskeyword(self.name) and self.name not in RESERVED
        return (
            ""
            if good
            else "has an invalid name; must be a Python identifier other than a keyword, name, factors or active"
        )


_CODE = "auvbench.tasks.disturbances"
current = DisturbanceSpec("current", "current", f"{_CODE}.current:WaterCurrent", Current)
waves = DisturbanceSpec("waves", "waves", f"{_CODE}.waves:Sea", Waves, added=True)
fault = DisturbanceSpec("fault", "actuator faults", f"{_CODE}.fault:ActuatorFault", Fault)
delay = DisturbanceSpec("delay", "delays", f"{_CODE}.delay:DeadTime", Delay)
sensor = DisturbanceSpec("sensor", "sensor errors", f"{_CODE}.sensor:SensorError", Sensor)
randomisation = DisturbanceSpec(
    "randomisation", "drawn vehicles", f"{_CODE}.randomisation:DrawnVehicles", Randomisation
)
