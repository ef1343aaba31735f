"""Airy waves on deep water in plain NumPy, written from the textbook and not from the simulator."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

Array = np.ndarray
G = 9.81


@dataclass(frozen=True)
class Wave:
    """One component: amplitude in m, angular frequency in rad/s, direction and phase in rad."""

    amplitude: float
    frequency: float
    direction: float = 0.0
    phase: float = 0.0

    @property
    def number(self) -> float:
        """rad/m, by the dispersion relation of deep water."""
        return self.frequency**2 / G


def water(waves: list[Wave], t: float, place: Array) -> tuple[Array, Array]:
    """Velocity (3,) and local acceleration (3,) of the water at a place (3,) below z = 0, up being positive.

    From the potential phi = a g / w exp(k z) sin(theta) of each component (Faltinsen 1990, table 2.1).
    """
    velocity, acceleration = np.zeros(3), np.zeros(3)
    for wave in waves:
        k, w = wave.number, wave.frequency
        ray = np.array([np.cos(wave.direction), np.sin(wave.direction), 0.0])
        theta = k * ray @ place - w * t + wave.phase
        size = wave.amplitude * w * np.exp(k * place[2])
        up = np.array([0.0, 0.0, 1.0])
        velocity += size * (np.cos(theta) * ray + np.sin(theta) * up)
        acceleration += size * w * (np.sin(theta) * ray - np.cos(theta) * up)
    return velocity, acceleration


def variance(height: float, period: float, gamma: float, depth: float) -> float:
    """Variance of the horizontal velocity at a depth: the integral of w^2 S(w) exp(-2 k d), in (m/s)^2."""
    peak = 2 * np.pi / period

    def S(w: float) -> float:
        sigma = 0.07 if w <= peak else 0.09
        enhanced = gamma ** np.exp(-((w - peak) ** 2) / (2 * sigma**2 * peak**2))
        return float(w**-5 * np.exp(-1.25 * (peak / w) ** 4) * enhanced)

    def integral(power: int, deep: float) -> float:
        parts = (0.2, 0.8, 1.0, 1.2, 2.0, 5.0, 50.0)
        f = lambda w: w**power * S(w) * np.exp(-2 * w**2 / G * deep)  # noqa: E731
        return float(sum(quad(f, a * peak, b * peak, epsabs=0, epsrel=1e-9)[0] for a, b in pairwise(parts)))

    return (height / 4) ** 2 * integral(2, depth) / integral(0, 0.0)
