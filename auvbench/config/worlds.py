"""Define the schemas of the `world` group and the specs of the worlds.

Importing this module imports no code of a world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from auvbench.config.fields import below, choice_of, later, number, require
from auvbench.errors import ConfigError
from auvbench.registry import WORLDS, Spec


@dataclass(kw_only=True)
class World:
    """Key of every `world/*.yaml`."""

    solid: ClassVar[bool] = True
    """whether the world has a bottom or obstacles"""

    name: str = choice_of(lambda: WORLDS.own)

    @property
    def has_bottom(self) -> bool:
        """Whether the world has a bottom, which a DVL needs."""
        return self.solid

    def check(self) -> None:
        """Check rules that span several keys.

        Raises:
            ConfigError: a value contradicts another.
        """


@dataclass(kw_only=True)
class Open(World):
    """Open water without a bottom."""

    solid: ClassVar[bool] = False


@dataclass(kw_only=True)
class Solid(World):
    """Keys of every world with a bottom or obstacles."""

    seed: int | None = number(0, (1 << 32) - 1)
    vehicle_radius: float | None = number(0.01, 100.0)  # m
    near: float = number(0.0, 1000.0)  # m


@dataclass(kw_only=True)
class Tank(Solid):
    """A bottom and four walls."""

    length: float = number(1.0, 1e4)  # m
    width: float = number(1.0, 1e4)  # m
    depth: float | None = number(0.1, 1e4)  # m


@dataclass(kw_only=True)
class Slope(Solid):
    """A plane bottom."""

    depth: float | None = number(0.1, 1e4)  # m
    altitude: float = number(0.0, 1e4)  # m
    dip: float = number(0.0, 1.2)  # rad
    direction: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad


@dataclass(kw_only=True)
class Rough(Solid):
    """A fractal bottom."""

    depth: float | None = number(0.1, 1e4)  # m
    altitude: float = number(0.0, 1e4)  # m
    height: float = number(0.0, 100.0)  # m
    spacing: float = number(0.1, 100.0)  # m
    size: int = number(4, 1024)
    hurst: float = number(0.0, 1.0)


@dataclass(kw_only=True)
class Pipeline(Rough):
    """A pipeline on a bottom."""

    radius: float = number(0.01, 10.0)  # m
    burial: float = number(0.0, 1.0)
    sway: float = number(0.0, 100.0)  # m
    wave: float = number(1.0, 1e4)  # m
    beyond: float = number(0.0, 1000.0)  # m
    piece: float = number(0.1, 100.0)  # m


@dataclass(kw_only=True)
class BottomFile:
    """Keys of `world.bottom`: the file of a bottom, its digest and its origin."""

    file: str
    sha256: str
    origin: list[float] | None = None  # m


@dataclass(kw_only=True)
class Bottom(Solid):
    """A bottom from a file."""

    bottom: BottomFile

    def check(self) -> None:
        origin = self.bottom.origin
        fits = origin is None or (len(origin) == 2 and all(map(math.isfinite, origin)))
        require(fits, "world.bottom.origin", origin, "be two finite numbers [x, y] in m")


@dataclass(kw_only=True)
class Pillars(Solid):
    """Upright capsules on a circle round the goal."""

    count: int = number(1, 64)
    distance: float = number(0.1, 1000.0)  # m
    radius: float = number(0.01, 100.0)  # m
    length: float = number(0.01, 1e4)  # m
    turn: float | None = number(-2.0 * math.pi, 2.0 * math.pi)  # rad

    @property
    def has_bottom(self) -> bool:
        return False

    def check(self) -> None:
        apart = self.distance * math.sin(math.pi / self.count) if self.count > 1 else math.inf
        if self.radius > apart:
            raise ConfigError(
                f"world.radius={self.radius:g}: {self.count} pillars at world.distance={self.distance:g} m would overlap; must "
                f"be at most {apart:.3g} m"
            )


@dataclass(kw_only=True)
class Field(Solid):
    """Spheres, cylinders and boxes between start and goal."""

    density: float = number(0.0, 0.2, open_low=True)  # obstacles per m2
    radius_low: float = number(0.05, 50.0)  # m
    radius_high: float = number(0.05, 50.0)  # m
    gap: float = number(0.0, 100.0)  # m
    free: float = number(0.0, 1000.0)  # m
    margin: float = number(1.0, 1000.0)  # m
    moving: float = later(number(0.0, 1.0), 0.0)
    speed: float = later(number(0.0, 5.0, open_low=True), 0.2)  # m/s
    bottom_depth: float | None = later(number(0.1, 1e4))  # m

    @property
    def has_bottom(self) -> bool:
        return self.bottom_depth is not None

    def check(self) -> None:
        low, high = self.radius_low, self.radius_high
        below("world.radius_low", low, "world.radius_high", high)
        # Placing discs at random without overlap covers at most 0.547 of a plane (Feder, "Random sequential adsorption", 1980).
        room = math.pi * (0.5 * (low + high) + 0.5 * self.gap) ** 2
        most = 0.4 / room
        if self.density > most:
            raise ConfigError(
                f"world.density={self.density:g}: must be at most {most:.3g} obstacles per m2 with these radii and world.gap="
                f"{self.gap:g}, so that all obstacles fit"
            )


@dataclass(frozen=True, slots=True)
class WorldSpec(Spec):
    """Description of one value of `world.name`, available without importing its code."""

    base: ClassVar[type] = World

    name: str
    title: str
    """Short description for help and tables"""
    factory: str
    """`module:class`, a subclass of `auvbench.tasks.worlds.base.World`; empty for open water"""
    schema: type
    settled: str = ""
    """`module:function` that takes the composed configuration and its typed `world`. It returns the configuration with added values
    that are known only when a run is created, such as the digest of a file; empty: the world has no such values
    """


_CODE = "auvbench.tasks.worlds"
open_ = WorldSpec("open", "open water", "", Open)
tank = WorldSpec("tank", "tank with walls and bottom", f"{_CODE}.tank:TankWorld", Tank)
slope = WorldSpec("slope", "sloping bottom", f"{_CODE}.slope:SlopeWorld", Slope)
rough = WorldSpec("rough", "rough bottom", f"{_CODE}.rough:RoughWorld", Rough)
pipeline = WorldSpec("pipeline", "pipeline on a bottom", f"{_CODE}.pipeline:PipelineWorld", Pipeline)
bottom = WorldSpec(
    "bottom", "bottom from a file", f"{_CODE}.bottom:BottomWorld", Bottom, f"{_CODE}.bottom:settled"
)
pillars = WorldSpec("pillars", "pillars round the goal", f"{_CODE}.pillars:PillarsWorld", Pillars)
field_ = WorldSpec("field", "field of obstacles", f"{_CODE}.field:FieldWorld", Field)


def open_water() -> Open:
    """Return the schema of open water, for runs of earlier versions."""
    return Open(name="open")
