"""A plane bottom that falls towards one direction."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds.kinds import Solids
from auvbench.worlds.solids import plane


class SlopeWorld(World):
    """Plane bottom. `direction` gives the direction of its slope; without `direction`, each episode draws one."""

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        s = self.settings
        turn, _, _, _ = episode.draws(0)
        direction = 2.0 * math.pi * turn if s.direction is None else s.direction
        fall = math.tan(s.dip) * np.array([math.cos(direction), math.sin(direction)])
        rises = -np.array([episode.start[:2] @ fall, episode.goal[:2] @ fall])
        z = self.stand(episode, rises, 0.0)
        return plane([0.0, 0.0, z], [*fall, 1.0]), {}
