"""Protect one vehicle that a pilot steers (docs/safety.md)."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.filters import Barrier
from auvbench.config.worlds import Solid
from auvbench.dynamics.random import WORLD
from auvbench.registry import WORLDS, resolve
from auvbench.tasks.filters.barrier import BarrierFilter
from auvbench.tasks.filters.rows import CHANGED, INFEASIBLE
from auvbench.tasks.worlds.base import Episode
from auvbench.tasks.worlds.contact import HULL
from auvbench.tasks.worlds.surroundings import hull_of
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.worlds.casting import clearance
from auvbench.worlds.solids import NO_HEIGHTS, SOLID

Floats = NDArray[np.float64]

FAR = 1e6
"""Range of the search for the nearest solid, m; also the distance that is returned if no solid is within this range"""


class Protection:
    """Filter of the commands of one vehicle, with a known map.

    Args:
        settings: settings of the filter, which knows the map.
        vehicle: sheet of the vehicle.
        frequency: rate of the commands, Hz.
        depths: lowest and highest allowed z, m.
        world: world with the same solids in every episode; None: open water.

    Raises:
        ConfigError: the vehicle cannot brake in every direction, or the world cannot be read.
    """

    def __init__(
        self,
        settings: Barrier,
        vehicle: VehicleModel,
        frequency: float,
        depths: tuple[float, float],
        world: Solid | None = None,
    ) -> None:
        low, high = depths
        config: Any = SimpleNamespace(
            filter=settings,
            step=SimpleNamespace(frequency=frequency),
            task=SimpleNamespace(depth_low=low, depth_high=high),
            disturbance=SimpleNamespace(delay=SimpleNamespace(action=0.0, observation=0.0)),
        )
        unseen: Any = None  # a filter that knows the map reads no observation
        self._filter = BarrierFilter(config, vehicle, unseen, 1)
        self.name, self._margin, self._depths = settings.name, settings.margin, depths
        self._covers: Callable[[Floats], bool] = lambda point: True
        self._solids, self._heights, self._radius = np.zeros(0, SOLID), NO_HEIGHTS, 0.0
        hull = np.zeros(1, HULL)
        if world is not None:
            hull = hull_of(world, vehicle).view(np.ndarray)
            self._radius = float(hull["radius"][0] - hull["first"][0])
            kind = resolve(WORLDS[world.name].code)(world, low, self._radius)
            middle = np.array([*kind.middle, 0.5 * (low + high)])
            self._solids, _ = kind.draw(Episode(middle, middle, (0, WORLD, 0, 0)))
            self._heights, self._covers = kind.heights, kind.covers
        counts = np.array([len(self._solids)])
        self._around = np.zeros(1, np.int64), counts, self._solids[None], self._heights, hull
        # The first calls compile; a vehicle under power must not wait for the compiler.
        at_rest = np.array([0.0, 0.0, 0.5 * (low + high), 1.0, 0.0, 0.0, 0.0])
        self.protect(at_rest, np.zeros(6), np.zeros(len(vehicle.actuators)))
        self._room(at_rest[:3])
        self.begin()

    def begin(self) -> None:
        """Set the counts of changed and infeasible commands to 0."""
        self._filter.tallies[:] = 0.0

    @property
    def changed(self) -> int:
        """Number of commands that the filter has changed."""
        return int(self._filter.tallies[0, CHANGED])

    @property
    def infeasible(self) -> int:
        """Number of commands for which the thrusters were too weak to keep every limit."""
        return int(self._filter.tallies[0, INFEASIBLE])

    def refusal(self, point: Floats) -> str:
        """Return why a vehicle, at any heading, must not go to a point (3,) in m; '' if the vehicle may go there."""
        low, high = self._depths
        if not low + self._margin <= point[2] <= high - self._margin:
            return f"is nearer to a depth limit than the filter's margin of {self._margin:g} m"
        if not self._covers(point):
            return "is outside the grid of the bottom"
        room = self._room(point)
        return "" if room >= 0.0 else f"is {-room:.2g} m too near to a solid for the filter"

    def _room(self, point: Floats) -> float:
        """Return the distance in m, at the worst heading, from the hull to the margin round the nearest solid; negative in the margin."""
        distance, nearest, gradient = np.empty(1), np.empty(1, np.int64), np.empty((1, 3))
        clearance(self._solids, self._heights, 0.0, point[None], FAR, distance, nearest, gradient)
        return float(distance[0]) - self._radius - self._margin

    def protect(self, pose: Floats, velocity: Floats, action: Floats) -> Floats:
        """Return the command (n_u,) nearest to `action` that keeps the filter's constraints.

        Args:
            pose: (7,), as measured.
            velocity: (6,) over ground, body axes, as measured.
            action: (n_u,) in [-1, 1].
        """
        kept = np.array(action, dtype=np.float64)[None]
        unseen = np.zeros((1, 0), np.float32)
        self._filter.act(pose[None], velocity[None], kept, unseen, self._around, 0, 1)
        result: Floats = kept[0]
        return result
