"""Define the task station keeping: its schema and its spec; the code is `tasks/station_keeping.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.schema import number
from auvbench.config.tasks import ERRORS, FOUR_ENDS, TRACKING, TaskSpec, Tracked
from auvbench.metrics import column


@dataclass(kw_only=True)
class StationKeeping(Tracked):
    """Keys of the task station keeping: hold a position and a yaw."""

    station: list[float]
    yaw: float = number(-math.pi, math.pi)  # rad
    start_radius: float = number(0.0, 1e4)  # m
    tolerance: float = number(0.0, 1e3, open_low=True)  # m
    yaw_tolerance: float = number(0.0, math.pi, open_low=True)  # rad
    settling: float = number(0.0, 1e7)  # s
    hold_time: float = number(0.0, 1e7, open_low=True)  # s
    hold_share: float = number(0.0, 1.0)

    def check(self) -> None:
        feasible.at_most("start_radius", self, "bounds")

    def check_length(self, frequency: float) -> None:
        """Reject a settling time or a hold time that does not fit into an episode, and a hold time below one step."""
        steps, length = feasible.length(self, frequency)
        why = "the RMS errors exclude that time and need at least one step"
        settling = round(self.settling * frequency)
        feasible.refuse(settling >= steps, "settling", self, f"be less than {length}", why)
        hold_steps = round(self.hold_time * frequency)
        feasible.refuse(hold_steps > steps, "hold_time", self, f"be at most {length}")
        feasible.refuse(hold_steps < 1, "hold_time", self, f"be at least a step, {1 / frequency:g} s")


SPEC = TaskSpec(
    "station_keeping",
    "station keeping",
    "auvbench.tasks.station_keeping:StationKeepingTask",
    "mean_position_error_rms_m",
    ERRORS,
    FOUR_ENDS,
    TRACKING,
    schema=StationKeeping,
    holds=True,
    at_rest=True,
    metrics=(
        column(
            "settling_time_s",
            "s",
            "settling time",
            "time after which position and yaw stay within the tolerances to the end; a failed episode counts as the time limit",
            failed="time",
        ),
    ),
)
