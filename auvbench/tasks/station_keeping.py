"""Station keeping: hold a position and a yaw (docs/task.md)."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config.tasks.station_keeping import StationKeeping
from auvbench.tasks import fingerprint
from auvbench.tasks.base import TrackingTask
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
    TIMEOUT,
    Vehicle,
    add_errors,
    drawn,
    leaves_water,
    put,
    row,
    start_in_ball,
    triple,
    wrap,
)


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Set the reference to the station and draw the start; return the yaw at the start."""
    u0, u1, u2, u3 = drawn(e, stream, 0)
    put(e.reference, triple(p.station))
    put(e.reference_velocity, (0.0, 0.0, 0.0))
    e.reference_yaw = p.yaw
    start_in_ball(e, p.start_radius, p, u1, u2, u3)
    return wrap(2.0 * math.pi * u0)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    inside = e.distance < p.tolerance and abs(e.yaw_error) < p.yaw_tolerance
    if not inside:
        e.last_outside = e.steps
    elif e.steps > p.max_steps - p.hold_steps:
        e.held += 1.0
    if e.steps > p.settling_steps:
        add_errors(e)
    if leaves_water(v, p):
        return COLLISION
    if e.distance > p.bounds:
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return SUCCESS if e.held >= p.hold_share * p.hold_steps else TIMEOUT
    return GOES_ON


class StationKeepingTask(TrackingTask):
    """N episodes of station keeping."""

    draw = staticmethod(draw)
    step = staticmethod(step)
    fields = (
        ("held", "f8"),  # number of steps within the tolerances in the last `hold_time`
        ("last_outside", "f8"),  # number of the last step outside the tolerances
    )
    reference_columns = (*fingerprint.COLUMNS, "position_error_rms_m", "yaw_error_rms_rad", "settling_time_s")
    reference_blocks = fingerprint.BLOCKS
    success_ends = False

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, StationKeeping)
        settling, hold = (round(seconds * self.frequency) for seconds in (task.settling, task.hold_time))
        return {**super().own_parameters(task), "settling_steps": settling, "hold_steps": hold}

    def own_metrics(self, i: int) -> dict[str, float]:
        return {
            **self.errors(i, self.limits["bounds"]),
            "settling_time_s": float(self.episodes[i].last_outside) * self.duration,
        }
