"""Define the task trajectory tracking: its schema and its spec; the code is `tasks/trajectory_tracking.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.schema import choice, number
from auvbench.config.tasks import ERRORS, TRACKING, TaskSpec, Tracked
from auvbench.errors import ConfigError
from auvbench.metrics import column

RANDOM_HEIGHT = 0.3
"""height of a random curve, as a share of the curve's size"""
HELIX_CLIMB = 0.2 / math.hypot(1.0, 0.2)
"""vertical speed of a reference on a helix, as a share of the reference's speed"""


@dataclass(kw_only=True)
class TrajectoryTracking(Tracked):
    """Keys of the task trajectory tracking: follow a reference that moves along a curve."""

    curve: str = choice("circle", "helix", "lemniscate", "random", "any")
    centre: list[float]
    size_low: float = number(0.0, 1e4, open_low=True)  # m
    size_high: float = number(0.0, 1e4, open_low=True)  # m
    speed_low: float = number(0.0, 10.0, open_low=True)  # m/s
    speed_high: float = number(0.0, 10.0, open_low=True)  # m/s
    start_radius: float = number(0.0, 1e4)  # m
    start_yaw: float = number(0.0, math.pi)  # rad

    def check(self) -> None:
        feasible.at_most("start_radius", self, "bounds")

    def check_length(self, frequency: float) -> None:
        """Reject depth limits that are too narrow for the curve."""
        steps, length = feasible.length(self, frequency)
        seconds = steps / frequency
        height = RANDOM_HEIGHT * self.size_high if self.curve in ("random", "any") else 0.0
        rise = HELIX_CLIMB * self.speed_high * seconds if self.curve in ("helix", "any") else 0.0
        low, high = self.depth_low + height, self.depth_high - max(height, rise)
        if low > high:
            raise ConfigError(
                f"task.curve={self.curve}: rises by up to {max(height, rise):.3g} m in {length}; must fit between "
                f"task.depth_low={self.depth_low:g} and task.depth_high={self.depth_high:g}"
            )
        what = f"have a z of at least {low:.4g} and at most {high:.4g}"
        why = f"task.curve={self.curve} rises by up to {max(height, rise):.3g} m in {length}"
        feasible.refuse(not low <= self.centre[2] <= high, "centre", self, what, why)


SPEC = TaskSpec(
    "trajectory_tracking",
    "trajectory tracking",
    "auvbench.tasks.trajectory_tracking:TrajectoryTrackingTask",
    "mean_position_error_rms_m",
    (*ERRORS, "preview"),
    ("success", "collision", "out_of_bounds"),
    TRACKING,
    schema=TrajectoryTracking,
    metrics=(
        column(
            "lag_s",
            "s",
            "lag",
            "mean position error along the reference's velocity, divided by the reference's speed; positive: behind; a failed "
            "episode counts as the time limit",
            low=-math.inf,
            failed="time",
        ),
    ),
)
