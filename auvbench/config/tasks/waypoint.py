"""Define the task waypoint: its schema and its spec; the code is `tasks/waypoint.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from auvbench.config import feasible
from auvbench.config.schema import number
from auvbench.config.tasks import STATE, Task, TaskSpec
from auvbench.metrics import Metric, column


@dataclass(kw_only=True)
class Waypoint(Task):
    """Keys of the task waypoint (section 3 of the original study)."""

    start: list[float]
    waypoint_low: list[float]
    waypoint_high: list[float]
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m

    def check(self) -> None:
        """Reject a box of waypoints that is empty or outside the depth limits."""
        for axis, least, most in zip("xyz", self.waypoint_low, self.waypoint_high, strict=True):
            feasible.refuse(least > most, "waypoint_low", self, f"be at most task.waypoint_high in {axis}")
        bottom, top = self.waypoint_low[2], self.waypoint_high[2]
        why = "no waypoint would be between the depth limits"
        low, high = f"{self.depth_low:g}", f"{self.depth_high:g}"
        feasible.refuse(bottom > self.depth_high, "waypoint_low", self, f"have a z of at most {high}", why)
        feasible.refuse(top < self.depth_low, "waypoint_high", self, f"have a z of at least {low}", why)

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        """Return the largest position error in m along each axis: the largest initial distance plus the longest way of an episode.

        The depth limits bound the vertical error.
        """
        away = speed * seconds
        x, y, z = (
            max(abs(low - start), abs(high - start))
            for start, low, high in zip(self.start, self.waypoint_low, self.waypoint_high, strict=True)
        )
        # The last step may lead beyond a depth limit before the episode ends.
        below, above = self.waypoint_high[2] - self.depth_low, self.depth_high - self.waypoint_low[2]
        vertical = min(z + away, max(below, above) + speed / frequency)
        x, y = x + away, y + away
        if self.position_frame == "body":
            x = y = math.hypot(x, y)
        return x, y, vertical

    def card(self) -> dict[str, Any]:
        return {
            "start_m": list(self.start),
            "waypoint_low_m": list(self.waypoint_low),
            "waypoint_high_m": list(self.waypoint_high),
            "goal_radius_m": self.goal_radius,
        }


SPEC = TaskSpec(
    "waypoint",
    "waypoint",
    "auvbench.tasks.waypoint:WaypointTask",
    "par1_time_s",
    ("yaw_error", "position_error", *STATE, "previous_action"),
    ("success", "collision", "timeout"),
    ("thesis", "goal", "tracking", "exponential"),
    needs_thrusters=False,
    has_yaw=False,
    schema=Waypoint,
    goal="waypoint",
    reached="waypoints",
    fixed_start=True,
    free_goal=True,
    at_rest=True,
    shared=(),
    metrics=(
        Metric(
            "deviation_mean_m",
            "m",
            "deviation",
            "mean distance to the line through start and waypoint",
            lambda t: t.mean_deviation,
            latex=r"mean $d_\delta$",
            after="final_distance_m",
        ),
        Metric(
            "deviation_std_m",
            "m",
            "std of deviation",
            "population standard deviation of the distance to that line",
            lambda t: (
                max(t.deviation_squared / max(t.steps, 1) - t.mean_deviation * t.mean_deviation, 0.0) ** 0.5
            ),
            latex=r"std $d_\delta$",
            after="final_distance_m",
        ),
        Metric(
            "path_efficiency",
            "",
            "path efficiency",
            "(initial - final distance) / path length; at most 1: a straight path",
            lambda t: (t.initial_distance - t.distance) / t.path if t.path > 0.0 else 0.0,
            better="higher",
            low=-1.0,
            high=1.0,
            after="path_length_m",
        ),
        *(
            column(f"waypoint_{axis}_m", "m", f"waypoint {axis}", "", "", after="depth_margin_m")
            for axis in "xyz"
        ),
    ),
)
