"""A tank: a bottom and four walls, with its centre at x = y = 0."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds.kinds import Solids
from auvbench.worlds.solids import plane


class TankWorld(World):
    """The same tank in every episode."""

    most = 5
    inside = "outside the tank"

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        s = self.settings
        depth = -self.depth_low if s.depth is None else s.depth
        half_x, half_y = 0.5 * s.length, 0.5 * s.width
        walls = [
            plane([0.0, 0.0, -depth], [0.0, 0.0, 1.0]),
            plane([half_x, 0.0, 0.0], [-1.0, 0.0, 0.0]),
            plane([-half_x, 0.0, 0.0], [1.0, 0.0, 0.0]),
            plane([0.0, half_y, 0.0], [0.0, -1.0, 0.0]),
            plane([0.0, -half_y, 0.0], [0.0, 1.0, 0.0]),
        ]
        return np.concatenate(walls), {}
