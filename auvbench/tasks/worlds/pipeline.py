"""A pipeline on a rough or flat bottom, below the task's path; in tasks without a path, from the start to the goal and beyond."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from auvbench.errors import ConfigError
from auvbench.tasks.worlds.base import Episode
from auvbench.tasks.worlds.rough import RoughWorld
from auvbench.worlds.casting import cast
from auvbench.worlds.kinds import Floats, Solids
from auvbench.worlds.solids import capsule

MOST = 256
"""Largest number of pieces of the pipe"""
FINE = 0.5
"""Distance between the points of a course before the course is cut into pieces, m"""


class PipelineWorld(RoughWorld):
    """Pipe on the bottom: a chain of capsules between points of the bottom.

    Between two such points, the pipe is straight: it spans hollows and cuts into hills.
    """

    most = 1 + MOST
    inside = "inside the bottom or the pipe"
    follows: ClassVar[bool] = True

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        (bottom, remembered), s = super().draw(episode), self.settings
        course = self._course(episode)
        length = np.concatenate([[0.0], np.hypot(*np.diff(course, axis=0).T).cumsum()])
        pieces = math.ceil(length[-1] / s.piece)
        if pieces > MOST:
            raise ConfigError(
                f"world.piece={s.piece:g}: the pipe of {length[-1]:.0f} m would have {pieces} pieces; must be at least "
                f"{length[-1] / MOST:.3g} m"
            )
        places = np.linspace(0.0, length[-1], pieces + 1)
        above = np.full(pieces + 1, float(bottom["position"][0, 2] + bottom["highest"][0]) + 1.0)
        points = np.stack([*(np.interp(places, length, axis) for axis in course.T), above], axis=1)
        heights, hits = np.empty(len(points)), np.empty(len(points), np.int64)
        farthest = 2.0 + float(bottom["highest"][0] - bottom["lowest"][0])
        cast(
            bottom,
            self.heights,
            0.0,
            points,
            np.tile([0.0, 0.0, -1.0], (len(points), 1)),
            farthest,
            heights,
            hits,
        )
        points[:, 2] += s.radius * (1.0 - 2.0 * s.burial) - heights
        ways = np.diff(points, axis=0)
        pipe = [
            capsule(point + 0.5 * way, way, float(np.linalg.norm(way)), s.radius)
            for point, way in zip(points, ways, strict=False)
        ]
        return np.concatenate([bottom, *pipe]), remembered

    def _course(self, episode: Episode) -> Floats:
        """Return points (k, 2) in m of the pipe as seen from above."""
        s = self.settings
        if episode.line is not None:
            line = episode.line[:, :2]
            ends = []
            for end, inner in ((line[0], line[1]), (line[-1], line[-2])):
                out = end - inner
                ends.append(end + s.beyond * out / max(float(np.hypot(*out)), 1e-9))
            return np.array([ends[0], *line, ends[1]])
        # The course uses block 1, because block 0 draws the bottom.
        phase, size, turn, _ = episode.draws(1)
        way = episode.goal[:2] - episode.start[:2]
        distance = float(np.hypot(*way))
        bearing = math.atan2(way[1], way[0]) if distance > 0.0 else 2.0 * math.pi * turn
        count = math.ceil((distance + 2.0 * s.beyond) / FINE)
        along = np.linspace(-s.beyond, distance + s.beyond, count + 1)
        aside = s.sway * size * np.sin(2.0 * math.pi * (along / s.wave + phase))
        cosine, sine = math.cos(bearing), math.sin(bearing)
        turned = [along * cosine - aside * sine, along * sine + aside * cosine]
        return np.asarray(episode.start[:2] + np.stack(turned, axis=1))
