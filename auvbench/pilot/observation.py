"""Compute the observation on the way to a waypoint or at a station, without noise, in plain Python.

The arithmetic is the same as in `auvbench/tasks/kernels.py`, which is compiled; a test compares the two.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.observation import BODY, ObservationSpec

Floats = NDArray[np.float64]

SUPPLIED = (
    "yaw_error",
    "position_error",
    "velocity_error",
    "velocity",
    "angular_velocity",
    "gravity",
    "depth_margin",
    "previous_action",
)
"""Observation blocks that odometry and a goal at rest can supply."""


def observe(
    spec: ObservationSpec,
    pose: Floats,
    velocity: Floats,
    waypoint: Floats,
    previous: Floats,
    *,
    yaw: float | None,
    depth: tuple[float, float],
) -> NDArray[np.float32]:
    """Return the observation (n_obs,).

    Args:
        spec: observation; its blocks must be in `SUPPLIED`.
        pose: (7,) x, y, z in m, unit quaternion (w, x, y, z).
        velocity: (6,) m/s and rad/s, body axes.
        waypoint: (3,) waypoint or station in m, world axes.
        previous: (n_u,) previous action in [-1, 1]; zeros at the start.
        yaw: yaw of a station, rad; None for a waypoint, whose yaw is its bearing.
        depth: lowest and highest z, m.
    """
    x, y, z, w, qx, qy, qz = pose.tolist()
    to_x, to_y, to_z = waypoint.tolist()
    c = 1.0 - 2.0 * (qy * qy + qz * qz)
    s = 2.0 * (w * qz + qx * qy)
    ex, ey, ez = to_x - x, to_y - y, to_z - z
    heading = math.atan2(s, c)
    if yaw is None:
        yaw_error = wrap(math.atan2(ey * c - ex * s, ex * c + ey * s))
    else:
        yaw_error = wrap(yaw - heading)
    if yaw is not None or spec.blocks["position_error"].axes == BODY:
        c, s = math.cos(heading), math.sin(heading)
        ex, ey = c * ex + s * ey, c * ey - s * ex
    u, v, m = velocity[:3].tolist()
    vx = (1.0 - 2.0 * (qy * qy + qz * qz)) * u + 2.0 * (qx * qy - w * qz) * v + 2.0 * (qx * qz + w * qy) * m
    vy = 2.0 * (qx * qy + w * qz) * u + (1.0 - 2.0 * (qx * qx + qz * qz)) * v + 2.0 * (qy * qz - w * qx) * m
    vz = 2.0 * (qx * qz - w * qy) * u + 2.0 * (qy * qz + w * qx) * v + (1.0 - 2.0 * (qx * qx + qy * qy)) * m
    return spec.pack(
        yaw_error=yaw_error,
        position_error=(ex, ey, ez),
        velocity_error=(c * -vx + s * -vy, c * -vy - s * -vx, -vz),
        velocity=velocity[:3],
        angular_velocity=velocity[3:],
        gravity=(
            -2.0 * (qx * qz - w * qy),
            -2.0 * (qy * qz + w * qx),
            2.0 * (qx * qx + qy * qy) - 1.0,
        ),
        depth_margin=min(depth[1] - (to_z - ez), to_z - ez - depth[0]),
        previous_action=previous,
    )


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
