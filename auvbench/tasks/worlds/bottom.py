"""A bottom from a file, the same in every episode."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from omegaconf import DictConfig, open_dict

from auvbench.config.worlds import Bottom
from auvbench.errors import ConfigError
from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds import grids
from auvbench.worlds.kinds import Floats, Solids
from auvbench.worlds.solids import terrain


class BottomWorld(World):
    """Bottom from a grid of heights. The grid is mirrored beyond its edges, so that the bottom has no end and no step.

    Raises:
        ConfigError: the file has no regular grid of heights.
    """

    def __init__(self, settings: Any, depth_low: float, radius: float) -> None:
        super().__init__(settings, depth_low, radius)
        grid = grid_of(settings)
        east, north = settings.bottom.origin or grid.middle
        self.low = np.array([grid.x[0] - east, grid.y[0] - north])
        self.high = np.array([grid.x[-1] - east, grid.y[-1] - north])
        self.middle = tuple(0.5 * (self.low + self.high))
        mirrored = np.pad(grid.z, ((0, len(grid.y) - 2), (0, len(grid.x) - 2)), "reflect")
        self.heights = mirrored.ravel()
        self.fingerprint = grid.sha256.encode()
        self.bottom = terrain(mirrored, grid.spacing, [*self.low, 0.0])

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        for what, point in (("start", episode.start), ("goal", episode.goal)):
            if not self.covers(point):
                (west, south), (east, north), (x, y, _) = self.low, self.high, point
                raise ConfigError(
                    f"world.bottom.file={self.settings.bottom.file}: a {what} at ({x:.1f}, {y:.1f}) m is not over the grid, which has x "
                    f"from {west:.1f} to {east:.1f} m and y from {south:.1f} to {north:.1f} m; change keys of task, or "
                    "world.bottom.origin"
                )
        return self.bottom, {}

    def covers(self, point: Floats) -> bool:
        return bool(((self.low <= point[:2]) & (point[:2] <= self.high)).all())


def grid_of(settings: Bottom) -> grids.Grid:
    """Return the grid of a bottom's file.

    Raises:
        ConfigError: the configuration names no file, or the file has no regular grid of heights, or not the configured SHA-256.
    """
    bottom = settings.bottom
    if not bottom.file:
        raise ConfigError(
            "world.bottom.file: a value is missing; name a .npz or .csv file: world=bottom world.bottom.file=bottom.csv"
        )
    try:
        return grids.read(bottom.file, bottom.sha256)
    except ValueError as error:
        raise ConfigError(f"world.bottom.file={bottom.file}: {error}") from error


def settled(config: DictConfig, settings: Bottom) -> DictConfig:
    """Return a composed configuration with the SHA-256 of the bottom's file.

    Args:
        config: composed configuration.
        settings: `world` of the configuration, checked.

    Raises:
        ConfigError: see `grid_of`.
    """
    result = copy.deepcopy(config)
    with open_dict(result):
        result.world.bottom.sha256 = grid_of(settings).sha256
    return result
