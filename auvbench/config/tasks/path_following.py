"""Define the task path following: its schema and its spec; the code is `tasks/path_following.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.schema import number
from auvbench.config.tasks import ERRORS, FOUR_ENDS, TRACKING, TaskSpec, Tracked
from auvbench.errors import ConfigError
from auvbench.metrics import POINTS, column

SHALLOWEST = 1.0
"""smallest distance in m between a path and the depth limits"""


@dataclass(kw_only=True)
class PathFollowing(Tracked):
    """Keys of the task path following: follow a path at a given speed."""

    start: list[float]
    waypoints: int = number(2, 16)
    spacing: float = number(0.0, 1e4, open_low=True)  # m
    turn: float = number(0.0, math.pi)  # rad
    climb: float = number(0.0, math.pi / 2)  # rad
    speed: float = number(0.0, 10.0, open_low=True)  # m/s
    start_radius: float = number(0.0, 1e4)  # m
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m

    def check(self) -> None:
        """Reject starts out of bounds, and depth limits between which a path does not fit."""
        feasible.at_most("start_radius", self, "bounds")
        room = SHALLOWEST + self.overshoot
        low, high = self.depth_low + room, self.depth_high - room
        key, why = "task.depth_low", f"a path may leave the depths of its points by {self.overshoot:.3g} m"
        if low > high:
            raise ConfigError(
                f"{key}={self.depth_low:g}: must be at most {self.depth_high - 2 * room:g}, {2 * room:.3g} m below "
                f"task.depth_high={self.depth_high:g}: {why}"
            )
        inside = low <= self.start[2] <= high
        what = f"have a z of at least {low:.4g} and at most {high:.4g}"
        feasible.refuse(not inside, "start", self, what, why)

    @property
    def overshoot(self) -> float:
        """Return the largest distance in m by which the path between two points rises above both points, or sinks below both.

        A cubic Hermite curve leaves the interval between its two end values by at most a quarter of the larger end slope. In a
        Catmull-Rom curve, the slope at a point is the mean of the rises before and after this point.
        """
        return 0.25 * self.spacing * math.sin(self.climb)


SPEC = TaskSpec(
    "path_following",
    "path following",
    "auvbench.tasks.path_following:PathFollowingTask",
    "mean_cross_track_rms_m",
    (*ERRORS, "preview"),
    FOUR_ENDS,
    ("path", *TRACKING),
    needs_thrusters=False,
    failures=("collision", "timeout", "out_of_bounds"),
    schema=PathFollowing,
    path=True,
    shared=("yaw_error_rms_rad", *POINTS),
    metrics=(
        column(
            "cross_track_rms_m",
            "m",
            "RMS cross-track distance",
            "root mean square of the distance to the path; an episode that did not reach its end counts as the bounds",
            failed="bounds",
            after="position_error_rms_m",
        ),
        column(
            "completion",
            "",
            "completion",
            "share of the path that the vehicle has covered",
            "higher",
            high=1.0,
        ),
        column(
            "speed_error_m_per_s",
            "m/s",
            "speed error",
            "mean absolute difference between the speed along the path and task.speed; a failed episode counts at least as a "
            "vehicle at rest",
            counts_failures=True,
        ),
    ),
)
