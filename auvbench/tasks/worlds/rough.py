"""A fractal bottom: one grid of heights for all episodes; each episode draws the grid's place and direction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from auvbench.dynamics.random import WORLD
from auvbench.tasks.worlds.base import Episode, World
from auvbench.worlds.kinds import Floats, Solids
from auvbench.worlds.solids import laid, terrain


class RoughWorld(World):
    """Fractal bottom. The seed of its grid is `world.seed`, by default 0."""

    def __init__(self, settings: Any, depth_low: float, radius: float) -> None:
        super().__init__(settings, depth_low, radius)
        self.grid = fractal(settings.seed or 0, settings.size, settings.hurst, settings.height)
        self.heights = self.grid.ravel()
        self.bottom = terrain(self.grid, settings.spacing, [0.0, 0.0, 0.0])

    def draw(self, episode: Episode) -> tuple[Solids, Mapping[str, float]]:
        s = self.settings
        u, v, turn, _ = episode.draws(0)
        side = s.size * s.spacing
        z = self.stand(episode, np.zeros(2), float(self.grid.max()))
        return laid(self.bottom, [-u * side, -v * side, z], 2.0 * math.pi * turn), {}


def fractal(seed: int, size: int, hurst: float, height: float) -> Floats:
    """Return heights (size, size) in m with mean 0: a periodic sum of waves with random amplitudes and phases.

    The spectral density of a surface with Hurst exponent H falls as k^-(2 H + 2) (Peitgen and Saupe, "The science of fractal images",
    1988, section 2.4).

    Args:
        seed: seed of the waves.
        size: vertices along each side.
        hurst: 0 rough .. 1 smooth.
        height: standard deviation, m.
    """
    white = np.random.Generator(np.random.Philox(key=[seed, WORLD])).normal(size=(size, size))
    waves = np.fft.rfft2(white)
    along, across = np.meshgrid(np.fft.rfftfreq(size), np.fft.fftfreq(size))
    length = np.hypot(along, across)
    length[0, 0] = math.inf  # no mean
    heights = np.fft.irfft2(waves * length ** -(hurst + 1.0), s=(size, size))
    return np.asarray(heights * (height / heights.std()))
