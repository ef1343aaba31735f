"""Define the task transit: its schema and its spec; the code is `tasks/transit.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.fields import below
from auvbench.config.schema import number
from auvbench.config.tasks import STATE, Task, TaskSpec
from auvbench.metrics import POINTS, column


@dataclass(kw_only=True)
class Transit(Task):
    """Keys of the task transit: reach a point."""

    start: list[float]
    distance_low: float = number(0.0, 1e4, open_low=True)  # m
    distance_high: float = number(0.0, 1e4, open_low=True)  # m
    rise: float = number(0.0, 1e4)  # m
    goal_radius: float = number(0.0, 1e3, open_low=True)  # m
    speed: float = number(0.0, 10.0, open_low=True)  # m/s

    def check(self) -> None:
        """Reject goals that are within the goal radius of the start, or outside the depth limits."""
        below("task.distance_low", self.distance_low, "task.distance_high", self.distance_high)
        why = "nearer goals are reached at the start"
        what = f"be more than task.goal_radius={self.goal_radius:g}"
        feasible.refuse(self.distance_low <= self.goal_radius, "distance_low", self, what, why)
        z = self.start[2]
        most = min(self.depth_high - z, z - self.depth_low, self.distance_low)
        what = f"be at most {most:g}, so that goals are between the depth limits"
        feasible.refuse(self.rise > most, "rise", self, what)

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        away = self.distance_high + speed * seconds
        # The last step may lead beyond a depth limit before the episode ends.
        return away, away, min(away, self.depth_high - self.depth_low + speed / frequency)


SPEC = TaskSpec(
    "transit",
    "transit",
    "auvbench.tasks.transit:TransitTask",
    "par1_time_s",
    ("yaw_error", "position_error", *STATE, "previous_action", "way"),
    ("success", "collision", "timeout"),
    ("goal", "tracking", "exponential"),
    has_yaw=False,
    schema=Transit,
    fixed_start=True,
    shared=POINTS,
    metrics=(
        column(
            "barn_score",
            "",
            "BARN score",
            "score of the BARN challenge: success * OT / clip(time, 2 OT, 8 OT), with OT the time of the shortest way at task.speed",
            "higher",
            high=math.nextafter(0.5, 1.0),
            counts_failures=True,
        ),
    ),
)
