"""The observations that tasks declare. Nothing compiled is imported: a ROS 2 pilot reads this file."""

from __future__ import annotations

import math
from collections.abc import Sequence

from auvbench.config import schema
from auvbench.observation import BODY, WORLD, Block, ObservationSpec


def observation_spec(
    task: schema.Task, actuators: Sequence[str], position_bounds: Sequence[float] = (math.inf,) * 3
) -> ObservationSpec:
    """Return the observation of the waypoint task: yaw error, position error (3), previous action (n_u).

    Args:
        task: its `position_frame` is that of the position error.
        actuators: names of the vehicle's.
        position_bounds: (3,) m, largest position errors.
    """
    return ObservationSpec(
        Block(
            "yaw_error",
            ("yaw_error",),
            "rad",
            (math.pi,),
            "bearing of the waypoint less yaw, wrapped to [-pi, pi)",
        ),
        Block(
            "position_error",
            tuple(f"position_error_{axis}" for axis in "xyz"),
            "m",
            tuple(position_bounds),
            "waypoint less position",
            BODY if task.position_frame == "body" else WORLD,
        ),
        Block(
            "previous_action",
            tuple(f"previous_action_{name}" for name in actuators),
            "1",
            (1.0,) * len(actuators),
            "action of the last step; 0 at the start",
        ),
    )
