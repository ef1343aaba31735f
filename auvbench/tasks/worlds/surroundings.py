"""The solids of N episodes."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, tasks
from auvbench.config.worlds import Solid
from auvbench.errors import ConfigError
from auvbench.registry import WORLDS, resolve
from auvbench.tasks.worlds.base import Episode, World, key_of
from auvbench.tasks.worlds.contact import FIELDS, HULL
from auvbench.vehicles.vehicle_model import VehicleModel
from auvbench.worlds.casting import clearance
from auvbench.worlds.kinds import KINDS
from auvbench.worlds.outlines import outlines
from auvbench.worlds.routes import CORNERS, route
from auvbench.worlds.solids import SOLID

if TYPE_CHECKING:
    from auvbench.tasks.base import Task

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
FAR = 1e6
"""Range of the search for the nearest solid, m; also the clearance if no solid is within this range"""
SIDE = 8.0
"""Margin round start and goal within which the shortest way is searched, m, for worlds without a key `margin`"""
WAY = (("way", "f8", (CORNERS, 3)), ("way_corners", "i8"))
"""Fields of an episode whose shortest way is observed: corners in m and their number"""


class Surroundings:
    """The world of each of N episodes.

    Args:
        config: configuration with a world that has solids.
        vehicle: vehicle of all episodes.
        n: number of episodes.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel, n: int) -> None:
        self.settings = config.world
        self.hull = hull_of(config.world, vehicle)
        """Hull of the vehicle, a record (1,) of HULL"""
        kind = resolve(WORLDS[self.settings.name].code)
        # A way must be wide enough for the vehicle at any heading.
        self.radius = float(self.hull["radius"][0] - self.hull["first"][0])
        self.world: World = kind(self.settings, config.task.depth_low, self.radius)
        self.solids = np.zeros((n, self.world.most), SOLID)
        """Solids (n, most); in each row, only the first `episodes.solids` records are in use"""
        self.heights = self.world.heights
        self.has_ways = "way" in tasks.blocks(config.task)
        """whether the observation shows the shortest way"""
        self.way = WAY if self.has_ways else ()
        """Fields of an episode that store the shortest way"""
        own = ((name, "f8") for name in self.world.fields)
        self.fields = (*FIELDS, *own, *self.way)
        """Fields of an episode in addition to `records.EPISODE`"""

    @property
    def loops(self) -> tuple[Any, ...]:
        """Return the arguments that a world adds to the loop over steps, after all other arguments."""
        return self.solids, self.heights, self.hull

    def draw(self, task: Task, indices: Integers) -> None:
        """Draw the worlds of episodes that have a start and a goal.

        Raises:
            ConfigError: a start or a goal is not in the water, or a world cannot be drawn.
        """
        for i in indices.tolist():
            e = task.episodes[i]
            own = int(e.seed), task.stream, int(e.episode), int(e.environment)
            line = task.line(i) if self.world.follows else None
            episode = Episode(np.array(e.start), task.goal(i), key_of(self.settings.seed, own), line)
            solids, remembered = self.world.draw(episode)
            self.solids[i, : len(solids)] = solids
            e.solids, e.contact, e.near_time = len(solids), 0, 0.0
            for name, value in remembered.items():
                setattr(e, name, value)
            e.clearance = self._check(i, len(solids), episode, float(e.start_yaw))
            if self.has_ways:
                self._find_way(i, e, episode)

    def _find_way(self, i: int, e: Any, episode: Episode) -> None:
        """Write the shortest way of an episode with solids to the episode's fields.

        Raises:
            ConfigError: no way leads to the goal.
        """
        start, goal = ((float(x), float(y), float(z)) for x, y, z in (episode.start, episode.goal))
        side = float(getattr(self.settings, "margin", SIDE))
        solids = self.solids[i, : e.solids]
        e.way_corners = route(solids, self.heights, start, goal, self.radius, side, e.way)
        if not e.way_corners:
            raise ConfigError(
                f"task.observation: way: no way for a vehicle of {self.radius:.2g} m radius leads from the start to the goal in "
                f"world={self.settings.name}; change keys of world or task"
            )

    def _check(self, i: int, count: int, episode: Episode, yaw: float) -> float:
        """Return the clearance of the start in m.

        Raises:
            ConfigError: the start or the goal is not in the water.
        """
        hull = self.hull[0]
        ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        spheres = episode.start + np.outer(hull.first + hull.spacing * np.arange(hull.count), ahead)
        room = self._distances(i, count, np.array([*spheres, episode.goal])) - [
            *[hull.radius] * hull.count,
            0.0,
        ]
        for what, point, free in (
            ("start", episode.start, room[:-1].min()),
            ("goal", episode.goal, room[-1]),
        ):
            if free <= 0.0:
                x, y, z = point
                radius = f" with a vehicle of {self.radius:.2g} m radius" if what == "start" else ""
                raise ConfigError(
                    f"world={self.settings.name}: a {what} at ({x:.1f}, {y:.1f}, {z:.1f}) m is {self.world.inside}{radius}, by "
                    f"{-free:.2g} m; change keys of world or task"
                )
        return float(room[:-1].min())

    def _distances(self, i: int, count: int, points: Floats) -> Floats:
        distances, nearest = np.empty(len(points)), np.empty(len(points), np.int64)
        scene = self.solids[i, :count]
        clearance(scene, self.heights, 0.0, points, FAR, distances, nearest, np.empty((len(points), 3)))
        return distances

    @property
    def moves(self) -> bool:
        """Whether solids move."""
        return bool(getattr(self.settings, "moving", 0.0) > 0.0)

    def outlines(self, i: int, count: int, low: Floats, high: Floats, time: float) -> Floats:
        """Return segments (k, 2, 3) in m that draw episode i's solids `time` s after its start, in a box with corners `low` and `high`."""
        return outlines(self.solids[i, :count], self.heights, low, high, time)

    def name(self, i: int, count: int) -> str:
        """Return the name of the world of episode i: two worlds with the same solids have the same name."""
        # Rounded to a nanometre, because the last bit may differ between machines.
        columns = [
            np.round(np.asarray(self.solids[i, :count][name], float), 9) + 0.0 for name in SOLID.names or ()
        ]
        digest = hashlib.sha256(b"".join(column.tobytes() for column in columns))
        digest.update(self.world.fingerprint or np.round(self.heights, 9).tobytes())
        return f"{self.settings.name}-{digest.hexdigest()[:8]}"

    def columns(self, e: Any, i: int) -> dict[str, Any]:
        """Return the columns that the world adds to the record of episode i after its end; `e` is the row of the episode."""
        hit = self.solids[i, e.contact - 1]["kind"] if e.contact else None
        return {
            "world": self.name(i, int(e.solids)),
            "hit": "" if hit is None else KINDS[int(hit)],
            "clearance_min_m": float(e.clearance),
            "near_time_s": float(e.near_time),
            **{name: float(getattr(e, name)) for name in self.world.fields},
        }

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that an exact resume needs, as arrays of floats."""
        return {"solids": self.solids.view(np.float64)}


def hull_of(world: Solid, vehicle: VehicleModel) -> Any:
    """Return the hull of a vehicle as a record (1,) of HULL: spheres in a row along the vehicle's x axis."""
    radius, length = vehicle.hull if world.vehicle_radius is None else (world.vehicle_radius, 0.0)
    count = 1 + int(np.ceil(length / radius))
    hull = np.zeros(1, HULL)
    hull["radius"], hull["near"], hull["count"] = radius, world.near, count
    hull["first"], hull["spacing"] = -0.5 * length, length / max(count - 1, 1)
    return hull.view(np.recarray)
