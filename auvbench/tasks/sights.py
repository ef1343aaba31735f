"""Compute the reward terms that depend on the solids of a world; see `rewards` for the arguments."""

from __future__ import annotations

import math
from typing import Any

from auvbench.dynamics.vectors import product, rotation_matrix, scale
from auvbench.tasks.records import Record
from auvbench.tasks.rows import Vehicle, row
from auvbench.worlds.casting import first_hit

RAY_STEP, RAY_LENGTH = math.radians(10.0), 10.0
"""Angle in rad between the rays of gym_dockauv's radar, and their length in m"""


@row
def gym_dockauv_sight(e: Record, v: Vehicle, p: Record, solids: Any, heights: Any) -> float:
    """Return the obstacle term of gym_dockauv's reward: Reward.obstacle_avoidance of gym_dockauv/envs/docking3d.py.

    The term uses the rays of gym_dockauv's radar: 7 rows over 60 degrees and 9 columns over 80 degrees. Each ray is 10 m long.
    """
    rotation, time = rotation_matrix(v.attitude), e.steps * p.duration
    total, weighted = 0.0, 0.0
    for i in range(-3, 4):
        for j in range(-4, 5):
            aside, up = math.sin(j * RAY_STEP), math.sin(i * RAY_STEP)
            direction = product(
                rotation, scale(1.0 / math.sqrt(1.0 + aside * aside + up * up), (1.0, aside, up))
            )
            distance, _ = first_hit(solids[: e.solids], heights, time, v.position, direction, RAY_LENGTH)
            weight = (1.0 - abs(i) / 3.0) * (1.0 - abs(j) / 4.0) + 0.01
            total += weight
            weighted += weight * max((distance / RAY_LENGTH) ** 2, 0.001)
    return float(-p.k * p.avoidance * (total / weighted - 1.0))
