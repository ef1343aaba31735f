"""Compute the observation on the way to a waypoint or at a station, without noise, in plain Python.

The blocks are written by the same functions as in environments, which compile the functions (`auvbench/blocks.py`). A test
compares the two observations.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from auvbench.blocks import reading
from auvbench.observation import BODY, ObservationSpec
from auvbench.registry import BLOCKS

Floats = NDArray[np.float64]

_NO_ERROR = (0.0, 0.0, 0.0)


def supplied() -> tuple[str, ...]:
    """Return the names of the observation blocks, including plug-in blocks, that need only odometry and a goal at rest."""
    return tuple(
        name
        for name in BLOCKS
        if not {"goal", "preview", "task", "team", "solids", "navigation"} & {*BLOCKS[name].reads}
    )


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
        spec: layout of the observation; its blocks must be in `supplied()`.
        pose: (7,) x, y, z in m, unit quaternion (w, x, y, z).
        velocity: (6,) m/s and rad/s, body axes.
        waypoint: (3,) waypoint or station in m, world axes.
        previous: (n_u,) previous action in [-1, 1]; zeros at the start.
        yaw: yaw of a station, rad; None for a waypoint: the reference yaw is then the bearing to the waypoint.
        depth: lowest and highest z, m.
    """
    e = SimpleNamespace(
        reference=waypoint.tolist(), reference_yaw=0.0 if yaw is None else yaw, reference_velocity=_NO_ERROR
    )
    levelled = yaw is not None or spec.blocks["position_error"].axes == BODY
    low, high = depth
    p = SimpleNamespace(has_yaw=yaw is not None, body_frame=levelled, depth_low=low, depth_high=high)
    place, motion = pose.tolist(), velocity.tolist()
    own = place[:3], place[3:], motion[:3], motion[3:]
    m = reading(e, p, *own, _NO_ERROR, _NO_ERROR, 0.0, previous, (), 0)
    seen = np.empty(spec.size, dtype=np.float32)
    for name in spec.blocks:
        BLOCKS[name].write(m, e, p, seen[spec[name]])
    return seen


def yaw_of(pose: Floats) -> float:
    """Return the yaw in rad of a pose (7,)."""
    w, qx, qy, qz = pose[3:].tolist()
    return math.atan2(2.0 * (w * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
