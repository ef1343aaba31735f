"""Check poses and velocities: impossible numbers mean that a sensor or an estimator has failed."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FASTEST = 50.0
"""largest speed of a vehicle, and largest component of its velocity, m/s and rad/s"""
FARTHEST = 1e6
"""largest absolute coordinate of a position, m"""


def is_possible(pose: Floats, velocity: Floats) -> bool:
    """Return whether a vehicle can have a pose (7,) and a velocity (6,)."""
    return (
        bool(np.all(np.isfinite([*pose, *velocity])))
        and is_turn(pose)
        and float(np.max(np.abs(pose[:3]))) <= FARTHEST
        and float(np.max(np.abs(velocity))) <= FASTEST
    )


def is_jump(before: Floats, after: Floats, seconds: float) -> bool:
    """Return whether the move from pose `before` to pose `after` (7,) in `seconds` is faster than any vehicle."""
    return math.dist(before[:3], after[:3]) > FASTEST * seconds


def is_turn(pose: Floats) -> bool:
    """Return whether the orientation of a pose (7,) is a unit quaternion."""
    return abs(float(np.linalg.norm(pose[3:])) - 1.0) <= 0.01
