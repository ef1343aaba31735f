"""Docking: into a dock from the front. docs/task.md defines it.

The reference is the dock where the vehicle is near the axis in front of it; otherwise a point in front of the dock. For a
vehicle at the side of the dock or behind it, the point lies on a circle round the dock, so that the way to the reference
never leads through the dock.
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
from auvbench.tasks.base import Floats, Integers, Task, TrackingTask
from auvbench.tasks.rewards import reward_row, roll_pitch

F_ERROR = k.F_OWN + 3  # m from the dock, now
F_YAW_ERROR = k.F_OWN + 4  # rad, now
F_SPEED = k.F_OWN + 5  # m/s, now

P_DOCK = k.P_OWN  # x, y, z
P_START = k.P_OWN + 3  # low, high
P_TOLERANCE = k.P_OWN + 5
P_YAW_TOLERANCE = k.P_OWN + 6
P_SPEED = k.P_OWN + 7
P_CONE = k.P_OWN + 8
P_CLEARANCE = k.P_OWN + 9
P_STANDOFF = k.P_OWN + 10
P_BOUNDS = k.P_OWN + 11
P_TILT = k.P_OWN + 12  # rad; pi where roll and pitch end no episode
ALIGNED = 1.0 / 3.0
"""share of the cone within which the reference is the dock"""
TURNED = 2.0
"""share of the cone beyond which the way leads round the dock"""


@njit(nogil=True)
def _angle(i: int, x: float, y: float, z: float, F: Floats) -> tuple[float, float]:
    """Return distance from the dock in m and angle to its axis in rad of a position."""
    dx, dy, dz = x - F[i, k.F_GOAL], y - F[i, k.F_GOAL + 1], z - F[i, k.F_GOAL + 2]
    yaw = F[i, k.F_REFERENCE_YAW]
    # The axis points out of the dock: against the way in.
    along = -dx * math.cos(yaw) - dy * math.sin(yaw)
    squared = dx * dx + dy * dy + dz * dz
    return math.sqrt(squared), math.atan2(math.sqrt(max(squared - along * along, 0.0)), along)


@njit(nogil=True)
def _refer(i: int, x: float, y: float, z: float, F: Floats, P: Floats) -> float:
    """Write the reference of a vehicle at a position; return the length in m of the way from there into the dock."""
    distance, angle = _angle(i, x, y, z, F)
    yaw, cone = F[i, k.F_REFERENCE_YAW], P[P_CONE]
    ax, ay = -math.cos(yaw), -math.sin(yaw)
    along = distance * math.cos(angle)
    # Unit vector from the axis to the vehicle; to starboard where it is on the axis.
    lx, ly, lz = x - F[i, k.F_GOAL] - along * ax, y - F[i, k.F_GOAL + 1] - along * ay, z - F[i, k.F_GOAL + 2]
    length = math.sqrt(lx * lx + ly * ly + lz * lz)
    if length < 1e-6:
        lx, ly, lz, length = -ay, ax, 0.0, 1.0
    turn = max(0.0, angle - TURNED * cone)
    far = min(1.0, max(0.0, (angle - ALIGNED * cone) / (cone - ALIGNED * cone)))
    if angle < cone:
        far *= min(1.0, along / P[P_STANDOFF])
    out = P[P_STANDOFF] * far * math.cos(turn)
    aside = P[P_STANDOFF] * far * math.sin(turn) / length
    F[i, k.F_REFERENCE] = F[i, k.F_GOAL] + out * ax + aside * lx
    F[i, k.F_REFERENCE + 1] = F[i, k.F_GOAL + 1] + out * ay + aside * ly
    F[i, k.F_REFERENCE + 2] = F[i, k.F_GOAL + 2] + aside * lz
    return float(P[P_STANDOFF] * far * (1.0 + turn))


@njit(nogil=True)
def _tilted(i: int, pose: Floats, P: Floats) -> bool:
    """Return whether roll or pitch of pose i are larger than the task allows."""
    if P[P_TILT] >= math.pi:
        return False
    roll, pitch = roll_pitch(i, pose)
    return bool(abs(roll) > P[P_TILT] or abs(pitch) > P[P_TILT])


@compiled("dynamics")
def draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
    """Draw yaw of the dock and start of the environments in `indices`."""
    for row in range(indices.shape[0]):
        i = indices[row]
        u = uniform4(C[i, k.C_SEED], SCENARIO | test, 0, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        v = uniform4(C[i, k.C_SEED], SCENARIO | test, 1, 0, C[i, k.C_EPISODE], C[i, k.C_ENVIRONMENT])
        distance = P[P_START] + (P[P_START + 1] - P[P_START]) * u[1]
        rise = distance * k.rise_row(u[2], P[P_DOCK + 2], distance, P)
        level = math.sqrt(distance * distance - rise * rise)
        F[i, k.F_START] = P[P_DOCK] + level * math.cos(2.0 * math.pi * u[3])
        F[i, k.F_START + 1] = P[P_DOCK + 1] + level * math.sin(2.0 * math.pi * u[3])
        z = P[P_DOCK + 2] + rise
        F[i, k.F_START + 2] = z
        for axis in range(3):
            F[i, k.F_GOAL + axis] = P[P_DOCK + axis]
            F[i, k.F_REFERENCE_VELOCITY + axis] = 0.0
        F[i, k.F_REFERENCE_YAW] = k.wrap(2.0 * math.pi * v[0])
        _refer(i, F[i, k.F_START], F[i, k.F_START + 1], z, F, P)
        F[i, F_ERROR] = distance
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
        x, y, z = pose[i, 0], pose[i, 1], pose[i, 2]
        error, angle = _angle(i, x, y, z, F)
        if not math.isfinite(error):
            return -1 - i
        way = _refer(i, x, y, z, F, P)
        distance = k.distance_row(i, pose, i, F)
        yaw_error = k.wrap(F[i, k.F_REFERENCE_YAW] - k.yaw_row(i, pose))
        speed = math.sqrt(velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2)
        F[i, F_ERROR], F[i, F_YAW_ERROR], F[i, F_SPEED] = error, abs(yaw_error), speed
        k.add_errors_row(i, distance, yaw_error, F)
        C[i, k.C_STEPS] += 1
        outcome = -1
        if k.leaves_water(i, pose, P):
            outcome = k.COLLISION
        elif error < P[P_TOLERANCE] and abs(yaw_error) < P[P_YAW_TOLERANCE] and speed < P[P_SPEED]:
            outcome = k.SUCCESS
        elif error < P[P_CLEARANCE] and angle > P[P_CONE]:
            outcome = k.COLLISION
        elif error > P[P_BOUNDS] or _tilted(i, pose, P):
            outcome = k.OUT_OF_BOUNDS
        elif C[i, k.C_STEPS] >= P[k.P_MAX_STEPS]:
            outcome = k.TIMEOUT
        r = reward_row(i, outcome, distance + way, yaw_error, pose, velocity, action, previous, F, P, hook)
        ended += k.end_row(i, outcome, r, distance, pose, action, previous, force, power, F, C, P, reward)
    return ended


@compiled("dynamics")
def refer(indices: Integers, F: Floats, P: Floats) -> None:
    """Write references and distances from the dock of the environments in `indices`, whose episodes begin."""
    for row in range(indices.shape[0]):
        i = indices[row]
        x, y, z = F[i, k.F_START], F[i, k.F_START + 1], F[i, k.F_START + 2]
        F[i, F_ERROR] = _angle(i, x, y, z, F)[0]
        _refer(i, x, y, z, F, P)


class DockingTask(TrackingTask):
    """N episodes of docking."""

    draw = staticmethod(draw)
    kernel = staticmethod(advance)
    reference_columns = (
        *fingerprint.COLUMNS,
        "yaw_error_rms_rad",
        "final_position_error_m",
        "final_speed_m_per_s",
        "final_yaw_error_rad",
    )
    reference_blocks = (*fingerprint.BLOCKS, "goal_error")
    own_floats = 6

    def own_parameters(self, task: Any) -> list[float]:
        assert isinstance(task, tasks.Docking)
        tolerances = [task.tolerance, task.yaw_tolerance, task.speed]
        dock = [task.cone, task.clearance, task.standoff, task.bounds]
        tilt = math.pi if task.tilt is None else task.tilt
        return [*task.dock, task.start_low, task.start_high, *tolerances, *dock, tilt]

    def goal(self, i: int) -> Floats:
        return self.F[i, k.F_GOAL : k.F_GOAL + 3].copy()

    def dock_yaw(self, i: int) -> float:
        return float(self.F[i, k.F_REFERENCE_YAW])

    def refer(self, indices: Integers) -> None:
        refer(indices, self.F, self.parameters)

    def misplaced(self, i: int) -> str:
        P, way = self.parameters, self.goal(i) - self.F[i, k.F_START : k.F_START + 3]
        distance, yaw = float(np.linalg.norm(way)), self.dock_yaw(i)
        if distance > P[P_BOUNDS]:
            return f"is {distance:g} m from the dock; must be at most task.bounds={P[P_BOUNDS]:g} m"
        ahead = way[0] * math.cos(yaw) + way[1] * math.sin(yaw)
        if distance < P[P_CLEARANCE] and ahead < distance * math.cos(P[P_CONE]):
            return (
                f"is {distance:g} m from the dock, outside of the cone in front of it; must be at least "
                f"task.clearance={P[P_CLEARANCE]:g} m there"
            )
        return Task.misplaced(self, i)

    def own_metrics(self, i: int) -> dict[str, float]:
        error, yaw_error, speed = self.F[i, F_ERROR : F_SPEED + 1].tolist()
        return {
            **self.errors(i, 0.0),
            "final_position_error_m": error,
            "final_yaw_error_rad": yaw_error,
            "final_speed_m_per_s": speed,
        }
