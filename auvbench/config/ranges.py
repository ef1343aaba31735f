"""Define the schemas of range sensors (`task.range.NAME`); `tasks/ranges/specs.py` defines the blocks of these sensors."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from auvbench.config.fields import below, number
from auvbench.errors import ConfigError

SOUND = 1500.0
"""Speed of sound in water, m/s"""
GRADIANS = 400
"""Number of gradians in a full turn; a Ping360 rotates in steps of whole gradians"""
PREFIX = "range."
"""Prefix of the names of range sensors' blocks; the block `range.ping1d` has its keys in `task.range.ping1d`"""

# Time of one beam of a Ping360: `BEAM_REST + BEAM_PER_METRE * range + BEAM_PER_GRADIAN * step`. Least squares over the six turn times
# that users measured (Blue Robotics forum, thread 8328: ranges of 2, 20 and 50 m in steps of 1 and 10 gradians).
BEAM_REST = 0.0178  # s
BEAM_PER_METRE = 0.00141  # s/m, of which the sound's way there and back takes 0.00133
BEAM_PER_GRADIAN = 0.006  # s


@dataclass(kw_only=True)
class Sensor:
    """Keys of every range sensor."""

    high: float = number(0.1, 1000.0)  # m
    noise: float = number(0.0, 100.0)  # m
    dropout: float = number(0.0, 1.0)
    yaw: float = number(-math.pi, math.pi)  # rad
    pitch: float = number(-math.pi / 2, math.pi / 2)  # rad

    def check(self, prefix: str) -> None:
        """Check rules that span several keys.

        Args:
            prefix: prefix of the keys in messages.

        Raises:
            ConfigError: a value contradicts another.
        """


@dataclass(kw_only=True)
class Ideal(Sensor):
    """An ideal range sensor: a fan of rays."""

    columns: int = number(1, 64)
    rows: int = number(1, 64)
    horizontal: float = number(0.0, 2.0 * math.pi)  # rad
    vertical: float = number(0.0, math.pi)  # rad


@dataclass(kw_only=True)
class Pinged(Sensor):
    """Keys of sensors that send pings."""

    low: float = number(0.0, 100.0)  # m
    rate: float = number(0.1, 1000.0)  # Hz
    delay: float = number(0.0, 10.0)  # s

    def check(self, prefix: str) -> None:
        check_low(self, prefix)
        fastest = 0.5 * SOUND / self.high
        if self.rate > fastest:
            raise ConfigError(
                f"{prefix}rate={self.rate:g}: must be at most {fastest:.3g} Hz with {prefix}high={self.high:g}, since sound takes "
                f"{2.0 * self.high / SOUND:.3g} s there and back"
            )


@dataclass(kw_only=True)
class Ping1D(Pinged):
    """An echo sounder."""

    beam: float = number(0.0, math.pi)  # rad
    jumps: float = number(0.0, 0.05)

    def check(self, prefix: str) -> None:
        # The rate is not limited by `high`, since an echo sounder sends the next ping as soon as it has an echo.
        check_low(self, prefix)


@dataclass(kw_only=True)
class Ping360(Sensor):
    """A scanning sonar."""

    low: float = number(0.0, 100.0)  # m
    delay: float = number(0.0, 10.0)  # s
    beam: float = number(0.0, math.pi)  # rad
    step: int = number(1, 100)  # gradians
    span: int = number(1, GRADIANS)  # gradians
    sectors: int = number(1, GRADIANS)

    @property
    def beams(self) -> int:
        """Number of beams of a scan over `span`."""
        return max(1, self.span // self.step)

    @property
    def beam_time(self) -> float:
        """Time of a beam in s."""
        return BEAM_REST + BEAM_PER_METRE * self.high + BEAM_PER_GRADIAN * self.step

    def check(self, prefix: str) -> None:
        check_low(self, prefix)
        if self.sectors > self.beams:
            raise ConfigError(
                f"{prefix}sectors={self.sectors}: must be at most {self.beams}, the number of beams of {prefix}step={self.step} in "
                f"{prefix}span={self.span}"
            )


@dataclass(kw_only=True)
class Multibeam(Pinged):
    """A multibeam sonar."""

    beams: int = number(1, 512)
    horizontal: float = number(0.0, math.pi)  # rad
    vertical: float = number(0.0, math.pi)  # rad


def check_low(sensor: Any, prefix: str) -> None:
    """Raise ConfigError unless the smallest range is below the largest."""
    below(f"{prefix}low", sensor.low, f"{prefix}high", sensor.high, strictly=True)


@dataclass(kw_only=True)
class Ranges:
    """Keys of `task.range`: one group of keys for each range sensor, None for a sensor that is not observed."""

    ideal: Ideal | None = None
    ping1d: Ping1D | None = None
    ping360: Ping360 | None = None
    multibeam: Multibeam | None = None


NAMES = tuple(field.name for field in fields(Ranges))


def key_of(block: str) -> str:
    """Return the key below `task.range` that configures a block's range sensor; '' for a block without a range sensor."""
    name = block.removeprefix(PREFIX)
    return name if block.startswith(PREFIX) and name in NAMES else ""


def oldest(sensor: Pinged) -> float:
    """Return the largest age in s that an observation reports for a reading; an older reading is reported with this age."""
    return 1.0 / sensor.rate + sensor.delay + 1.0
