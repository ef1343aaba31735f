"""What a world is: the solids of one episode, drawn for its start and goal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.random import WORLD, uniform4
from auvbench.worlds.kinds import Floats, Solids
from auvbench.worlds.passage import Key
from auvbench.worlds.solids import NO_HEIGHTS


class Episode(NamedTuple):
    """What a world may depend on."""

    start: Floats  # (3,) m
    goal: Floats  # (3,) m
    key: Key  # key of its draws
    line: Floats | None = None
    """(k, 3) m, path of the task; None: the task has none, or the world does not follow it"""

    def draws(self, block: int) -> tuple[float, float, float, float]:
        """Return four numbers in (0, 1); each `block` has its own."""
        seed, stream, episode, environment = self.key
        return uniform4(seed, stream, block, 0, episode, environment)


class World:
    """One world.

    Args:
        settings: configuration, of the schema of its spec.
        depth_low: m, the lower depth limit of the task, a negative number.
        radius: m, of the vehicle's hull.
    """

    most: int = 1
    """largest number of solids"""
    inside: ClassVar[str] = "inside the bottom"
    """where a point is that is not in the water, for messages"""
    follows: ClassVar[bool] = False
    """whether it depends on the path of the task"""
    heights: Floats = NO_HEIGHTS
    """m, of its terrain"""
    middle: tuple[float, float] = (0.0, 0.0)
    """x and y in m of a point that it has"""
    fingerprint: bytes = b""
    """what names its terrain; empty: the heights"""

    def __init__(self, settings: Any, depth_low: float, radius: float) -> None:
        self.settings, self.depth_low, self.radius = settings, depth_low, radius

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        """Return the solids (k,) of an episode, and what the episode remembers of it: numbers of `fields` by name.

        Raises:
            ConfigError: the world cannot be drawn.
        """
        raise NotImplementedError

    def covers(self, point: Floats) -> bool:
        """Return whether it is known at a point (3,) in m."""
        return True

    fields: ClassVar[tuple[str, ...]] = ()
    """numbers that an episode remembers"""

    def stand(self, episode: Episode, rises: NDArray[np.float64], highest: float) -> float:
        """Return the z in m of a bottom's reference level: `depth` or, without it, `altitude` below start, goal and path.

        Args:
            episode: with start and goal.
            rises: (2,) m, of the mean bottom below start and goal over the reference level.
            highest: m, of its highest point over the mean bottom.
        """
        if self.settings.depth is not None:
            return -float(self.settings.depth)
        points = np.array([episode.start[2], episode.goal[2]]) - rises
        lowest = float(points.min()) if episode.line is None else min(points.min(), episode.line[:, 2].min())
        return float(lowest) - highest - float(self.settings.altitude)


def key_of(seed: int | None, own: Key) -> Key:
    """Return the key of a world's draws: the episode's own, or the key of one seed for all episodes."""
    if seed is not None:
        return seed, WORLD, 0, 0
    seed, stream, episode, environment = own
    return seed, WORLD | stream, episode, environment
