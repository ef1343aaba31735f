"""Trajectory tracking: follow a curve in time (docs/task.md).

Along each axis a curve is a sum of three sines, plus a straight line for the helix:
p(t) = c + b s + sum_j a_j sin(w_j s + f_j), where s = t (drawn speed) / (largest speed of the curve with s = t).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from auvbench.config.tasks.trajectory_tracking import TrajectoryTracking
from auvbench.tasks import fingerprint
from auvbench.tasks.base import Floats, TrackingTask
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SUCCESS,
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

CURVES = ("circle", "helix", "lemniscate", "random", "any")
HELIX, LEMNISCATE, ANY = 1, 2, 4
SMOOTH = 3
"""Number of curves that are not random; they come first in CURVES"""

X, Y, Z = range(3)
SINES = 3
"""number of sines per axis of a curve"""
TURNS, SAMPLES = 4, 600
"""Number of turns of a curve, and of points on these turns, from which the largest speed is computed"""


@row
def place(e: Record, s: float, axis: int) -> float:
    """Return the position of the curve at s along an axis, m."""
    x = e.centre[axis] + e.slope[axis] * s
    for j in range(SINES):
        x += e.amplitude[axis, j] * math.sin(e.frequency[axis, j] * s + e.phase[axis, j])
    return float(x)


@row
def slope(e: Record, s: float, axis: int) -> float:
    """Return the derivative of `place` with respect to s."""
    v = e.slope[axis]
    for j in range(SINES):
        w = e.frequency[axis, j]
        v += e.amplitude[axis, j] * w * math.cos(w * s + e.phase[axis, j])
    return float(v)


@row
def follow(e: Record, time: float) -> None:
    """Set the reference to the curve at a time in s."""
    s = e.rate * time
    vx, vy, vz = e.rate * slope(e, s, X), e.rate * slope(e, s, Y), e.rate * slope(e, s, Z)
    put(e.reference, (place(e, s, X), place(e, s, Y), place(e, s, Z)))
    put(e.reference_velocity, (vx, vy, vz))
    e.reference_yaw = math.atan2(vy, vx)


@row
def preview_row(e: Record, p: Record, points: Floats) -> None:
    """Write the future positions of the reference."""
    for k in range(points.shape[0]):
        s = e.rate * (e.steps * p.duration + (k + 1) * p.preview_interval)
        put(points[k], (place(e, s, X), place(e, s, Y), place(e, s, Z)))


@row
def sine(e: Record, axis: int, j: int, amplitude: float, frequency: float, phase: float) -> None:
    e.amplitude[axis, j] = amplitude
    e.frequency[axis, j] = frequency
    e.phase[axis, j] = phase


@row
def draw_curve(e: Record, curve: int, size: float, stream: int) -> None:
    """Draw the sines of a curve for s = time; `size` is half the curve's width, m."""
    for axis in range(3):
        for j in range(SINES):
            sine(e, axis, j, 0.0, 1.0, 0.0)
    if curve <= HELIX:
        sine(e, X, 0, size, 1.0, 0.0)
        sine(e, Y, 0, size, 1.0, -0.5 * math.pi)
        if curve == HELIX:
            put(e.slope, (0.0, 0.0, 0.2 * size))
    elif curve == LEMNISCATE:
        sine(e, X, 0, size, 1.0, 0.0)
        sine(e, Y, 0, 0.5 * size, 2.0, 0.0)
    else:
        for axis in range(3):
            for j in range(SINES):
                high, fast, late, _ = drawn(e, stream, 2 + SINES * axis + j)
                level = 1.0 if axis < Z else 0.3
                # Together the three sines stay within the size.
                amplitude = level * size * (0.2 + 0.8 * high) / 3.0
                sine(e, axis, j, amplitude, (j + 1) * (0.8 + 0.4 * fast), 2.0 * math.pi * late)


@row
def fastest(e: Record) -> float:
    """Return the largest speed of the curve with s = time, m/s."""
    most = 0.0
    for sample in range(SAMPLES):
        s = TURNS * 2.0 * math.pi * sample / SAMPLES
        most = max(most, math.sqrt(slope(e, s, X) ** 2 + slope(e, s, Y) ** 2 + slope(e, s, Z) ** 2))
    return most


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the curve, the speed and the start; return the yaw at the start."""
    turned, u, v, w = drawn(e, stream, 0)
    kind, large, fast, _ = drawn(e, stream, 1)
    curve = p.curve
    if curve == ANY:
        curve = int(p.kinds * kind)
    put(e.centre, triple(p.centre))
    draw_curve(e, curve, p.size_low + (p.size_high - p.size_low) * large, stream)
    e.rate = (p.speed_low + (p.speed_high - p.speed_low) * fast) / fastest(e)
    follow(e, 0.0)
    start_in_ball(e, p.start_radius, p, u, v, w)
    return wrap(e.reference_yaw + p.start_yaw * (2.0 * turned - 1.0))


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Move the reference to the present time."""
    follow(e, e.steps * p.duration)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    add_errors(e)
    (x, y, z), (to_x, to_y, to_z), (vx, vy, vz) = (
        v.position,
        triple(e.reference),
        triple(e.reference_velocity),
    )
    along = vx * (to_x - x) + vy * (to_y - y) + vz * (to_z - z)
    # The lag of a reference at rest is 0.
    e.behind += along / (1e-6 + vx * vx + vy * vy + vz * vz)
    if leaves_water(v, p):
        return COLLISION
    if e.distance > p.bounds:
        return OUT_OF_BOUNDS
    if e.steps >= p.max_steps:
        return SUCCESS
    return GOES_ON


class TrajectoryTrackingTask(TrackingTask):
    """N episodes of trajectory tracking."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    preview_row = staticmethod(preview_row)
    fields: ClassVar[tuple[tuple[Any, ...], ...]] = (
        # Parameters of the curve, per axis.
        ("centre", "f8", (3,)),  # m
        ("slope", "f8", (3,)),
        ("amplitude", "f8", (3, SINES)),  # m
        ("frequency", "f8", (3, SINES)),
        ("phase", "f8", (3, SINES)),  # rad
        ("rate", "f8"),  # ds/dt
        (
            "behind",
            "f8",
        ),  # s, sum over steps of the position error along the reference's velocity, divided by the reference's speed
    )
    reference_columns: ClassVar[tuple[str, ...]] = (
        *fingerprint.COLUMNS,
        "position_error_rms_m",
        "yaw_error_rms_rad",
        "lag_s",
    )
    reference_blocks: ClassVar[tuple[str, ...]] = fingerprint.BLOCKS
    success_ends = False

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, TrajectoryTracking)
        return {**super().own_parameters(task), "curve": CURVES.index(task.curve), "kinds": float(ANY)}

    def goal(self, i: int) -> Floats:
        e = self.episodes[i]
        s = e.rate * float(self.parameters[0].max_steps) * self.duration
        sines = np.sin(e.frequency.ravel() * s + e.phase.ravel())
        curve = (e.amplitude.ravel() * sines).reshape(3, SINES).sum(axis=1)
        return np.asarray(e.centre + e.slope * s + curve)

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        return {**self.errors(i, self.limits["bounds"]), "lag_s": float(e.behind) / float(e.counted)}
