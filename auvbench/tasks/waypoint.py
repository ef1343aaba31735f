"""The waypoint task: come within the goal radius of a point (section 3 of the thesis). docs/task.md defines it."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config import tasks
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import SCENARIO, uniform4
from auvbench.tasks import kernels as k
from auvbench.tasks.base import Floats, Integers, Task
from auvbench.tasks.rewards import THESIS, reward_row, thesis_row

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

P_GOAL = k.P_OWN
P_START = k.P_OWN + 1  # x, y, z
P_BOX_LOW = k.P_OWN + 4  # x, y, z
P_BOX_HIGH = k.P_OWN + 7  # x, y, z


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw start yaw and waypoint of the environments in `indices`."""
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        for axis in range(3):
            low, high = P[P_BOX_LOW + axis], P[P_BOX_HIGH + axis]
            F[i, k.F_REFERENCE + axis] = low + (high - low) * u[1 + axis]
            F[i, k.F_START + axis] = P[P_START + axis]
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
    """Compute reward, ends and sums after one agent step; return how many episodes ended (-1 - i: pose i is not finite).

    Precedence of the ends: leaving the depth limits, then the goal, then the last step.
    """
    ended = 0
    for i in range(start, stop):
        distance = k.distance_row(i, pose, i, F)
        if not math.isfinite(distance):
            return -1 - i
        C[i, k.C_STEPS] += 1
        outcome = -1
        if k.leaves_water(i, pose, P):
            outcome = k.COLLISION
        elif distance < P[P_GOAL]:
            outcome = k.SUCCESS
        elif C[i, k.C_STEPS] >= P[k.P_MAX_STEPS]:
            outcome = k.TIMEOUT
        # Perpendicular distance to the line start-waypoint: |(p - a) x (b - a)| / |b - a|.
        ax, ay, az = F[i, k.F_START], F[i, k.F_START + 1], F[i, k.F_START + 2]
        bx, by, bz = F[i, k.F_REFERENCE] - ax, F[i, k.F_REFERENCE + 1] - ay, F[i, k.F_REFERENCE + 2] - az
        px, py, pz = pose[i, 0] - ax, pose[i, 1] - ay, pose[i, 2] - az
        cx, cy, cz = py * bz - pz * by, pz * bx - px * bz, px * by - py * bx
        length_squared = bx * bx + by * by + bz * bz
        if length_squared > 0.0:
            deviation = math.sqrt((cx * cx + cy * cy + cz * cz) / length_squared)
        else:
            deviation = math.sqrt(px * px + py * py + pz * pz)
        F[i, k.F_DEVIATION] += deviation
        F[i, k.F_DEVIATION_SQUARED] += deviation * deviation
        if P[k.P_REWARD] == THESIS:
            r = thesis_row(i, outcome, distance, F, P)
        else:
            ahead = math.atan2(F[i, k.F_REFERENCE + 1] - pose[i, 1], F[i, k.F_REFERENCE] - pose[i, 0])
            yaw_error = k.wrap(ahead - k.yaw_row(i, pose))
            r = reward_row(i, outcome, distance, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


class WaypointTask(Task):
    """N episodes of the waypoint task."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    reference_columns = REFERENCE_COLUMNS
    reference_blocks = ("yaw_error", "position_error", "previous_action")
    reference_key = "waypoint"

    def own_parameters(self, task: Any) -> list[float]:
        assert isinstance(task, tasks.Waypoint)
        # The part of the box between the depth limits, out of which no waypoint is reached.
        low, high = [*task.waypoint_low], [*task.waypoint_high]
        low[2], high[2] = max(low[2], task.depth_low), min(high[2], task.depth_high)
        return [task.goal_radius, *task.start, *low, *high]

    def place(self, indices: Integers, pose: Floats, waypoint: Floats | None = None) -> None:
        if waypoint is not None:
            self.F[indices, k.F_REFERENCE : k.F_REFERENCE + 3] = waypoint
        super().place(indices, pose)

    def own_metrics(self, i: int) -> dict[str, float]:
        x, y, z = self.F[i, k.F_REFERENCE : k.F_REFERENCE + 3].tolist()
        return {"waypoint_x_m": x, "waypoint_y_m": y, "waypoint_z_m": z}
