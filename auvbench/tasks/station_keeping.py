"""Station keeping: hold a position and a yaw. docs/task.md defines it."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config import tasks
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.tasks import fingerprint
from auvbench.tasks import kernels as k
from auvbench.tasks.base import Floats, Integers, TrackingTask
from auvbench.tasks.rewards import reward_row

F_HELD = k.F_OWN  # steps within the tolerances in the last `hold_time`
F_OUTSIDE = k.F_OWN + 1  # the last step outside them

P_STATION = k.P_OWN  # x, y, z
P_STATION_YAW = k.P_OWN + 3
P_RADIUS = k.P_OWN + 4
P_BOUNDS = k.P_OWN + 5
P_TOLERANCE = k.P_OWN + 6
P_YAW_TOLERANCE = k.P_OWN + 7
P_SETTLING = k.P_OWN + 8  # steps
P_HOLD = k.P_OWN + 9  # steps
P_SHARE = k.P_OWN + 10


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw start position and yaw of the environments in `indices`."""
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        for axis in range(3):
            F[i, k.F_REFERENCE + axis] = P[P_STATION + axis]
            F[i, k.F_REFERENCE_VELOCITY + axis] = 0.0
        F[i, k.F_REFERENCE_YAW] = P[P_STATION_YAW]
        F[i, F_HELD] = 0.0
        F[i, F_OUTSIDE] = 0.0
        k.ball_row(i, u[1], u[2], u[3], P[P_RADIUS], F, P)
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
    ended = 0
    for i in range(start, stop):
        distance = k.distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        yaw_error = k.wrap(F[i, k.F_REFERENCE_YAW] - k.yaw_row(i, pose))
        C[i, k.C_STEPS] += 1
        step = C[i, k.C_STEPS]
        inside = distance < P[P_TOLERANCE] and abs(yaw_error) < P[P_YAW_TOLERANCE]
        if not inside:
            F[i, F_OUTSIDE] = step
        elif step > P[k.P_MAX_STEPS] - P[P_HOLD]:
            F[i, F_HELD] += 1.0
        if step > P[P_SETTLING]:
            k.add_errors_row(i, distance, yaw_error, F)
        outcome = -1
        if k.leaves_water(i, pose, P):
            outcome = k.COLLISION
        elif distance > P[P_BOUNDS]:
            outcome = k.OUT_OF_BOUNDS
        elif step >= P[k.P_MAX_STEPS]:
            outcome = k.SUCCESS if F[i, F_HELD] >= P[P_SHARE] * P[P_HOLD] else k.TIMEOUT
        r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


class StationKeepingTask(TrackingTask):
    """N episodes of station keeping."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    reference_columns = (*fingerprint.COLUMNS, "position_error_rms_m", "yaw_error_rms_rad", "settling_time_s")
    reference_blocks = fingerprint.BLOCKS
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
