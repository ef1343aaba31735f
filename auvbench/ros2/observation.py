"""The waypoint task's observation without noise, in plain Python.

The arithmetic is that of `auvbench/tasks/kernels.py`, which is compiled; a test compares the two.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.observation import BODY, ObservationSpec

Floats = NDArray[np.float64]


def observe(spec: ObservationSpec, pose: Floats, waypoint: Floats, previous: Floats) -> NDArray[np.float32]:
    """Return the observation (n_obs,): yaw error (rad), position error (3) in m, previous action (n_u).

    Args:
        spec: of the observation.
        pose: (7,) x, y, z in m, unit quaternion (w, x, y, z).
        waypoint: (3,) m, world axes.
        previous: (n_u,) action in [-1, 1]; zeros at the start.
    """
    x, y, z, w, qx, qy, qz = pose.tolist()
    to_x, to_y, to_z = waypoint.tolist()
    c = 1.0 - 2.0 * (qy * qy + qz * qz)
    s = 2.0 * (w * qz + qx * qy)
    ex, ey, ez = to_x - x, to_y - y, to_z - z
    yaw_error = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s))
    if spec.blocks["position_error"].axes == BODY:
        yaw = math.atan2(s, c)
        c, s = math.cos(yaw), math.sin(yaw)
        ex, ey = c * ex + s * ey, c * ey - s * ex
    return spec.pack(yaw_error=yaw_error, position_error=(ex, ey, ez), previous_action=previous)


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
