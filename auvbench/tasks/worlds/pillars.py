"""Upright capsules on a circle round the goal, as in gym_dockauv's scenario with obstacles (config/env_config.py, 6b36b5b)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds.kinds import Solids
from auvbench.worlds.solids import capsule

TRIES = 64
"""Largest number of draws of the direction in search of a free start"""


class PillarsWorld(World):
    """Pillars on a circle round the goal. `turn` is the first pillar's direction; by default, it is drawn so that the start is free."""

    most = 64
    inside = "inside a pillar"

    def __init__(self, settings: Any, depth_low: float, radius: float) -> None:
        super().__init__(settings, depth_low, radius)
        self.most = settings.count

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        s = self.settings
        centres = self._centres(episode, s.turn or 0.0)
        for attempt in range(0 if s.turn is not None else TRIES):
            turn, _, _, _ = episode.draws(attempt)
            centres = self._centres(episode, 2.0 * math.pi * turn)
            apart = np.linalg.norm(centres[:, :2] - episode.start[:2], axis=1)
            if apart.min() > s.radius + self.radius:
                break
        up = [0.0, 0.0, 1.0]
        return np.concatenate([capsule(centre, up, s.length, s.radius) for centre in centres]), {}

    def _centres(self, episode: Episode, turn: float) -> Any:
        """Return the centres (count, 3) of the pillars in m."""
        s = self.settings
        angles = turn + 2.0 * math.pi * np.arange(s.count) / s.count
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(s.count)], axis=1)
        return episode.goal + s.distance * ring
