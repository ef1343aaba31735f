"""Define the task tracking: its schema and its spec; the code is `tasks/tracking.py`."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config import feasible
from auvbench.config.ranges import SOUND
from auvbench.config.schema import choice, number
from auvbench.config.tasks import ERRORS, TRACKING, TaskSpec
from auvbench.config.tasks.formation import HEADER, OVERHEAD, PER_BYTE
from auvbench.config.tasks.trajectory_tracking import TrajectoryTracking
from auvbench.metrics import column

PRIOR_SDS = 2.5
"""Largest error of the target's estimated position at the start, in standard deviations (`task.prior`)"""


@dataclass(kw_only=True)
class TargetTracking(TrajectoryTracking):
    """Keys of the task target tracking: follow a target by acoustic ranges."""

    curve: str = choice("circle", "helix", "lemniscate", "any")
    orbit: float = number(0.0, 1e3, open_low=True)  # m
    orbit_speed: float = number(0.0, 10.0, open_low=True)  # m/s
    clearance: float = number(0.0, 1e3)  # m
    prior: float = number(0.0, 1e3)  # m
    range_noise: float = number(0.0, 1e3, open_low=True)  # m
    ping_interval: float = number(0.0, 1e3, open_low=True)  # s
    message_bytes: int = number(1, 1024)
    message_loss: float = number(0.0, 1.0)

    @property
    def transmission(self) -> float:
        """Time in s that the target needs to send a ping."""
        return HEADER + PER_BYTE * (self.message_bytes + OVERHEAD)

    @property
    def agility(self) -> float:
        """Spectral density of the target's acceleration that the estimator assumes, m^2/s^3.

        The density is the square of the target's largest centripetal acceleration, times the time in which the reference
        travels the distance `orbit`.
        """
        return (self.speed_high**2 / self.size_low) ** 2 * self.orbit / self.orbit_speed

    def check(self) -> None:
        """Reject starts out of bounds or in a collision, and pings that overlap."""
        what = f"be less than task.bounds={self.bounds:g}"
        feasible.refuse(self.orbit >= self.bounds, "orbit", self, what, "a larger distance is out of bounds")
        most = self.bounds - self.orbit
        what = f"be at most {most:g}, task.bounds less task.orbit"
        feasible.refuse(
            self.start_radius > most,
            "start_radius",
            self,
            what,
            "the start is within task.start_radius of the orbit",
        )
        least = self.clearance + self.start_radius
        what = f"be more than {least:g}, the sum of task.clearance and task.start_radius"
        feasible.refuse(
            self.orbit <= least, "orbit", self, what, "a smaller distance from the target is a collision"
        )
        most = (min(self.bounds - self.orbit, self.orbit - self.clearance) - self.start_radius) / PRIOR_SDS
        why = f"the target may be up to {PRIOR_SDS:g} task.prior nearer to the start, or farther from it, than estimated"
        feasible.refuse(self.prior > most, "prior", self, f"be at most {most:.4g}", why)
        least = self.transmission + 2.0 * self.bounds / SOUND
        what = f"be at least {least:.4g} s, the time in which a ping is sent and arrives"
        feasible.refuse(self.ping_interval < least, "ping_interval", self, what)

    def check_length(self, frequency: float) -> None:
        super().check_length(frequency)
        what = f"be at least {1.0 / frequency:.4g} s, one agent step (step.frequency={frequency:g} Hz)"
        why = "the vehicle hears at most one ping in a step"
        feasible.refuse(self.ping_interval < 1.0 / frequency, "ping_interval", self, what, why)

    def farthest(self, speed: float, seconds: float, frequency: float) -> tuple[float, float, float]:
        # The target's estimated position is within the bounds, and the reference is on a circle round this position.
        most = self.bounds + self.orbit + (speed + self.speed_high + self.orbit_speed) / frequency
        return most, most, most


SPEC = TaskSpec(
    "tracking",
    "target tracking",
    "auvbench.tasks.tracking:TargetTrackingTask",
    "mean_target_error_rms_m",
    (*ERRORS, "target", "pings"),
    ("success", "collision", "out_of_bounds"),
    TRACKING,
    schema=TargetTracking,
    metrics=(
        column(
            "target_error_rms_m",
            "m",
            "RMS target error",
            "root mean square of the distance between the estimated and the true position of the target; a failed episode counts "
            "as the bounds",
            failed="bounds",
        ),
        column(
            "target_distance_max_m",
            "m",
            "largest distance to the target",
            "largest distance between vehicle and target; a failed episode counts as the bounds",
            failed="bounds",
        ),
    ),
)
