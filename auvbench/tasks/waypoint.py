"""The waypoint task: reach the goal radius of a point (section 3 of the original study; docs/task.md)."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config.tasks.waypoint import Waypoint
from auvbench.tasks.base import Task
from auvbench.tasks.records import Record
from auvbench.tasks.rows import Vehicle, arrival, drawn, put, row, triple, wrap

REFERENCE_COLUMNS = (
    "episode",
    "environment",
    "outcome",
    "steps",
    "duration_s",
    "return",
    "initial_distance_m",
    "final_distance_m",
    "deviation_mean_m",
    "deviation_std_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
    "path_length_m",
    "path_efficiency",
    "smoothness_per_s",
    "depth_margin_m",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the yaw at the start and the waypoint; return the yaw."""
    heading, u, v, w = drawn(e, stream, 0)
    (low_x, low_y, low_z), (high_x, high_y, high_z) = triple(p.waypoint_low), triple(p.waypoint_high)
    put(
        e.reference,
        (low_x + (high_x - low_x) * u, low_y + (high_y - low_y) * v, low_z + (high_z - low_z) * w),
    )
    put(e.start, triple(p.start))
    return wrap(2.0 * math.pi * heading)


@row
def deviation(e: Record, v: Vehicle) -> float:
    """Return the perpendicular distance to the line start-waypoint: |(p - a) x (b - a)| / |b - a|."""
    (ax, ay, az), (bx, by, bz), (px, py, pz) = triple(e.start), triple(e.reference), v.position
    bx, by, bz = bx - ax, by - ay, bz - az
    px, py, pz = px - ax, py - ay, pz - az
    cx, cy, cz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
    length_squared = bx * bx + by * by + bz * bz
    if length_squared > 0.0:
        return math.sqrt((cx * cx + cy * cy + cz * cz) / length_squared)
    return math.sqrt(px * px + py * py + pz * pz)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    off = deviation(e, v)
    e.deviation_sum += off
    e.deviation_squared_sum += off * off
    return arrival(e, v, p)


class WaypointTask(Task):
    """N episodes of the waypoint task."""

    draw = staticmethod(draw)
    step = staticmethod(step)
    reference_columns = REFERENCE_COLUMNS
    reference_blocks = ("yaw_error", "position_error", "previous_action")
    reference_key = "waypoint"

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, Waypoint)
        # Waypoints are drawn in the part of the box within the depth limits, because other waypoints cannot be reached.
        low, high = [*task.waypoint_low], [*task.waypoint_high]
        low[2], high[2] = max(low[2], task.depth_low), min(high[2], task.depth_high)
        return {**super().own_parameters(task), "waypoint_low": low, "waypoint_high": high}

    def own_metrics(self, i: int) -> dict[str, float]:
        x, y, z = self.reference[i].tolist()
        return {"waypoint_x_m": x, "waypoint_y_m": y, "waypoint_z_m": z}
