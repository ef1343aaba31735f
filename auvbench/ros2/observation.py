"""The waypoint task's observation without noise, in plain Python.

The arithmetic is that of `auvbench/tasks/kernels.py`, which is compiled; a test compares the two.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def observe(pose: Floats, waypoint: Floats, previous: Floats, body_frame: bool) -> NDArray[np.float32]:
    """Return the observation (4 + n_u,): yaw error (rad), position error (3) in m, previous action (n_u).

    Args:
        pose: (7,) x, y, z in m, unit quaternion (w, x, y, z).
        waypoint: (3,) m, world axes.
        previous: (n_u,) action in [-1, 1]; zeros at the start.
        body_frame: whether the position error is in the levelled body frame; else in world axes.
    """
    x, y, z, w, qx, qy, qz = pose.tolist()
    to_x, to_y, to_z = waypoint.tolist()
    c = 1.0 - 2.0 * (qy * qy + qz * qz)
    s = 2.0 * (w * qz + qx * qy)
    ex, ey, ez = to_x - x, to_y - y, to_z - z
    seen = np.empty(4 + len(previous), dtype=np.float32)
    seen[0] = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s))
    if body_frame:
        yaw = math.atan2(s, c)
        c, s = math.cos(yaw), math.sin(yaw)
        ex, ey = c * ex + s * ey, c * ey - s * ex
    seen[1:4] = ex, ey, ez
    seen[4:] = previous
    return seen


def wrap(angle: float) -> float:
    """Wrap an angle to [-pi, pi).

    >>> wrap(math.pi) == -math.pi
    True
    """
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return wrapped if wrapped < math.pi else -math.pi


def yaw_of(pose: Floats) -> float:
    """Return the yaw in rad of a pose (7,)."""
    w, qx, qy, qz = pose[3:].tolist()
    return math.atan2(2.0 * (w * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
