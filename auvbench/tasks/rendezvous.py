"""Rendezvous: enter the dock at the stern of a vehicle that moves along a straight line (docs/moving-targets.md).

The task is docking in the axes of the other vehicle; the relative velocity replaces the velocity. The other vehicle keeps its course and
speed in moving water too. The other vehicle is a point on a line and not a simulated vehicle, so that the results do not depend on a
second controller.
"""

from __future__ import annotations

import math

import numpy as np

from auvbench.tasks import docking
from auvbench.tasks.base import Floats
from auvbench.tasks.docking import DockingTask
from auvbench.tasks.records import Record
from auvbench.tasks.rows import Vehicle, between, drawn, put, row, triple, world_velocity

draw_dock, approach, judged = docking.draw, docking.refer, docking.judged


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw course and speed of the other vehicle, and the start; return the yaw at the start."""
    heading = draw_dock(e, p, stream)
    fast, _, _, _ = drawn(e, stream, 2)
    speed = p.course_speed_low + (p.course_speed_high - p.course_speed_low) * fast
    put(e.reference_velocity, (speed * math.cos(e.reference_yaw), speed * math.sin(e.reference_yaw), 0.0))
    return heading


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Move the dock along its course, and write the reference for the vehicle's present position."""
    (x, y, z), (vx, vy, vz), time = triple(p.dock), triple(e.reference_velocity), e.steps * p.duration
    put(e.goal, (x + vx * time, y + vy * time, z + vz * time))
    approach(e, v, p)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    e.speed = between(world_velocity(v), triple(e.reference_velocity))
    return int(judged(e, v, p))


class RendezvousTask(DockingTask):
    """N episodes of rendezvous."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    reference_columns = (
        *(
            name
            for name in DockingTask.reference_columns
            if not name.startswith("final_") or name == "final_distance_m"
        ),
        "final_gap_m",
        "final_relative_speed_m_per_s",
        "final_course_error_rad",
    )

    def goal(self, i: int) -> Floats:
        """Return the position of the dock (3,) in m at the time limit."""
        p = self.parameters[0]
        seconds = float(p.max_steps) * self.duration
        return np.asarray(p.dock + self.episodes[i].reference_velocity * seconds)

    def dock_yaw(self, i: int) -> None:
        """Return None: pictures show the moving reference, not a dock at rest."""

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        return {
            **self.errors(i, 0.0),
            "final_gap_m": float(e.dock_distance),
            "final_relative_speed_m_per_s": float(e.speed),
            "final_course_error_rad": float(e.dock_yaw_error),
        }
