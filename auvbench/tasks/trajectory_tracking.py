"""Trajectory tracking: follow a curve in time. docs/task.md defines it.

Every curve is, along each axis, a sum of three sines of the time, and a straight line for the helix:
p(t) = c + b s + sum_j a_j sin(w_j s + f_j), where s = t (drawn speed) / (largest speed of the curve with s = t).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from auvbench.config import tasks
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.tasks import fingerprint
from auvbench.tasks import kernels as k
from auvbench.tasks.base import Floats, Integers, TrackingTask
from auvbench.tasks.rewards import reward_row

CURVES = ("circle", "helix", "lemniscate", "random", "any")

# Of the curve, per axis.
F_CENTRE = k.F_OWN
F_SLOPE = k.F_OWN + 3
F_AMPLITUDE = k.F_OWN + 6  # three per axis
F_FREQUENCY = k.F_OWN + 15  # three per axis
F_PHASE = k.F_OWN + 24  # three per axis
F_RATE = k.F_OWN + 33  # ds/dt
F_BEHIND = k.F_OWN + 34  # sum of the position error along the velocity of the reference, over its speed, in s

P_CURVE = k.P_OWN
P_CENTRE = k.P_OWN + 1  # x, y, z
P_SIZE = k.P_OWN + 4  # low, high
P_SPEED = k.P_OWN + 6  # low, high
P_RADIUS = k.P_OWN + 8
P_START_YAW = k.P_OWN + 9
P_BOUNDS = k.P_OWN + 10
P_INTERVAL = k.P_OWN + 11

TURNS, SAMPLES = 4, 600
"""along which, and at how many places, the largest speed is looked for"""


@njit(nogil=True)
def _position(i: int, s: float, axis: int, F: Floats) -> float:
    p = F[i, F_CENTRE + axis] + F[i, F_SLOPE + axis] * s
    for j in range(3 * axis, 3 * axis + 3):
        p += F[i, F_AMPLITUDE + j] * math.sin(F[i, F_FREQUENCY + j] * s + F[i, F_PHASE + j])
    return float(p)


@njit(nogil=True)
def _slope(i: int, s: float, axis: int, F: Floats) -> float:
    v = F[i, F_SLOPE + axis]
    for j in range(3 * axis, 3 * axis + 3):
        w = F[i, F_FREQUENCY + j]
        v += F[i, F_AMPLITUDE + j] * w * math.cos(w * s + F[i, F_PHASE + j])
    return float(v)


@njit(nogil=True)
def _refer(i: int, time: float, F: Floats, P: Floats) -> None:
    """Write the reference at a time in s, and the previewed points."""
    s = F[i, F_RATE] * time
    for axis in range(3):
        F[i, k.F_REFERENCE + axis] = _position(i, s, axis, F)
        F[i, k.F_REFERENCE_VELOCITY + axis] = F[i, F_RATE] * _slope(i, s, axis, F)
    F[i, k.F_REFERENCE_YAW] = math.atan2(F[i, k.F_REFERENCE_VELOCITY + 1], F[i, k.F_REFERENCE_VELOCITY])
    for point in range(int(P[k.P_PREVIEWED])):
        ahead = F[i, F_RATE] * (time + (point + 1) * P[P_INTERVAL])
        for axis in range(3):
            F[i, int(P[k.P_PREVIEW]) + 3 * point + axis] = _position(i, ahead, axis, F)


@njit(nogil=True)
def _draw_curve(i: int, curve: int, size: float, C: Integers, test: int, F: Floats) -> None:
    """Write the sines of a curve of a size (half its width, m), still at s = time."""
    for j in range(9):
        F[i, F_AMPLITUDE + j] = 0.0
        F[i, F_FREQUENCY + j] = 1.0
        F[i, F_PHASE + j] = 0.0
    for axis in range(3):
        F[i, F_SLOPE + axis] = 0.0
    if curve <= 1:  # circle, helix
        F[i, F_AMPLITUDE] = size
        F[i, F_AMPLITUDE + 3] = size
        F[i, F_PHASE + 3] = -0.5 * math.pi
        if curve == 1:
            F[i, F_SLOPE + 2] = 0.2 * size
    elif curve == 2:  # lemniscate
        F[i, F_AMPLITUDE] = size
        F[i, F_AMPLITUDE + 3] = 0.5 * size
        F[i, F_FREQUENCY + 3] = 2.0
    else:
        for j in range(9):
            u = uniform4(C[i, k.C_SEED], SCENARIO | test, 2 + j, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
            level = 1.0 if j < 6 else 0.3
            # Together the three sines stay within the size.
            F[i, F_AMPLITUDE + j] = level * size * (0.2 + 0.8 * u[0]) / 3.0
            F[i, F_FREQUENCY + j] = (j % 3 + 1) * (0.8 + 0.4 * u[1])
            F[i, F_PHASE + j] = 2.0 * math.pi * u[2]


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw curve, speed and start of the environments in `indices`."""
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        v = uniform4(C[i, k.C_SEED], SCENARIO | test, 1, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        curve = int(P[P_CURVE])
        if curve == 4:
            curve = int(4.0 * v[0])
        size = P[P_SIZE] + (P[P_SIZE + 1] - P[P_SIZE]) * v[1]
        for axis in range(3):
            F[i, F_CENTRE + axis] = P[P_CENTRE + axis]
        _draw_curve(i, curve, size, C, test, F)
        fastest = 0.0
        for sample in range(SAMPLES):
            s = TURNS * 2.0 * math.pi * sample / SAMPLES
            speed = math.sqrt(_slope(i, s, 0, F) ** 2 + _slope(i, s, 1, F) ** 2 + _slope(i, s, 2, F) ** 2)
            fastest = max(fastest, speed)
        F[i, F_RATE] = (P[P_SPEED] + (P[P_SPEED + 1] - P[P_SPEED]) * v[2]) / fastest
        F[i, F_BEHIND] = 0.0
        _refer(i, 0.0, F, P)
        k.ball_row(i, u[1], u[2], u[3], P[P_RADIUS], F, P)
        yaw = F[i, k.F_REFERENCE_YAW] + P[P_START_YAW] * (2.0 * u[0] - 1.0)
        k.begin_row(i, row, k.wrap(yaw), F, C, P, pose)


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
    ended = 0
    for i in range(start, stop):
        C[i, k.C_STEPS] += 1
        _refer(i, C[i, k.C_STEPS] * P[k.P_DURATION], F, P)
        distance = k.distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        yaw_error = k.wrap(F[i, k.F_REFERENCE_YAW] - k.yaw_row(i, pose))
        k.add_errors_row(i, distance, yaw_error, F)
        along, squared = 0.0, 1e-6  # a reference that stands still has no lag
        for axis in range(3):
            v = F[i, k.F_REFERENCE_VELOCITY + axis]
            along += v * (F[i, k.F_REFERENCE + axis] - pose[i, axis])
            squared += v * v
        F[i, F_BEHIND] += along / squared
        outcome = -1
        if k.leaves_water(i, pose, P):
            outcome = k.COLLISION
        elif distance > P[P_BOUNDS]:
            outcome = k.OUT_OF_BOUNDS
        elif C[i, k.C_STEPS] >= P[k.P_MAX_STEPS]:
            outcome = k.SUCCESS
        r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


class TrajectoryTrackingTask(TrackingTask):
    """N episodes of trajectory tracking."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    reference_columns = (*fingerprint.COLUMNS, "position_error_rms_m", "yaw_error_rms_rad", "lag_s")
    reference_blocks = fingerprint.BLOCKS
    own_floats = 35
    success_ends = False

    def own_parameters(self, task: Any) -> list[float]:
        assert isinstance(task, tasks.TrajectoryTracking)
        self.bounds = task.bounds
        curve = CURVES.index(task.curve)
        drawn = [task.size_low, task.size_high, task.speed_low, task.speed_high]
        limits = [task.start_radius, task.start_yaw, task.bounds, task.preview.interval]
        return [curve, *task.centre, *drawn, *limits]

    def goal(self, i: int) -> Floats:
        f = self.F[i]
        s = f[F_RATE] * self.parameters[k.P_MAX_STEPS] * self.duration
        sines = np.sin(f[F_FREQUENCY : F_FREQUENCY + 9] * s + f[F_PHASE : F_PHASE + 9])
        curve = (f[F_AMPLITUDE : F_AMPLITUDE + 9] * sines).reshape(3, 3).sum(axis=1)
        return np.asarray(f[F_CENTRE : F_CENTRE + 3] + f[F_SLOPE : F_SLOPE + 3] * s + curve)

    def own_metrics(self, i: int) -> dict[str, float]:
        behind = float(self.F[i, F_BEHIND]) / float(self.F[i, k.F_COUNTED])
        return {**self.errors(i, self.bounds), "lag_s": behind}
