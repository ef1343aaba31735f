"""Obstacles (spheres, cylinders and boxes) round start and goal, with a free way between the obstacles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from auvbench.errors import ConfigError
from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds.kinds import Floats, Solids
from auvbench.worlds.passage import scatter, shortest_way
from auvbench.worlds.solids import box, cylinder, none, plane, sphere

MOST = 256
"""Largest number of obstacles"""
TRIES = 20
"""Largest number of fields that are drawn until the vehicle can pass a field"""
SIZES = 10_000
"""Number of the first block of draws for the obstacles' kinds and heights; blocks with smaller numbers are for the obstacles' places"""
MOTIONS = SIZES + MOST
"""Number of the first block of draws for the obstacles' motions"""


class FieldWorld(World):
    """Field of obstacles. The field is drawn again until, seen from above, the vehicle can pass between the obstacles."""

    most = MOST + 1
    inside = "inside an obstacle or the bottom"
    fields = ("way_ratio", "way_clearance_m")  # numbers of the shortest way from start to goal

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        s = self.settings
        along = episode.goal - episode.start
        distance = math.hypot(along[0], along[1])
        area = (distance + 2.0 * s.margin) * 2.0 * s.margin
        count = round(s.density * area)
        if count > MOST:
            raise ConfigError(
                f"world.density={s.density:g}: gives {count} obstacles in an arena of {area:.0f} m2; must be at most {MOST / area:.3g}, or "
                f"reduce world.margin"
            )
        for attempt in range(TRIES):
            arena, radii = (distance, s.margin), (s.radius_low, s.radius_high)
            discs = scatter(episode.key, attempt, count, arena, radii, s.gap, s.free + self.radius)
            length, room = shortest_way(discs, self.radius, distance, s.margin)
            if math.isfinite(length):
                # The map moves start and goal to the middle of a cell, so that the way's length may be less than the true distance.
                ratio = max(1.0, length / distance) if distance > 0.0 else 1.0
                solids = [self._obstacle(k, disc, episode) for k, disc in enumerate(discs)]
                for k in range(len(solids)) if s.moving > 0.0 else ():
                    self._move(solids[k], *episode.draws(MOTIONS + k)[:2])
                if s.bottom_depth is not None:
                    solids.append(plane([0.0, 0.0, -s.bottom_depth], [0.0, 0.0, 1.0]))
                return np.concatenate([none(), *solids]), {"way_ratio": ratio, "way_clearance_m": room}
        raise ConfigError(
            f"world.density={s.density:g}: no vehicle with a radius of {self.radius:.2g} m can pass any of {TRIES} fields; reduce "
            "world.density or raise world.gap"
        )

    def _move(self, obstacle: Solids, share: float, bearing: float) -> None:
        """Give an obstacle (1,) a horizontal velocity if the draw `share` in (0, 1) is below the fraction of moving obstacles."""
        if share < self.settings.moving:
            angle = 2.0 * math.pi * bearing
            obstacle["velocity"] = (
                self.settings.speed * math.cos(angle),
                self.settings.speed * math.sin(angle),
                0.0,
            )

    def _obstacle(self, k: int, disc: Floats, episode: Episode) -> Any:
        """Return obstacle k (1,): a cylinder over all depths, or a sphere or box near the depths of start and goal."""
        kind, height, turn, shape = episode.draws(SIZES + k)
        x, y, radius = disc.tolist()
        along = episode.goal[:2] - episode.start[:2]
        course = math.atan2(along[1], along[0]) if along.any() else 0.0
        east = episode.start[0] + x * math.cos(course) - y * math.sin(course)
        north = episode.start[1] + x * math.sin(course) + y * math.cos(course)
        low, high = sorted((episode.start[2], episode.goal[2]))
        z = low + height * (high - low) + (turn - 0.5) * radius
        if kind < 1.0 / 3.0:
            return cylinder([east, north, 0.5 * self.depth_low], [0.0, 0.0, 1.0], -self.depth_low, radius)
        if kind < 2.0 / 3.0:
            return sphere([east, north, z], radius)
        # Seen from above, the diagonal of the box is the diameter of its disc.
        angle, yaw = (0.15 + 0.7 * shape) * 0.5 * math.pi, 2.0 * math.pi * turn
        sides = [2.0 * radius * math.cos(angle), 2.0 * radius * math.sin(angle), 2.0 * radius]
        axes = [[math.cos(yaw), math.sin(yaw), 0.0], [-math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
        return box([east, north, z], sides, axes)
