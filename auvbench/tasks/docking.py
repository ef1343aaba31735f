"""Docking: enter a dock from the front (docs/task.md).

If the vehicle is near the axis in front of the dock, the reference is the dock; otherwise it is a point in front of
the dock. For a vehicle at the side of the dock or behind it, the point is on a circle round the dock, so that the
path to the reference never leads through the dock.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from auvbench.tasks import fingerprint
from auvbench.tasks.base import Floats, Task, TrackingTask
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
    TIMEOUT,
    Vector,
    Vehicle,
    add_errors,
    drawn,
    leaves_water,
    put,
    rise,
    roll_pitch,
    row,
    triple,
    wrap,
)

ALIGNED = 1.0 / 3.0
"""Largest angle to the dock's axis at which the reference is the dock, as a fraction of the cone's angle"""
TURNED = 2.0
"""Smallest angle to the dock's axis at which the reference leads round the dock, as a multiple of the cone's angle"""


@row
def seen_from_dock(e: Record, position: Vector) -> tuple[float, float]:
    """Return a position's distance from the dock in m, and its angle to the dock's axis in rad."""
    (x, y, z), (dock_x, dock_y, dock_z) = position, triple(e.goal)
    dx, dy, dz = x - dock_x, y - dock_y, z - dock_z
    yaw = e.reference_yaw
    # The axis points out of the dock, opposite to the direction in which a vehicle enters.
    along = -dx * math.cos(yaw) - dy * math.sin(yaw)
    squared = dx * dx + dy * dy + dz * dz
    return math.sqrt(squared), math.atan2(math.sqrt(max(squared - along * along, 0.0)), along)


@row
def lead(e: Record, position: Vector, distance: float, angle: float, p: Record) -> None:
    """Write the reference for a vehicle at a position, and `e.detour`, the length in m of the way from the reference to the dock.

    `distance` (m) and `angle` (rad) are the result of `seen_from_dock` for this position.
    """
    (x, y, z), (dock_x, dock_y, dock_z) = position, triple(e.goal)
    yaw, cone = e.reference_yaw, p.cone
    ax, ay = -math.cos(yaw), -math.sin(yaw)
    along = distance * math.cos(angle)
    # Vector from the axis to the vehicle, which `aside` normalises; to starboard if the vehicle is on the axis.
    lx, ly, lz = x - dock_x - along * ax, y - dock_y - along * ay, z - dock_z
    length = math.sqrt(lx * lx + ly * ly + lz * lz)
    if length < 1e-6:
        lx, ly, lz, length = -ay, ax, 0.0, 1.0
    turn = max(0.0, angle - TURNED * cone)
    far = min(1.0, max(0.0, (angle - ALIGNED * cone) / (cone - ALIGNED * cone)))
    if angle < cone:
        far *= min(1.0, along / p.standoff)
    out = p.standoff * far * math.cos(turn)
    aside = p.standoff * far * math.sin(turn) / length
    put(e.reference, (dock_x + out * ax + aside * lx, dock_y + out * ay + aside * ly, dock_z + aside * lz))
    e.detour = p.standoff * far * (1.0 + turn)


@row
def tilted(v: Vehicle, p: Record) -> bool:
    """Return whether roll or pitch is larger than the task allows."""
    if p.tilt >= math.pi:
        return False
    roll, pitch = roll_pitch(v)
    return bool(abs(roll) > p.tilt or abs(pitch) > p.tilt)


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the dock's yaw and the start; return the yaw at the start."""
    heading, far, high, bearing = drawn(e, stream, 0)
    turned, _, _, _ = drawn(e, stream, 1)
    dock_x, dock_y, dock_z = triple(p.dock)
    distance = p.start_low + (p.start_high - p.start_low) * far
    up = distance * rise(high, dock_z, distance, p)
    level = math.sqrt(distance * distance - up * up)
    put(
        e.start,
        (
            dock_x + level * math.cos(2.0 * math.pi * bearing),
            dock_y + level * math.sin(2.0 * math.pi * bearing),
            dock_z + up,
        ),
    )
    put(e.goal, (dock_x, dock_y, dock_z))
    put(e.reference_velocity, (0.0, 0.0, 0.0))
    e.reference_yaw = wrap(2.0 * math.pi * turned)
    relocate(e, p)
    e.dock_distance = distance
    return wrap(2.0 * math.pi * heading)


@row
def relocate(e: Record, p: Record) -> None:
    """Write the reference and the distance from the dock for an episode that begins at `e.start`."""
    e.dock_distance, angle = seen_from_dock(e, triple(e.start))
    lead(e, triple(e.start), e.dock_distance, angle, p)


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Write the reference for the vehicle's present position."""
    e.dock_distance, e.dock_angle = seen_from_dock(e, v.position)
    lead(e, v.position, e.dock_distance, e.dock_angle, p)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    surge, sway, heave = v.velocity
    e.speed = math.sqrt(surge**2 + sway**2 + heave**2)
    return int(judged(e, v, p))


@row
def judged(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of a step with the speed `e.speed` relative to the dock, or GOES_ON."""
    e.dock_yaw_error = abs(e.yaw_error)
    add_errors(e)
    if leaves_water(v, p):
        return COLLISION
    if e.dock_distance < p.tolerance and e.dock_yaw_error < p.yaw_tolerance and e.speed < p.speed:
        return SUCCESS
    if e.dock_distance < p.clearance and e.dock_angle > p.cone:
        return COLLISION
    if e.dock_distance > p.bounds or tilted(v, p):
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return TIMEOUT
    return GOES_ON


class DockingTask(TrackingTask):
    """N episodes of docking."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    relocate = staticmethod(relocate)
    fields = (
        ("dock_distance", "f8"),  # m, present distance from the dock
        ("dock_yaw_error", "f8"),  # rad, present yaw error, absolute value
        ("speed", "f8"),  # m/s, present speed relative to the dock
        ("dock_angle", "f8"),  # rad, present angle to the dock's axis
    )
    transient = ("dock_angle",)
    reference_columns: ClassVar[tuple[str, ...]] = (
        *fingerprint.COLUMNS,
        "yaw_error_rms_rad",
        "final_position_error_m",
        "final_speed_m_per_s",
        "final_yaw_error_rad",
    )
    reference_blocks = (*fingerprint.BLOCKS, "goal_error")

    def goal(self, i: int) -> Floats:
        return np.array(self.episodes[i].goal)

    def dock_yaw(self, i: int) -> float | None:
        return float(self.episodes[i].reference_yaw)

    def misplaced(self, i: int) -> str:
        p, e = self.parameters[0], self.episodes[i]
        way, yaw = e.goal - e.start, float(e.reference_yaw)
        distance = float(np.linalg.norm(way))
        if distance > p.bounds:
            return f"is {distance:g} m from the dock; must be at most task.bounds={p.bounds:g} m"
        ahead = way[0] * math.cos(yaw) + way[1] * math.sin(yaw)
        if distance < p.clearance and ahead < distance * math.cos(p.cone):
            return (
                f"is {distance:g} m from the dock, outside of the cone in front of it; must be at least "
                f"task.clearance={p.clearance:g} m there"
            )
        return Task.misplaced(self, i)

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        return {
            **self.errors(i, 0.0),
            "final_position_error_m": float(e.dock_distance),
            "final_yaw_error_rad": float(e.dock_yaw_error),
            "final_speed_m_per_s": float(e.speed),
        }
