"""Path following: follow a smooth path at a given speed (docs/task.md).

Cubic Hermite curves with the slopes of Catmull and Rom (1974) join the points of the path. The reference is the
closest point of the path, with the given speed along the tangent.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auvbench.config.tasks.path_following import PathFollowing
from auvbench.tasks import fingerprint
from auvbench.tasks.base import Floats, TrackingTask
from auvbench.tasks.records import Record
from auvbench.tasks.rows import (
    COLLISION,
    GOES_ON,
    OUT_OF_BOUNDS,
    SHALLOWEST,
    SUCCESS,
    TIMEOUT,
    Vector,
    Vehicle,
    add_errors,
    between,
    drawn,
    leaves_water,
    put,
    row,
    start_in_ball,
    triple,
    world_velocity,
    wrap,
)

MOST_POINTS = 16
DEPTH_MARGIN = 5.0
"""Distance from a depth limit at which a path turns back, m"""
SAMPLES = 16
"""Number of points per segment of the path among which the closest point is searched"""


@row
def hermite(e: Record, progress: float, axis: int, last: int) -> tuple[float, float]:
    """Return position and slope (per unit of progress) of the path along an axis; `last` is the index of the path's last point."""
    k = min(max(int(progress), 0), last - 1)
    s = progress - k
    p, q = e.points[k, axis], e.points[k + 1, axis]
    m = 0.5 * (q - e.points[k - 1, axis]) if k > 0 else q - p
    n = 0.5 * (e.points[k + 2, axis] - p) if k < last - 1 else q - p
    a = 2.0 * (p - q) + m + n
    b = 3.0 * (q - p) - 2.0 * m - n
    return p + s * (m + s * (b + s * a)), m + s * (2.0 * b + 3.0 * s * a)


@row
def path(e: Record, progress: float, last: int) -> tuple[Vector, Vector]:
    """Return position and slope of the path."""
    x, vx = hermite(e, progress, 0, last)
    y, vy = hermite(e, progress, 1, last)
    z, vz = hermite(e, progress, 2, last)
    return (x, y, z), (vx, vy, vz)


@row
def project(e: Record, position: Vector, last: int) -> None:
    """Move the progress to the point of the path that is closest to a position, by two Gauss-Newton steps."""
    x, y, z = position
    progress = e.progress
    for _ in range(2):
        (px, py, pz), (vx, vy, vz) = path(e, progress, last)
        along = vx * (x - px) + vy * (y - py) + vz * (z - pz)
        squared = 1e-12 + vx * vx + vy * vy + vz * vz
        progress += min(0.25, max(-0.25, along / squared))
        progress = min(float(last), max(0.0, progress))
    e.progress = progress


@row
def search(e: Record, last: int, farthest: float) -> None:
    """Set the progress to the point of the path that is closest to the start; search up to the progress `farthest`."""
    x, y, z = triple(e.start)
    nearest = math.inf
    for sample in range(SAMPLES * last + 1):
        progress = sample / SAMPLES
        if progress > farthest:
            break
        (px, py, pz), _ = path(e, progress, last)
        squared = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
        if squared < nearest:
            nearest = squared
            e.progress = progress
    for _ in range(2):
        project(e, (x, y, z), last)


@row
def follow(e: Record, last: int, p: Record) -> None:
    """Set the reference to the point of the path at `e.progress`; at the end of the path, the reference's velocity is 0."""
    place, (vx, vy, vz) = path(e, e.progress, last)
    scale = p.speed / math.sqrt(1e-12 + vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * scale, vy * scale, vz * scale
    put(e.reference, place)
    put(e.reference_velocity, (vx, vy, vz))
    e.reference_yaw = math.atan2(vy, vx)
    if e.progress >= last:
        put(e.reference_velocity, (0.0, 0.0, 0.0))


@row
def preview_row(e: Record, p: Record, points: Floats) -> None:
    """Write the future positions of the reference."""
    last, progress = p.waypoints - 1, e.progress
    for k in range(points.shape[0]):
        _, (vx, vy, vz) = path(e, progress, last)
        squared = 1e-12 + vx**2 + vy**2 + vz**2
        progress = min(float(last), progress + p.speed * p.preview_interval / math.sqrt(squared))
        place, _ = path(e, progress, last)
        put(points[k], place)


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the path and the start; return the yaw at the start."""
    heading, u, v, w = drawn(e, stream, 0)
    draw_path(e, p, stream)
    last = p.waypoints - 1
    follow(e, last, p)
    start_in_ball(e, p.start_radius, p, u, v, w)
    # The search is limited to the ball of starts round the first point, because a path may return to its beginning.
    search(e, last, 1.0 + 2.0 * p.start_radius / p.spacing)
    follow(e, last, p)
    return wrap(2.0 * math.pi * heading)


@row
def draw_path(e: Record, p: Record, stream: int) -> None:
    """Draw the points of the path."""
    low, high = p.depth_low + p.depth_distance, p.depth_high - p.depth_distance
    course = 0.0
    x, y, z = triple(p.start)
    for k in range(p.waypoints):
        put(e.points[k], (x, y, z))
        bearing, slope, _, _ = drawn(e, stream, 1 + k)
        course = 2.0 * math.pi * bearing if k == 0 else course + p.turn * (2.0 * bearing - 1.0)
        climb = p.climb * (2.0 * slope - 1.0)
        # If a point is nearer to a depth limit than the margin, the next point must not be even nearer.
        bottom, top = min(low, z), max(high, z)
        height = z + p.spacing * math.sin(climb)
        if height < bottom or height > top:
            height = z - p.spacing * math.sin(climb)
        if height < bottom or height > top:
            height = min(top, max(bottom, height))
            climb = math.asin((height - z) / p.spacing)
        x += p.spacing * math.cos(climb) * math.cos(course)
        y += p.spacing * math.cos(climb) * math.sin(course)
        z = height


@row
def relocate(e: Record, p: Record) -> None:
    """Set progress and reference to the point of the path that is closest to the start."""
    last = p.waypoints - 1
    search(e, last, float(last))
    follow(e, last, p)


@row
def refer(e: Record, v: Vehicle, p: Record) -> None:
    """Add the error of the speed along the path to `e.speed_error_sum`, and move the reference."""
    last = p.waypoints - 1
    (vx, vy, vz), (wx, wy, wz) = triple(e.reference_velocity), world_velocity(v)
    along = vx * wx + vy * wy + vz * wz
    squared = 1e-12 + vx * vx + vy * vy + vz * vz
    asked = p.speed if e.progress < last else 0.0
    e.speed_error_sum += abs(along / math.sqrt(squared) - asked)
    project(e, v.position, last)
    follow(e, last, p)


@row
def step(e: Record, v: Vehicle, p: Record) -> int:
    """Return the outcome of an agent step, or GOES_ON."""
    last = p.waypoints - 1
    add_errors(e)
    if leaves_water(v, p):
        return COLLISION
    if e.distance > p.bounds:
        return OUT_OF_BOUNDS
    if e.progress > last - 0.5 and between(triple(e.points[last]), v.position) < p.goal_radius:
        return SUCCESS
    if e.steps >= p.max_steps:
        return TIMEOUT
    return GOES_ON


class PathFollowingTask(TrackingTask):
    """N episodes of path following."""

    draw = staticmethod(draw)
    refer = staticmethod(refer)
    step = staticmethod(step)
    preview_row = staticmethod(preview_row)
    relocate = staticmethod(relocate)
    fields = (
        ("points", "f8", (MOST_POINTS, 3)),  # m
        ("progress", "f8"),  # 0 at the first point, 1 at the second, and so on
        ("speed_error_sum", "f8"),  # m/s, sum over steps of the absolute error of the speed along the path
    )
    reference_columns = (
        *fingerprint.COLUMNS,
        "cross_track_rms_m",
        "yaw_error_rms_rad",
        "completion",
        "speed_error_m_per_s",
    )
    reference_blocks = fingerprint.BLOCKS

    def own_parameters(self, task: Any) -> dict[str, Any]:
        assert isinstance(task, PathFollowing)
        distance = max(DEPTH_MARGIN, SHALLOWEST + task.overshoot)
        return {**super().own_parameters(task), "depth_distance": distance}

    def goal(self, i: int) -> Floats:
        return np.array(self.episodes[i].points[self._last()])

    def line(self, i: int) -> Floats:
        from scipy.interpolate import CubicHermiteSpline  # imported late: takes a quarter of a second

        points = np.array(self.episodes[i].points[: self._last() + 1])
        # The slopes of Catmull and Rom are central differences, and one-sided differences at the ends.
        curve = CubicHermiteSpline(np.arange(len(points)), points, np.gradient(points, axis=0))
        return np.asarray(curve(np.linspace(0.0, self._last(), SAMPLES * self._last() + 1)))

    def _last(self) -> int:
        """Return the index of the last waypoint."""
        return int(self.parameters[0].waypoints) - 1

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        bounds = self.limits["bounds"]
        errors = self.errors(i, bounds)
        reached = e.outcome == SUCCESS
        speed_error = float(e.speed_error_sum) / float(e.counted)
        return {
            **errors,
            "cross_track_rms_m": errors["position_error_rms_m"] if reached else bounds,
            "completion": 1.0 if reached else float(e.progress) / self._last(),
            # If the vehicle does not reach the end, the speed error is set to at least the error of a vehicle at rest.
            "speed_error_m_per_s": speed_error
            if reached
            else max(speed_error, float(self.parameters[0].speed)),
        }
