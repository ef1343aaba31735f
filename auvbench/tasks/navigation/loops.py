"""Loops over episodes: start of an episode, an interval of the IMU, ranges to beacons, and the end of an agent step."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import borrowed, compiled
from auvbench.dynamics.layout import LANES
from auvbench.dynamics.vectors import product as rotate
from auvbench.dynamics.vectors import rotation_matrix, subtract, transposed_product
from auvbench.dynamics.waves import pressure_head
from auvbench.tasks.navigation import (
    compass,
    dead_reckoning,
    dvl,
    ekf,
    gnss,
    imu,
    model,
    modem,
    pressure,
    usbl,
)
from auvbench.tasks.navigation.state import (
    DEPTH,
    DVL,
    GNSS,
    HEADING,
    MODEL,
    MODEM,
    NEVER,
    USBL,
    has_arrived,
    is_due,
    normals,
)
from auvbench.tasks.navigation.turns import attitude_of, multiply, turn
from auvbench.tasks.records import LOST, Record
from auvbench.tasks.rows import between, put, put_motion, quaternion, row, triple, turning

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shown: TypeAlias = tuple[Floats, Floats, Floats]
"""Arrays (n, 3) that blocks of the estimate read, in the order of `records.BELIEF`"""
Sea: TypeAlias = tuple[Any, ...]
"""Components, rays and time of `dynamics.waves.Waves` for all vehicles; for one vehicle, the rays of its block and its time"""

FASTEST = 50.0
"""Largest speeds of a usable estimate, m/s and rad/s (`blocks.FASTEST`)"""


@row
def see(d: Record, pose: Floats, velocity: Floats) -> None:
    """Store the true motion at the end of an interval."""
    q = quaternion(pose)
    put(d.true_position, triple(pose))
    put(d.true_velocity, rotate(rotation_matrix(q), triple(velocity)))
    imu.put_attitude(d.true_attitude, q)
    put(d.true_rates, turning(velocity))


@row
def start(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the sensors and of the first estimate. Call `see` first, which stores the true motion."""
    d.samples, d.time, d.diverged = 0, 0.0, 0
    imu.begin(e, d, p, stream)
    pressure.begin(e, d, p, stream)
    compass.begin(e, d, p, stream)
    dvl.begin(e, d, p, stream)
    usbl.begin(e, d, p, stream)
    gnss.begin(e, d, p, stream)
    modem.begin(d)
    for sensor in range(len(d.arrives)):
        d.arrives[sensor], d.stamp[sensor] = NEVER, -1.0
        d.nis[sensor] = d.innovations[sensor] = 0.0
    d.due[MODEL] = p.model_settling
    for k in range(len(d.rejected)):
        d.rejected[k] = 0
    a, b, c, f = normals(e, d, stream, 8)
    g, h, roll, pitch = normals(e, d, stream, 9)
    _, _, _, noise = normals(e, d, stream, 3)
    x, y, z = triple(d.true_position)
    s = p.start_position
    put(d.position, (x + s * a, y + s * b, z + s * c))
    x, y, z = triple(d.true_velocity)
    s = p.start_velocity
    put(d.velocity, (x + s * f, y + s * g, z + s * h))
    true = attitude_of(d.true_attitude)
    yaw = compass.yaw_of(true)
    error = compass.measured(d, p, yaw, noise) - yaw
    away = turn((p.start_tilt * roll, p.start_tilt * pitch, error))
    imu.put_attitude(d.attitude, multiply(away, true))
    put(d.acceleration_bias, (0.0, 0.0, 0.0))
    put(d.rate_bias, (0.0, 0.0, 0.0))
    put(d.water_velocity, (0.0, 0.0, 0.0))
    d.current[:] = 0.0
    d.scale = d.bias = 0.0
    at_rest = transposed_product(rotation_matrix(true), (0.0, 0.0, p.gravity))
    imu.sense(e, d, p, stream, at_rest, triple(d.true_rates), 1.0 / p.imu_rate)
    d.elapsed = 0.0
    put(d.force_sum, (0.0, 0.0, 0.0))
    d.rotation_sum[:] = 0.0
    d.error = d.error_squared_sum = d.counted = d.nees = d.unlocked = 0.0


@row
def show(d: Record, P: Floats, shown: Shown, i: int, pose: Floats, velocity: Floats) -> None:
    """Write the estimate of episode i to the arrays that observations read."""
    q = d.attitude
    put(pose, triple(d.position))
    for j in range(4):
        pose[3 + j] = q[j]
    own = transposed_product(rotation_matrix(attitude_of(q)), triple(d.velocity))
    put_motion(velocity, own, subtract(triple(d.rates), triple(d.rate_bias)))
    deviation, force, age = shown
    put(force[i], triple(d.specific_force))
    for j in range(3):
        deviation[i, j] = math.sqrt(max(P[j, j], 0.0))
        age[i, j] = d.time - max(d.stamp[j], 0.0)


@row
def is_sound(d: Record) -> bool:
    """Return whether an estimate is usable: near the true position, slow enough, and with a quaternion of about unit length."""
    near = between(triple(d.position), triple(d.true_position)) <= LOST
    vx, vy, vz = triple(d.velocity)
    slow = abs(vx) + abs(vy) + abs(vz) <= FASTEST
    roll, pitch, yaw = subtract(triple(d.rates), triple(d.rate_bias))
    turning = abs(roll) + abs(pitch) + abs(yaw)
    q = d.attitude
    unit = abs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0) < 0.1
    return bool(near and slow and turning <= FASTEST and unit)


@row
def feel(
    e: Record, d: Record, p: Record, P: Floats, work: ekf.Work, stream: int, power: float, sea: Sea, lane: int
) -> None:
    """Measure depth and heading if they are due, and correct the estimate by readings that arrive now."""
    deep, turned = 0.0, 0.0
    if is_due(d, DEPTH) or is_due(d, HEADING):
        deep, turned, _, _ = normals(e, d, stream, 12)
    if is_due(d, DEPTH):
        components, rays, time = sea
        x, y, z = triple(d.true_position)
        pressure.sense(d, p, deep, pressure_head(components, rays, lane, time, x, y, z))
    if has_arrived(d, DEPTH):
        if p.is_filter > 0:
            ekf.correct_depth(d, p, P, work)
        else:
            dead_reckoning.correct_depth(d, p)
    if is_due(d, HEADING):
        compass.sense(d, p, turned, power)
    if has_arrived(d, HEADING):
        if p.is_filter > 0:
            ekf.correct_heading(d, p, P, work)
        else:
            dead_reckoning.correct_heading(d, p)


@row
def ping(
    e: Record, d: Record, p: Record, P: Floats, work: ekf.Work, stream: int, solids: Any, heights: Any, water: Record
) -> None:  # fmt: skip
    """Measure the velocity if the DVL is due, and correct the estimate by a ping that arrives now."""
    if is_due(d, DVL):
        dvl.sense(e, d, p, stream, solids, heights, water)
    if has_arrived(d, DVL) and d.beams >= dvl.ENOUGH:
        if p.is_filter > 0:
            ekf.correct_velocity(d, p, P, work)
        else:
            dead_reckoning.correct_velocity(d, p)


@row
def locate(e: Record, d: Record, p: Record, P: Floats, work: ekf.Work, stream: int) -> None:
    """Measure the position if USBL or GNSS are due, and correct the estimate by positions that arrive now."""
    if usbl.has(e, p):
        if is_due(d, USBL) and usbl.sense(e, d, p, stream):
            ekf.remember(d, p, P, p.ping_state)
        if has_arrived(d, USBL):
            ekf.correct_fix(d, p, P, work)
    if p.has_gnss > 0 and is_due(d, GNSS) and gnss.sense(e, d, p, stream):
        ekf.correct_surface(d, p, P, work)


@row
def sample(
    e: Record, d: Record, p: Record, P: Floats, work: ekf.Work, stream: int, pose: Floats, velocity: Floats,
    solids: Any, heights: Any, water: Record, power: float, sea: Sea, lane: int, seconds: float,
) -> None:  # fmt: skip
    """Measure an interval of `seconds` s that ends at a pose and a velocity, and move the estimate."""
    before, had = attitude_of(d.true_attitude), triple(d.true_velocity)
    see(d, pose, velocity)
    d.samples += 1
    d.time += seconds
    gained = subtract(triple(d.true_velocity), had)
    force, rates = imu.moved(before, attitude_of(d.true_attitude), gained, p.gravity, seconds)
    imu.sense(e, d, p, stream, force, rates, seconds)
    if d.diverged > 0:
        return
    place = triple(d.position)
    pushed, R = imu.advance(d, p, seconds)
    if p.is_filter > 0:
        ekf.collect(d, pushed, R, seconds)
    else:
        dead_reckoning.advance(d, p, place, pushed, seconds)
    feel(e, d, p, P, work, stream, power, sea, lane)
    if p.has_dvl > 0:
        ping(e, d, p, P, work, stream, solids, heights, water)
    locate(e, d, p, P, work, stream)


@row
def conclude(
    e: Record,
    d: Record,
    p: Record,
    P: Floats,
    work: ekf.Work,
    sheet: Floats,
    stream: int,
    shown: Shown,
    i: int,
    pose: Floats,
    velocity: Floats,
) -> None:
    """End an agent step: let the biases walk, correct by the sheet's model, show the estimate and add its error to the sums."""
    imu.walk(e, d, p, stream, p.duration)
    if d.diverged == 0 and not is_sound(d):
        d.diverged = 1
    if d.diverged == 0:
        if p.has_model > 0:
            model.correct(d, p, P, work, triple(sheet[i]))
        if p.is_filter > 0:
            ekf.propagate(d, p, P)
        show(d, P, shown, i, pose, velocity)
    error = subtract(triple(d.true_position), triple(pose))
    d.error = between(triple(d.true_position), triple(pose))
    d.error_squared_sum += d.error * d.error
    d.counted += 1.0
    if p.is_filter > 0:
        d.nees += min(ekf.nees(error, P), LOST) if d.diverged == 0 else LOST
    if d.beams < dvl.ENOUGH or d.on_water > 0:
        d.unlocked += p.duration


@compiled("dynamics", "worlds", "tasks", ".")
def begin_rows(
    indices: Integers, episodes: Any, states: Any, parameters: Any, covariances: Floats, shown: Shown, stream: int,
    true_pose: Floats, true_velocity: Floats, pose: Floats, velocity: Floats,
) -> None:  # fmt: skip
    """Begin episodes: draw their sensors' errors and first estimates, and write the estimated poses (n, 7) and velocities (n, 6)."""
    p = parameters[0]
    for k in range(indices.shape[0]):
        i = indices[k]
        e, d, P = episodes[i], states[i], covariances[i]
        see(d, true_pose[i], true_velocity[i])
        start(e, d, p, stream)
        ekf.begin(P, p)
        show(d, P, shown, i, pose[i], velocity[i])


@compiled("dynamics", "worlds", "tasks", ".")
def sample_rows(
    first: int, stop: int, episodes: Any, states: Any, parameters: Any, covariances: Floats, stream: int,
    true_pose: Floats, true_velocity: Floats, counts: Integers, solids: Any, heights: Floats, water: Any,
    power: Floats, waves: Sea, seconds: float,
) -> None:  # fmt: skip
    """Measure an interval of `seconds` s in the episodes first .. stop - 1, and move their estimates."""
    p, memory = parameters[0], np.zeros((ekf.WORK, covariances.shape[1]))
    work, covariances = ekf.work_in(borrowed(memory)), borrowed(covariances)
    true_pose, true_velocity = borrowed(true_pose), borrowed(true_velocity)
    solids, heights = borrowed(solids), borrowed(heights)
    components, rays, times = waves
    for i in range(first, stop):
        sample(
            episodes[i], states[i], p, covariances[i], work, stream, true_pose[i], true_velocity[i],
            solids[i, : counts[i]], heights, water[i], power[i], (components, rays[i // LANES], times[i]), i % LANES, seconds,
        )  # fmt: skip
    memory[:] = 0.0  # keeps `memory` alive: numba frees it after its last use


@compiled("dynamics", "worlds", "tasks", ".")
def range_rows(
    first: int, stop: int, episodes: Any, states: Any, parameters: Any, covariances: Floats, stream: int
) -> None:
    """Measure ranges to beacons whose turn begins now, and correct the estimates by messages that arrive now.

    The rows first .. stop - 1 are whole teams. Call `sample_rows` first, which moves the estimates.
    """
    p, memory = parameters[0], np.zeros((ekf.WORK, covariances.shape[1]))
    work, covariances = ekf.work_in(borrowed(memory)), borrowed(covariances)
    for i in range(first, stop):
        e, d, P = episodes[i], states[i], covariances[i]
        if has_arrived(d, MODEM) and d.diverged == 0:
            modem.correct(d, p, P, work)
        if is_due(d, MODEM):
            j = i - i % p.team + modem.next_speaker(d, p)
            if modem.hears(e, d, p, stream):
                modem.sense(e, d, p, P, stream, states[j], covariances[j])
    memory[:] = 0.0  # as in `sample_rows`


@compiled("dynamics", "worlds", "tasks", ".")
def conclude_rows(
    first: int, stop: int, episodes: Any, states: Any, parameters: Any, covariances: Floats, sheet: Floats,
    shown: Shown, stream: int, pose: Floats, velocity: Floats,
) -> None:  # fmt: skip
    """End an agent step of the episodes first .. stop - 1; write the estimated poses (n, 7) and velocities (n, 6)."""
    p, memory = parameters[0], np.zeros((ekf.WORK, covariances.shape[1]))
    work, covariances, sheet = ekf.work_in(borrowed(memory)), borrowed(covariances), borrowed(sheet)
    pose, velocity = borrowed(pose), borrowed(velocity)
    deviation, force, age = shown
    views = borrowed(deviation), borrowed(force), borrowed(age)
    for i in range(first, stop):
        conclude(
            episodes[i], states[i], p, covariances[i], work, sheet, stream, views, i, pose[i], velocity[i]
        )  # fmt: skip
    memory[:] = 0.0  # as in `sample_rows`
