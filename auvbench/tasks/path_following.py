"""Path following: along a smooth path at a speed. docs/task.md defines it.

The path goes through its points as cubic Hermite curves with the slopes of Catmull and Rom (1974). The reference is the
point of the path next to the vehicle, with the speed asked for along the tangent.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from auvbench.config import tasks
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.tasks import fingerprint
from auvbench.tasks import kernels as k
from auvbench.tasks.base import Floats, Integers, TrackingTask
from auvbench.tasks.rewards import reward_row

MOST_POINTS = 16

F_POINTS = k.F_OWN  # x, y, z of each, m
F_PROGRESS = k.F_OWN + 3 * MOST_POINTS  # 0 at the first point, 1 at the second, and so on
F_SPEED_ERROR = F_PROGRESS + 1  # sum of m/s

P_START = k.P_OWN  # x, y, z
P_POINTS = k.P_OWN + 3
P_SPACING = k.P_OWN + 4
P_TURN = k.P_OWN + 5
P_CLIMB = k.P_OWN + 6
P_SPEED = k.P_OWN + 7
P_RADIUS = k.P_OWN + 8
P_GOAL = k.P_OWN + 9
P_BOUNDS = k.P_OWN + 10
P_INTERVAL = k.P_OWN + 11
P_MARGIN = k.P_OWN + 12  # m

DEPTH_MARGIN = 5.0
"""m from a depth limit: a path turns back before its points come nearer"""
SAMPLES = 16
"""places of a piece of the path from which the nearest point is searched"""


@njit(nogil=True)
def _hermite(i: int, progress: float, axis: int, last: int, F: Floats) -> tuple[float, float]:
    """Return position and slope (per unit of progress) of the path along an axis; `last`: index of its last point."""
    piece = min(max(int(progress), 0), last - 1)
    s = progress - piece
    at = F_POINTS + 3 * piece + axis
    p, q = F[i, at], F[i, at + 3]
    m = 0.5 * (q - F[i, at - 3]) if piece > 0 else q - p
    n = 0.5 * (F[i, at + 6] - p) if piece < last - 1 else q - p
    a = 2.0 * (p - q) + m + n
    b = 3.0 * (q - p) - 2.0 * m - n
    return p + s * (m + s * (b + s * a)), m + s * (2.0 * b + 3.0 * s * a)


@njit(nogil=True)
def _project(i: int, place: Floats, last: int, F: Floats) -> None:
    """Move the progress to the point of the path next to a place: two steps of Gauss and Newton."""
    progress = F[i, F_PROGRESS]
    for _ in range(2):
        along, squared = 0.0, 1e-12
        for axis in range(3):
            p, v = _hermite(i, progress, axis, last, F)
            along += v * (place[axis] - p)
            squared += v * v
        progress += min(0.25, max(-0.25, along / squared))
        progress = min(float(last), max(0.0, progress))
    F[i, F_PROGRESS] = progress


@njit(nogil=True)
def _search(i: int, last: int, farthest: float, F: Floats) -> None:
    """Put the progress, at most `farthest`, at the point of the path next to F_START."""
    nearest = math.inf
    for sample in range(SAMPLES * last + 1):
        progress = sample / SAMPLES
        if progress > farthest:
            break
        squared = 0.0
        for axis in range(3):
            squared += (_hermite(i, progress, axis, last, F)[0] - F[i, k.F_START + axis]) ** 2
        if squared < nearest:
            nearest = squared
            F[i, F_PROGRESS] = progress
    for _ in range(2):
        _project(i, F[i, k.F_START : k.F_START + 3], last, F)


@njit(nogil=True)
def _refer(i: int, last: int, F: Floats, P: Floats) -> None:
    """Write the reference at the progress, and the previewed points. At the end of the path the reference stands still."""
    squared = 1e-12
    for axis in range(3):
        F[i, k.F_REFERENCE + axis], v = _hermite(i, F[i, F_PROGRESS], axis, last, F)
        F[i, k.F_REFERENCE_VELOCITY + axis] = v
        squared += v * v
    scale = P[P_SPEED] / math.sqrt(squared)
    for axis in range(3):
        F[i, k.F_REFERENCE_VELOCITY + axis] *= scale
    F[i, k.F_REFERENCE_YAW] = math.atan2(F[i, k.F_REFERENCE_VELOCITY + 1], F[i, k.F_REFERENCE_VELOCITY])
    progress = F[i, F_PROGRESS]
    if progress >= last:
        for axis in range(3):
            F[i, k.F_REFERENCE_VELOCITY + axis] = 0.0
    for point in range(int(P[k.P_PREVIEWED])):
        squared = 1e-12
        for axis in range(3):
            squared += _hermite(i, progress, axis, last, F)[1] ** 2
        progress = min(float(last), progress + P[P_SPEED] * P[P_INTERVAL] / math.sqrt(squared))
        for axis in range(3):
            F[i, int(P[k.P_PREVIEW]) + 3 * point + axis] = _hermite(i, progress, axis, last, F)[0]


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw path and start of the environments in `indices`."""
    last = int(P[P_POINTS]) - 1
    low, high = P[k.P_DEPTH_LOW] + P[P_MARGIN], P[k.P_DEPTH_HIGH] - P[P_MARGIN]
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        course = 0.0
        for axis in range(3):
            F[i, F_POINTS + axis] = P[P_START + axis]
        for point in range(last):
            v = uniform4(
                C[i, k.C_SEED], SCENARIO | test, 1 + point, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT]
            )
            course = 2.0 * math.pi * v[0] if point == 0 else course + P[P_TURN] * (2.0 * v[0] - 1.0)
            rise = P[P_CLIMB] * (2.0 * v[1] - 1.0)
            at = F_POINTS + 3 * point
            # A point nearer to a depth limit than the margin is followed by none that is nearer still.
            bottom, top = min(low, F[i, at + 2]), max(high, F[i, at + 2])
            z = F[i, at + 2] + P[P_SPACING] * math.sin(rise)
            if z < bottom or z > top:
                z = F[i, at + 2] - P[P_SPACING] * math.sin(rise)
            if z < bottom or z > top:
                z = min(top, max(bottom, z))
                rise = math.asin((z - F[i, at + 2]) / P[P_SPACING])
            F[i, at + 3] = F[i, at] + P[P_SPACING] * math.cos(rise) * math.cos(course)
            F[i, at + 4] = F[i, at + 1] + P[P_SPACING] * math.cos(rise) * math.sin(course)
            F[i, at + 5] = z
        F[i, F_PROGRESS] = 0.0
        F[i, F_SPEED_ERROR] = 0.0
        _refer(i, last, F, P)
        k.ball_row(i, u[1], u[2], u[3], P[P_RADIUS], F, P)
        # No farther than a ball round the first point reaches: a path may come back to its beginning.
        _search(i, last, 1.0 + 2.0 * P[P_RADIUS] / P[P_SPACING], F)
        _refer(i, last, F, P)
        k.begin_row(i, row, k.wrap(2.0 * math.pi * u[0]), F, C, P, pose)


@compiled("dynamics")
def advance(
    start: int,
    stop: int,
    pose: Floats,
    velocity: Floats,
    action: Floats,
    previous: Floats,
    force: Floats,
    power: Floats,
    F: Floats,
    C: Integers,
    P: Floats,
    reward: Floats,
    hook: Any,
) -> int:
    """Compute reward, ends and sums after one agent step; see `Task.kernel`."""
    last = int(P[P_POINTS]) - 1
    ended = 0
    for i in range(start, stop):
        # From where it was to where it is, along the tangent.
        along, squared = 0.0, 1e-12
        for axis in range(3):
            v = F[i, k.F_REFERENCE_VELOCITY + axis]
            along += v * k.velocity_row(i, pose, velocity, axis)
            squared += v * v
        asked = P[P_SPEED] if F[i, F_PROGRESS] < last else 0.0
        _project(i, pose[i], last, F)
        _refer(i, last, F, P)
        distance = k.distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        C[i, k.C_STEPS] += 1
        yaw_error = k.wrap(F[i, k.F_REFERENCE_YAW] - k.yaw_row(i, pose))
        k.add_errors_row(i, distance, yaw_error, F)
        F[i, F_SPEED_ERROR] += abs(along / math.sqrt(squared) - asked)
        outcome = -1
        if k.leaves_water(i, pose, P):
            outcome = k.COLLISION
        elif distance > P[P_BOUNDS]:
            outcome = k.OUT_OF_BOUNDS
        elif F[i, F_PROGRESS] > last - 0.5 and _to_end(i, pose, last, F) < P[P_GOAL]:
            outcome = k.SUCCESS
        elif C[i, k.C_STEPS] >= P[k.P_MAX_STEPS]:
            outcome = k.TIMEOUT
        r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


@compiled("dynamics")
def refer(indices: Integers, F: Floats, P: Floats) -> None:
    """Put progress and reference of the environments in `indices` at the point of the path next to the start."""
    last = int(P[P_POINTS]) - 1
    for row in range(indices.shape[0]):
        _search(indices[row], last, float(last), F)
        _refer(indices[row], last, F, P)


@njit(nogil=True)
def _to_end(i: int, pose: Floats, last: int, F: Floats) -> float:
    """Return the distance in m to the last point."""
    squared = 0.0
    for axis in range(3):
        squared += (F[i, F_POINTS + 3 * last + axis] - pose[i, axis]) ** 2
    return math.sqrt(squared)


class PathFollowingTask(TrackingTask):
    """N episodes of path following."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    reference_columns = (
        *fingerprint.COLUMNS,
        "cross_track_rms_m",
        "yaw_error_rms_rad",
        "completion",
        "speed_error_m_per_s",
    )
    reference_blocks = fingerprint.BLOCKS
    own_floats = 3 * MOST_POINTS + 2

    def own_parameters(self, task: Any) -> list[float]:
        assert isinstance(task, tasks.PathFollowing)
        self.bounds, self.last, self.speed = task.bounds, task.waypoints - 1, task.speed
        path = [task.waypoints, task.spacing, task.turn, task.climb, task.speed]
        limits = [task.start_radius, task.goal_radius, task.bounds, task.preview.interval]
        margin = max(DEPTH_MARGIN, k.SHALLOWEST + task.overshoot)
        return [*task.start, *path, *limits, margin]

    def refer(self, indices: Integers) -> None:
        refer(indices, self.F, self.parameters)

    def goal(self, i: int) -> Floats:
        at = F_POINTS + 3 * self.last
        return self.F[i, at : at + 3].copy()

    def own_metrics(self, i: int) -> dict[str, float]:
        F = self.F[i]
        errors = self.errors(i, self.bounds)
        reached = self.C[i, k.C_OUTCOME] == k.SUCCESS
        speed_error = float(F[F_SPEED_ERROR]) / float(F[k.F_COUNTED])
        return {
            **errors,
            "cross_track_rms_m": errors["position_error_rms_m"] if reached else self.bounds,
            "completion": 1.0 if reached else float(F[F_PROGRESS]) / self.last,
            # A path that is not followed to its end is followed no better than by a vehicle at rest.
            "speed_error_m_per_s": speed_error if reached else max(speed_error, self.speed),
        }
