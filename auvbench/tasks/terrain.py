"""Terrain following: hold an altitude over the bottom along a line (docs/transit.md).

The reference moves along the line at the task's speed and at the vehicle's depth. The position error therefore does not contain the
altitude, which only a range sensor measures.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auvbench.config.tasks.terrain import Terrain
from auvbench.tasks import fingerprint
from auvbench.tasks.base import Floats, TrackingTask
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
    triple,
    wrap,
)
from auvbench.worlds.casting import range_below

DEEPEST = 1e4
"""Largest measured altitude, m; also the altitude if no bottom is below the vehicle"""


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the course of the line and the vehicle's initial yaw; return the initial yaw."""
    course, turn, _, _ = drawn(e, stream, 0)
    e.reference_yaw = wrap(2.0 * math.pi * course)
    put(e.start, triple(p.start))
    along = p.speed * math.cos(e.reference_yaw), p.speed * math.sin(e.reference_yaw), 0.0
    put(e.reference_velocity, along)
    relocate(e, p)
    return wrap(e.reference_yaw + p.turn * (2.0 * turn - 1.0))


@row
def relocate(e: Record, p: Record) -> None:
    """Let the line begin at `e.start`."""
    put(e.reference, triple(e.start))


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Move the reference along the line, at the depth of the vehicle."""
    (x, y, _), (vx, vy, _), (_, _, z) = triple(e.start), triple(e.reference_velocity), v.position
    time = e.steps * p.duration
    put(e.reference, (x + vx * time, y + vy * time, z))


@row
def look(e: Record, v: Vehicle, p: Record, solids: Any, heights: Any) -> None:
    """Measure the altitude error; write its magnitude to `e.detour`, which rewards read."""
    time = e.steps * p.duration
    e.altitude_error = range_below(solids[: e.solids], heights, time, v.position, DEEPEST) - p.altitude
    e.detour = abs(e.altitude_error)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    if e.steps > p.settling_steps:
        add_errors(e)
        e.altitude_squared_sum += e.altitude_error * e.altitude_error
    if leaves_water(v, p):
        return COLLISION
    if e.distance > p.bounds or abs(e.altitude_error) > p.bounds:
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return SUCCESS if e.altitude_squared_sum <= p.tolerance**2 * e.counted else TIMEOUT
    return GOES_ON


class TerrainTask(TrackingTask):
    """N episodes of terrain following."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    look = staticmethod(look)
    step = staticmethod(step)
    relocate = staticmethod(relocate)
    fields = (
        ("altitude_error", "f8"),  # m, altitude minus the altitude to hold
        ("altitude_squared_sum", "f8"),  # m^2
    )
    reference_columns = (*fingerprint.COLUMNS, "yaw_error_rms_rad", "altitude_error_rms_m")
    reference_blocks = fingerprint.BLOCKS
    success_ends = False

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, Terrain)
        return {**super().own_parameters(task), "settling_steps": round(task.settling * self.frequency)}

    def goal(self, i: int) -> Floats:
        """Return the end of the line (3,) in m, at the depth of the start."""
        e, p = self.episodes[i], self.parameters[0]
        return np.asarray(e.start + e.reference_velocity * (float(p.max_steps) * self.duration))

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        lost = e.outcome in (COLLISION, OUT_OF_BOUNDS)
        squared = float(e.altitude_squared_sum) / max(float(e.counted), 1.0)
        bounds = self.limits["bounds"]
        return {**self.errors(i, bounds), "altitude_error_rms_m": bounds if lost else math.sqrt(squared)}
