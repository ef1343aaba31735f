"""Define the task formation: its schema and its spec; the code is `tasks/formation.py`."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

from auvbench.config import feasible
from auvbench.config.ranges import SOUND
from auvbench.config.schema import choice, number
from auvbench.config.tasks import ERRORS, TRACKING, TaskSpec
from auvbench.config.tasks.trajectory_tracking import TrajectoryTracking
from auvbench.errors import ConfigError
from auvbench.metrics import column

MOST = 8
"""largest number of vehicles in a team"""
HEADER, PER_BYTE, OVERHEAD = 0.105, 0.0125, 16
"""Time of a message's header in s, time per byte in s, and overhead of each message in bytes: the acoustic nanomodem of MARUS
(Loncar et al., "MARUS - a marine robotics simulator", OCEANS 2022)
"""


@dataclass(kw_only=True)
class Formation(TrajectoryTracking):
    """Keys of the task formation: several vehicles keep their relative poses along a curve."""

    curve: str = choice("circle", "helix", "lemniscate", "any")
    vehicles: int = number(1, MOST)
    spacing: float = number(0.0, 100.0, open_low=True)  # m
    slots: list[Any]  # [x, y, z] each, in units of `spacing`
    radius: float = number(0.0, 10.0, open_low=True)  # m
    tilt: float = number(0.0, math.pi, open_low=True)  # rad
    messages: str = choice("acoustic", "ideal")
    message_bytes: int = number(1, 1024)
    message_loss: float = number(0.0, 1.0)

    @property
    def team(self) -> int:
        return self.vehicles

    @property
    def places(self) -> list[tuple[float, ...]]:
        """Positions of the vehicles' slots in m, in the axes of the leader's reference."""
        return [tuple(self.spacing * value for value in slot) for slot in self.slots[: self.vehicles]]

    @property
    def transmission(self) -> float:
        """Time in s that a vehicle needs to send a message."""
        return HEADER + PER_BYTE * (self.message_bytes + OVERHEAD)

    @property
    def turn_time(self) -> float:
        """Time in s between two messages: a vehicle sends only after all vehicles have received the previous message."""
        longest = max(math.dist(a, b) for a in self.places for b in self.places) + 2.0 * self.bounds
        return self.transmission + longest / SOUND

    def check(self) -> None:
        super().check()
        for slot in self.slots:
            good = isinstance(slot, list) and len(slot) == 3 and all(map(_is_number, slot))
            feasible.refuse(
                not good, "slots", self, "be a list of slots, each of them three finite numbers [x, y, z]"
            )
        if self.vehicles > len(self.slots):
            raise ConfigError(
                f"task.vehicles={self.vehicles}: must be at most {len(self.slots)}, the number of task.slots"
            )
        if self.messages == "ideal" and self.message_loss > 0.0:
            raise ConfigError(
                f"task.message_loss={self.message_loss:g}: messages=ideal loses none; use task.messages=acoustic, or task.message_loss=0"
            )
        nearest = min((math.dist(a, b) for a, b in itertools.combinations(self.places, 2)), default=math.inf)
        if nearest <= 2.0 * (self.radius + self.start_radius):
            raise ConfigError(
                f"task.spacing={self.spacing:g}: puts two slots {nearest:g} m apart; their distance must be more than "
                f"{2.0 * (self.radius + self.start_radius):g} m, twice the sum of task.radius and task.start_radius"
            )

    def check_length(self, frequency: float) -> None:
        """Reject depth limits that are too narrow for the formation, and agent steps that are too long for the messages."""
        super().check_length(frequency)
        for _, _, z in self.places:
            inside = self.depth_low <= self.centre[2] + z <= self.depth_high
            feasible.refuse(not inside, "slots", self, "be within the depth limits at the curve's centre")
        least = 1.0 / (max(self.vehicles - 1, 1) * self.turn_time)
        if self.messages == "acoustic" and self.vehicles > 1 and frequency < least:
            raise ConfigError(
                f"step.frequency={frequency:g}: must be at least {least:.3g} Hz with task.vehicles={self.vehicles}, so that "
                "no vehicle sends two messages in a step"
            )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


SPEC = TaskSpec(
    "formation",
    "formation",
    "auvbench.tasks.formation:FormationTask",
    "mean_formation_error_rms_m",
    (*ERRORS, "preview", "slot", "messages"),
    ("success", "collision", "out_of_bounds"),
    TRACKING,
    schema=Formation,
    metrics=(
        column(
            "formation_error_rms_m",
            "m",
            "RMS formation error",
            "root mean square of the errors of the relative positions, over all pairs of vehicles and steps; a failed episode "
            "counts as the bounds; 0 for a single vehicle",
            failed="bounds",
        ),
        column(
            "worst_edge_rms_m",
            "m",
            "worst edge",
            "largest root mean square of the error of a relative position among the pairs of vehicles; a failed episode counts "
            "as the bounds",
            failed="bounds",
        ),
        column(
            "separation_min_m",
            "m",
            "smallest separation",
            "smallest distance between two vehicles; 0 for a single vehicle",
            "higher",
        ),
        column(
            "vehicles_collided",
            "1",
            "collided vehicles",
            "1 if two vehicles of the team collided",
            high=1.0,
        ),
        column(
            "message_age_s",
            "s",
            "age of messages",
            "mean age of the last message from each of the other vehicles; 0 for a single vehicle",
        ),
    ),
)
