"""Define the task docking: its schema and its spec; the code is `tasks/docking.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.schema import later, number
from auvbench.config.tasks import ERRORS, FOUR_ENDS, TaskSpec, Tracked
from auvbench.metrics import POINTS, column


@dataclass(kw_only=True)
class Docking(Tracked):
    """Keys of the task docking: enter a dock."""

    dock: list[float]
    start_low: float = number(0.0, 1e4, open_low=True)  # m
    start_high: float = number(0.0, 1e4, open_low=True)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    yaw_tolerance: float = number(0.0, math.pi, open_low=True)  # rad
    speed: float = number(0.0, 10.0, open_low=True)  # m/s
    cone: float = number(0.0, math.pi / 2, open_low=True)  # rad
    clearance: float = number(0.0, 1e3)  # m
    standoff: float = number(0.0, 1e3, open_low=True)  # m
    tilt: float | None = later(number(0.0, math.pi, open_low=True))  # rad

    def check(self) -> None:
        """Reject starts out of bounds, or so near that they collide with the dock."""
        feasible.at_most("start_high", self, "bounds")
        what = f"be at least task.clearance={self.clearance:g}"
        why = "a smaller distance from the dock is a collision"
        feasible.refuse(self.start_low < self.clearance, "start_low", self, what, why)

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        # The bounds limit the distance to the dock. The position error is the distance to the reference, which is up to `standoff`
        # from the dock.
        most = self.bounds + self.standoff + speed / frequency
        return most, most, most


SPEC = TaskSpec(
    "docking",
    "docking",
    "auvbench.tasks.docking:DockingTask",
    "par1_time_s",
    (*ERRORS, "goal_error"),
    FOUR_ENDS,
    ("goal", "tracking", "exponential"),
    schema=Docking,
    budget=500_000,
    short_of_budget="after 200,000 steps the typical training of PPO or SAC does not dock (results/suite)",
    shared=("yaw_error_rms_rad", *POINTS),
    metrics=(
        column(
            "final_position_error_m",
            "m",
            "final position error",
            "distance to the dock at the end; a failed episode counts as the bounds",
            failed="bounds",
        ),
        column("final_speed_m_per_s", "m/s", "final speed", "speed over ground at the end"),
        column(
            "final_yaw_error_rad",
            "rad",
            "final yaw error",
            "yaw error at the end; a failed episode counts as pi",
            high=math.pi,
            failed="high",
        ),
    ),
)
