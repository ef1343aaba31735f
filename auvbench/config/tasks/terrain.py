"""Define the task terrain: its schema and its spec; the code is `tasks/terrain.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.schema import number
from auvbench.config.tasks import ERRORS, FOUR_ENDS, TaskSpec, Tracked
from auvbench.metrics import column


@dataclass(kw_only=True)
class Terrain(Tracked):
    """Keys of the task terrain: hold an altitude over the bottom along a line."""

    start: list[float]
    altitude: float = number(0.1, 100.0)  # m
    speed: float = number(0.0, 10.0)  # m/s
    turn: float = number(0.0, math.pi)  # rad
    settling: float = number(0.0, 1e7)  # s
    tolerance: float = number(0.0, 1e3, open_low=True)  # m

    def check_length(self, frequency: float) -> None:
        """Reject a settling time after which no step of an episode is left."""
        steps, length = feasible.length(self, frequency)
        why = "the RMS errors exclude that time and need at least one step"
        late = round(self.settling * frequency) >= steps
        feasible.refuse(late, "settling", self, f"be less than {length}", why)


SPEC = TaskSpec(
    "terrain",
    "terrain following",
    "auvbench.tasks.terrain:TerrainTask",
    "mean_altitude_error_rms_m",
    ERRORS,
    FOUR_ENDS,
    ("tracking", "exponential"),
    schema=Terrain,
    fixed_start=True,
    bottom=True,
    metrics=(
        column(
            "altitude_error_rms_m",
            "m",
            "RMS altitude error",
            "root mean square after task.settling; a failed episode counts as the bounds",
            failed="bounds",
        ),
    ),
)
