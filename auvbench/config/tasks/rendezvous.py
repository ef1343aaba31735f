"""Define the task rendezvous: its schema and its spec; the code is `tasks/rendezvous.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config.fields import below
from auvbench.config.schema import number
from auvbench.config.tasks import ERRORS, FOUR_ENDS, TaskSpec
from auvbench.config.tasks.docking import Docking
from auvbench.metrics import POINTS, column


@dataclass(kw_only=True)
class Rendezvous(Docking):
    """Keys of the task rendezvous: enter the dock of a moving vehicle."""

    course_speed_low: float = number(0.0, 10.0)  # m/s
    course_speed_high: float = number(0.0, 10.0)  # m/s

    def check(self) -> None:
        super().check()
        below(
            "task.course_speed_low",
            self.course_speed_low,
            "task.course_speed_high",
            self.course_speed_high,
        )

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        # In the last step, the vehicle and the dock may move apart, so their largest speeds add up.
        return super().farthest(speed + self.course_speed_high, seconds, frequency)


SPEC = TaskSpec(
    "rendezvous",
    "rendezvous",
    "auvbench.tasks.rendezvous:RendezvousTask",
    "par1_time_s",
    (*ERRORS, "goal_error"),
    FOUR_ENDS,
    ("goal", "tracking", "exponential"),
    schema=Rendezvous,
    goal="dock when the time is up",
    shared=("yaw_error_rms_rad", *POINTS),
    metrics=(
        column(
            "final_gap_m",
            "m",
            "final gap",
            "distance to the moving dock at the end; a failed episode counts as the bounds",
            failed="bounds",
        ),
        column(
            "final_relative_speed_m_per_s",
            "m/s",
            "final relative speed",
            "speed relative to the moving dock at the end",
        ),
        column(
            "final_course_error_rad",
            "rad",
            "final course error",
            "yaw less the course of the moving dock, at the end; a failed episode counts as pi",
            high=math.pi,
            failed="high",
        ),
    ),
)
