"""Station keeping: hold a position and a yaw. docs/task.md defines it."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config import tasks
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.tasks.base import Floats, Integers, TrackingTask
from auvbench.tasks.kernels import (
    C_ENVIRONMENT,
    C_EPISODE,
    C_SEED,
    C_STEPS,
    COLLISION,
    F_OWN,
    F_REFERENCE,
    F_REFERENCE_VELOCITY,
    F_REFERENCE_YAW,
    OUT_OF_BOUNDS,
    P_MAX_STEPS,
    P_OWN,
    SUCCESS,
    TIMEOUT,
    add_errors_row,
    ball_row,
    begin_row,
    distance_row,
    end_row,
    leaves_water,
    wrap,
    yaw_row,
)
from auvbench.tasks.rewards import reward_row

F_HELD = F_OWN  # steps within the tolerances in the last `hold_time`
F_OUTSIDE = F_OWN + 1  # the last step outside them

P_STATION = P_OWN  # x, y, z
P_STATION_YAW = P_OWN + 3
P_RADIUS = P_OWN + 4
P_BOUNDS = P_OWN + 5
P_TOLERANCE = P_OWN + 6
P_YAW_TOLERANCE = P_OWN + 7
P_SETTLING = P_OWN + 8  # steps
P_HOLD = P_OWN + 9  # steps
P_SHARE = P_OWN + 10


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw start position and yaw of the environments in `indices`."""
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, C_SEED], SCENARIO | test, 0, 0, C[i, C_EPISODE], C[i, C_ENVIRONMENT])
        for axis in range(3):
            F[i, F_REFERENCE + axis] = P[P_STATION + axis]
            F[i, F_REFERENCE_VELOCITY + axis] = 0.0
        F[i, F_REFERENCE_YAW] = P[P_STATION_YAW]
        F[i, F_HELD] = 0.0
        F[i, F_OUTSIDE] = 0.0
        ball_row(i, u[1], u[2], u[3], P[P_RADIUS], F)
        begin_row(i, row, wrap(2.0 * math.pi * u[0]), F, C, P, pose)


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
        distance = distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        yaw_error = wrap(F[i, F_REFERENCE_YAW] - yaw_row(i, pose))
        C[i, C_STEPS] += 1
        step = C[i, C_STEPS]
        inside = distance < P[P_TOLERANCE] and abs(yaw_error) < P[P_YAW_TOLERANCE]
        if not inside:
            F[i, F_OUTSIDE] = step
        elif step > P[P_MAX_STEPS] - P[P_HOLD]:
            F[i, F_HELD] += 1.0
        if step > P[P_SETTLING]:
            add_errors_row(i, distance, yaw_error, F)
        outcome = -1
        if leaves_water(i, pose, P):
            outcome = COLLISION
        elif distance > P[P_BOUNDS]:
            outcome = OUT_OF_BOUNDS
        elif step >= P[P_MAX_STEPS]:
            outcome = SUCCESS if F[i, F_HELD] >= P[P_SHARE] * P[P_HOLD] else TIMEOUT
        r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


class StationKeepingTask(TrackingTask):
    """N episodes of station keeping."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    own_floats = 2
    success_ends = False

    def own_parameters(self, task: Any) -> list[float]:
        assert isinstance(task, tasks.StationKeeping)
        self.bounds = task.bounds
        tolerances = task.tolerance, task.yaw_tolerance
        times = (round(seconds * self.frequency) for seconds in (task.settling, task.hold_time))
        return [*task.station, task.yaw, task.start_radius, task.bounds, *tolerances, *times, task.hold_share]

    def own_metrics(self, i: int) -> dict[str, float]:
        return {
            **self.errors(i, self.bounds),
            "settling_time_s": float(self.F[i, F_OUTSIDE]) * self.duration,
        }
