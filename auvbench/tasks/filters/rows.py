"""The constraints of the barrier filter on a vehicle's command, one row a x >= b for each solid and limit.

Let d be the distance to the solid or limit, v the closing speed and a the guaranteed deceleration. For v > 0, a vehicle that brakes after
T seconds stops in time if v T + v^2 / (2 a) <= d, that is, v <= w(d). The barrier is w(d) - v, of relative degree one in the thrust, and
the command must keep

    d/dt (w(d) - v) >= -(w(d) - v) / T,    that is    v + T v' + T w'(d) max(v, 0) <= w(d)
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import borrowed, compiled
from auvbench.dynamics.layout import Record, Vector, record
from auvbench.dynamics.vectors import (
    ZERO,
    add,
    cross,
    dot,
    product,
    rotation_matrix,
    scale,
    subtract,
    transposed_product,
)
from auvbench.tasks.filters.quadratic import nearest
from auvbench.tasks.rows import motion_of, pose_of
from auvbench.tasks.rows import turning as turning_of
from auvbench.worlds.casting import distance_to
from auvbench.worlds.solids import position_at, triple

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST = 24
"""Largest number of rows; if more are needed, the rows of the nearest solids and limits are kept"""
POINTS = 801
"""Number of points in the table of a thruster's force by command; every fourth point is one of the 201 points of a T200's table"""
SLACK = 1e-3
"""Largest slack of a command that counts as feasible, m/s2"""
CHANGED, CHANGE, INFEASIBLE = range(3)
"""Columns of the tallies: steps with a changed command, sum of the changes, steps with a slack above SLACK"""

MODEL = record(
    mass_inverse=(6, 6),  # inverse of M_RB + M_A
    momentum=(6, 6),  # matrix of the Coriolis terms
    linear=(6,),  # damping, N s/m, N m s
    quadratic=(6,),
    lift=(),  # N, buoyancy minus weight
    righting=(3,),  # N m, B r_b - W r_g
    brake=(),  # m/s2, guaranteed deceleration in every direction
    horizon=(),  # s, time from a measurement to the thrusters' reaction
    margin=(),  # m, distance to keep from solids and limits
    drag=(3,),  # m/s2 per m/s of the vehicle's speed, largest effect of the water's motion
    push=(3,),  # m/s2, largest effect of the water's motion on a vehicle at rest
    speed=(),  # m/s, largest speed; infinite: no limit
    tilt=(),  # rad, largest angle between the vehicle's z and the vertical; infinite: no limit
    turn_brake=(),  # rad/s2, guaranteed deceleration about each axis of the body's x-y plane
    low=(),  # m, depth limits
    high=(),
    duration=(),  # s, of an agent step
)


@njit(nogil=True)
def largest_speed(d: float, brake: float, horizon: float) -> tuple[float, float]:
    """Return w(d), the largest closing speed in m/s at a distance of d m, and its derivative w'(d). For d < 0, w is negative."""
    if d <= 0.0:
        return d / horizon, 1.0 / horizon
    lost = brake * horizon
    root = math.sqrt(lost * lost + 2.0 * brake * d)
    return root - lost, brake / root


@njit(nogil=True)
def still_acceleration(p: Record, up: Vector, v: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """Return the acceleration of the body origin (m/s2) and the angular acceleration (rad/s2) without thrust in still water, body axes."""
    nu, force, rate = np.empty(6), np.empty(6), np.empty(6)
    nu[0], nu[1], nu[2] = v
    nu[3], nu[4], nu[5] = omega
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += p.momentum[i, j] * nu[j]
        rate[i] = total
        force[i] = -(p.linear[i] + p.quadratic[i] * abs(nu[i])) * nu[i]
    linear, angular = (rate[0], rate[1], rate[2]), (rate[3], rate[4], rate[5])
    f = add(cross(linear, omega), scale(p.lift, up))
    m = add(add(cross(angular, omega), cross(linear, v)), cross(triple(p.righting), up))
    force[0] += f[0]
    force[1] += f[1]
    force[2] += f[2]
    force[3] += m[0]
    force[4] += m[1]
    force[5] += m[2]
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += p.mass_inverse[i, j] * force[j]
        rate[i] = total
    return (rate[0], rate[1], rate[2]), (rate[3], rate[4], rate[5])


@njit(nogil=True)
def along(effect: Floats, normal: Vector, turning: Vector, j: int) -> float:
    """Return the acceleration caused by the largest force of thruster j: along `normal` (m/s2) plus about `turning` (rad/s2)."""
    (x, y, z), (roll, pitch, yaw) = triple(effect[:, j]), turning_of(effect[:, j])
    (nx, ny, nz), (tx, ty, tz) = normal, turning
    return float(nx * x + ny * y + nz * z + tx * roll + ty * pitch + tz * yaw)


@njit(nogil=True)
def add_row(
    effect: Floats,
    low: Floats,
    high: Floats,
    normal: Vector,
    turning: Vector,
    b: float,
    distance: float,
    A: Floats,
    bounds: Floats,
    distances: Floats,
    count: int,
) -> int:
    """Add the row that requires an acceleration of at least b along `normal` (m/s2) or about `turning` (rad/s2); return the number of rows.

    For a point at an arm from the body origin, `turning` is arm x normal, body axes. A row that every command meets is left out.
    """
    at = count
    if count == MOST:
        for k in range(MOST):
            if at == MOST or distances[k] > distances[at]:
                at = k
        if distances[at] <= distance:
            return count
    least = 0.0
    n = effect.shape[1]
    for j in range(n):
        value = along(effect, normal, turning, j)
        least += min(value * low[j], value * high[j])
    if least >= b:
        return count
    for j in range(n):
        A[at, j] = along(effect, normal, turning, j)
    bounds[at], distances[at] = b, distance
    return min(count + 1, MOST)


@njit(nogil=True)
def needed(p: Record, d: float, closing: float, away: float, pushed: float) -> float:
    """Return the acceleration in m/s2 that thrust must add along the normal of a solid or limit.

    Args:
        d: distance to the solid or limit, m.
        closing: closing speed, m/s.
        away: acceleration without thrust along the normal, m/s2.
        pushed: largest acceleration by moving water, m/s2.
    """
    fastest, slope = largest_speed(d, p.brake, p.horizon)
    return float((closing - fastest) / p.horizon + slope * max(closing, 0.0) - away + pushed)


@njit(nogil=True)
def constraints(
    p: Record,
    position: Vector,
    attitude: tuple[float, float, float, float],
    v: Vector,
    omega: Vector,
    time: float,
    solids: Any,
    heights: Floats,
    hull: Record,
    effect: Floats,
    low: Floats,
    high: Floats,
    forces: Floats,
    A: Floats,
    bounds: Floats,
) -> int:
    """Write the rows A x >= bounds of a vehicle; return the number of rows."""
    distances = np.empty(MOST)
    R = rotation_matrix(attitude)
    up = R[2]
    acceleration, turning = still_acceleration(p, up, v, omega)
    # d/dt of the velocity over ground is v' + omega x v in body axes.
    origin = add(acceleration, cross(omega, v))
    speed = math.sqrt(dot(v, v))
    at_rest, per_speed = triple(p.push), triple(p.drag)
    pushed = math.sqrt(
        (at_rest[0] + per_speed[0] * abs(v[0])) ** 2
        + (at_rest[1] + per_speed[1] * abs(v[1])) ** 2
        + (at_rest[2] + per_speed[2] * abs(v[2])) ** 2
    )
    strongest = 0.0
    for i in range(3):
        total = 0.0
        for j in range(low.shape[0]):
            total += max(abs(effect[i, j] * low[j]), abs(effect[i, j] * high[j]))
        strongest += total * total
    count = 0
    for k in range(hull.count):
        arm = (hull.first + k * hull.spacing, 0.0, 0.0)
        centre = add(position, product(R, arm))
        motion = add(v, cross(omega, arm))
        own = add(origin, add(cross(turning, arm), cross(omega, cross(omega, arm))))
        # Solids farther away than `reach` leave time to brake after any command.
        fastest = speed + math.sqrt(dot(omega, omega)) * abs(arm[0])
        fastest = 2.0 * fastest + p.horizon * (math.sqrt(strongest) + math.sqrt(dot(own, own)) + pushed)
        reach = fastest * p.horizon + 0.5 * fastest * fastest / p.brake + p.margin + hull.radius
        for s in range(solids.shape[0]):
            solid = solids[s]
            off = subtract(centre, position_at(solid, time))
            near, drift = reach, dot(triple(solid.velocity), triple(solid.velocity))
            if drift > 0.0:
                drift = fastest + math.sqrt(drift)
                near = drift * p.horizon + 0.5 * drift * drift / p.brake + p.margin + hull.radius
            room = near + solid.reach
            if dot(off, off) > room * room:
                continue
            distance, gradient = distance_to(solid, heights, time, centre, near)
            if distance >= near:
                continue
            d = distance - hull.radius - p.margin
            normal = transposed_product(R, gradient)
            closing = dot(gradient, triple(solid.velocity)) - dot(normal, motion)
            b = needed(p, d, closing, dot(normal, own), pushed)
            count = add_row(effect, low, high, normal, cross(arm, normal), b, d, A, bounds, distances, count)
    climb, rise = dot(up, v), dot(up, origin)
    d = position[2] - p.low - p.margin
    b = needed(p, d, -climb, rise, pushed)
    count = add_row(effect, low, high, up, ZERO, b, d, A, bounds, distances, count)
    d = p.high - p.margin - position[2]
    b = needed(p, d, climb, -rise, pushed)
    count = add_row(effect, low, high, scale(-1.0, up), ZERO, b, d, A, bounds, distances, count)
    if p.speed < math.inf:
        x, y, z = add(v, scale(p.horizon, acceleration))
        for j in range(forces.shape[0]):
            ax, ay, az = triple(effect[:, j])
            x += p.horizon * ax * forces[j]
            y += p.horizon * ay * forces[j]
            z += p.horizon * az * forces[j]
        size = math.sqrt(x * x + y * y + z * z)
        if size > p.speed:
            back = (-x / size, -y / size, -z / size)
            b = (-dot(back, v) - p.speed) / p.horizon - dot(back, acceleration) + pushed
            count = add_row(effect, low, high, back, ZERO, b, -1.0, A, bounds, distances, count)
    sine = math.sqrt(up[0] * up[0] + up[1] * up[1])
    if p.tilt < math.inf and sine > 0.0:
        # The axis about which the vehicle turns upright; the angular velocity of this axis itself is left out.
        upright = (-up[1] / sine, up[0] / sine, 0.0)
        d = p.tilt - math.atan2(sine, up[2])
        closing = -dot(upright, omega)
        fastest, slope = largest_speed(d, p.turn_brake, p.horizon)
        b = (closing - fastest) / p.horizon + slope * max(closing, 0.0) - dot(upright, turning)
        count = add_row(effect, low, high, ZERO, upright, b, d, A, bounds, distances, count)
    return count


@njit(nogil=True)
def force_of(table: Floats, first: float, last: float, command: float) -> float:
    """Return the force of a command; the command is first clipped to the table's range, from `first` to `last`."""
    at = (min(max(command, first), last) - first) / (last - first) * (POINTS - 1)
    k = min(int(at), POINTS - 2)
    after = k + 1
    return float(table[k] + (at - k) * (table[after] - table[k]))


@njit(nogil=True)
def command_of(table: Floats, first: float, last: float, force: float) -> float:
    """Return the command that gives a force, from a table whose forces rise; 0 for the force 0."""
    if abs(force) < 1e-9:
        return 0.0
    low, high = 0, POINTS - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle] <= force:
            low = middle
        else:
            high = middle
    rise = table[high] - table[low]
    share = (force - table[low]) / rise if rise > 0.0 else 0.0
    return float(first + (low + min(max(share, 0.0), 1.0)) * (last - first) / (POINTS - 1))


@compiled("dynamics", "worlds", "tasks")
def protect(
    start: int,
    stop: int,
    pose: Floats,
    velocity: Floats,
    action: Floats,
    steps: Integers,
    counts: Integers,
    solids: Any,
    heights: Floats,
    hull: Any,
    model: Any,
    effect: Floats,
    inverse: Floats,
    low: Floats,
    high: Floats,
    tables: Floats,
    first: Floats,
    last: Floats,
    tallies: Floats,
) -> None:
    """Change the commands (n, n_u) of the vehicles start .. stop - 1 as little as the constraints allow, and tally the changes.

    Args:
        start: index of the first vehicle.
        stop: index after the last vehicle.
        pose: (n, 7) poses.
        velocity: (n, 6) velocities.
        action: (n, n_u) commands in [-1, 1], which this function changes.
        steps: (n,) agent steps since the start of the episode.
        counts: (n,) number of solids in each episode.
        solids: (n, most) records of SOLID.
        heights: (m,) heights of all terrain, m.
        hull: (1,) record of HULL.
        model: (1,) record of MODEL.
        effect: (6, n_u) accelerations caused by the largest force of each thruster.
        inverse: (n_u, n_u) inverse of the cost's Hessian; its variables are forces divided by each thruster's largest force.
        low: (n_u,) lowest (reverse) force of each thruster, divided by the largest force.
        high: (n_u,) highest (forward) force of each thruster, divided by the largest force.
        tables: (n_u, POINTS) forces at equally spaced commands, divided by the largest force.
        first: (n_u,) first command of each table.
        last: (n_u,) last command of each table.
        tallies: (n, 3) tallies with the columns CHANGED, CHANGE and INFEASIBLE, which this function changes.
    """
    solids, heights = borrowed(solids), borrowed(heights)
    p = model[0]
    n = action.shape[1]
    A, bounds = np.empty((MOST, n)), np.empty(MOST)
    forces, x = np.empty(n), np.empty(n)
    for i in range(start, stop):
        for j in range(n):
            forces[j] = force_of(tables[j], first[j], last[j], action[i, j])
        position, attitude = pose_of(pose, i)
        linear, angular = motion_of(velocity, i)
        count = constraints(
            p,
            position,
            attitude,
            linear,
            angular,
            steps[i] * p.duration,
            solids[i, : counts[i]],
            heights,
            hull[0],
            effect,
            low,
            high,
            forces,
            A,
            bounds,
        )
        met = True
        for r in range(count):
            total = -bounds[r]
            for j in range(n):
                total += A[r, j] * forces[j]
            met = met and total >= 0.0
        if met:
            continue
        slack = nearest(A, bounds, count, inverse, low, high, forces, x)
        if slack > SLACK:
            tallies[i, INFEASIBLE] += 1.0
        squared = 0.0
        for j in range(n):
            command = command_of(tables[j], first[j], last[j], x[j])
            squared += (command - action[i, j]) ** 2
            action[i, j] = command
        tallies[i, CHANGED] += 1.0
        tallies[i, CHANGE] += math.sqrt(squared)
