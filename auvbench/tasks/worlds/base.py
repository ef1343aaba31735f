"""Base class of worlds: the solids of one episode, drawn for its start and goal."""

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
    """Properties of an episode on which its world may depend."""

    start: Floats  # (3,) m
    goal: Floats  # (3,) m
    key: Key  # key of its draws
    line: Floats | None = None
    """Path (k, 3) of the task, m; None: the task has no path, or the world does not depend on the path"""

    def draws(self, block: int) -> tuple[float, float, float, float]:
        """Return four random numbers in (0, 1); each `block` has its own numbers."""
        seed, stream, episode, environment = self.key
        return uniform4(seed, stream, block, 0, episode, environment)


class World:
    """One world.

    Args:
        settings: configuration, with the schema of the world's spec.
        depth_low: lower depth limit of the task, m, a negative number.
        radius: radius of the vehicle's hull, m.
    """

    most: int = 1
    """Largest number of solids"""
    inside: ClassVar[str] = "inside the bottom"
    """Text of error messages for a point that is not in the water"""
    follows: ClassVar[bool] = False
    """Whether the world depends on the path of the task"""
    heights: Floats = NO_HEIGHTS
    """Heights of the world's terrain, m"""
    middle: tuple[float, float] = (0.0, 0.0)
    """x and y in m of a point that the world covers"""
    fingerprint: bytes = b""
    """Digest that identifies the world's terrain; empty: the heights identify the terrain"""

    def __init__(self, settings: Any, depth_low: float, radius: float) -> None:
        self.settings, self.depth_low, self.radius = settings, depth_low, radius

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        """Return the solids (k,) of an episode, and a number for each name in `fields`, which the episode stores.

        Raises:
            ConfigError: the world cannot be drawn.
        """
        raise NotImplementedError

    def covers(self, point: Floats) -> bool:
        """Return whether the world's data include a point (3,) in m."""
        return True

    fields: ClassVar[tuple[str, ...]] = ()
    """Names of numbers that an episode stores"""

    def stand(self, episode: Episode, rises: NDArray[np.float64], highest: float) -> float:
        """Return z in m of a bottom's reference level.

        If `depth` is set, the level is at that depth. Otherwise the bottom's highest point is `altitude` below start, goal and path.

        Args:
            episode: episode with start and goal.
            rises: heights (2,) of the mean bottom above the reference level, m, at the places of start and goal.
            highest: height of the bottom's highest point above the mean bottom, m.
        """
        if self.settings.depth is not None:
            return -float(self.settings.depth)
        points = np.array([episode.start[2], episode.goal[2]]) - rises
        lowest = float(points.min()) if episode.line is None else min(points.min(), episode.line[:, 2].min())
        return float(lowest) - highest - float(self.settings.altitude)


def key_of(seed: int | None, own: Key) -> Key:
    """Return the key of a world's draws: the episode's own key or, with a seed, the same key for all episodes."""
    if seed is not None:
        return seed, WORLD, 0, 0
    seed, stream, episode, environment = own
    return seed, WORLD | stream, episode, environment
