"""Compute the directions of a range sensor's rays. This module imports no compiled code."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def mounted(rays: Floats, yaw: float, pitch: float) -> Floats:
    """Return rays (k, 3) of a sensor that is turned by a yaw and a pitch in rad, pitch positive upwards."""
    c, s, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    turned = np.array([[c * cp, -s, -c * sp], [s * cp, c, -s * sp], [sp, 0.0, cp]])
    return np.ascontiguousarray(rays @ turned.T)


def fan(azimuths: Floats, elevations: Floats) -> Floats:
    """Return unit vectors (k, 3) for azimuths (k,), counter-clockwise from forward, and elevations (k,) in rad."""
    level = np.cos(elevations)
    return np.stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)], axis=1)


def middles(angle: float, count: int) -> Floats:
    """Return the centres in rad of `count` equal sectors of a fan that is centred on 0."""
    return np.asarray(angle * ((np.arange(count) + 0.5) / count - 0.5))


def spread(angle: float, count: int) -> Floats:
    """Return `count` equally spaced angles in rad from -angle / 2 to angle / 2; a single angle is 0."""
    return np.linspace(-0.5 * angle, 0.5 * angle, count) if count > 1 else np.zeros(1)
