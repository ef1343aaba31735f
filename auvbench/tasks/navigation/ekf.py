"""Error-state extended Kalman filter with 15 states (Sola, "Quaternion kinematics for the error-state Kalman filter", arXiv 1711.02508).

The errors are position and velocity (world axes), attitude (world axes: R = exp([phi]x) R_estimated, section 7) and the biases of
accelerometers and gyros (body axes). `navigation=ekf_model` adds two states: a horizontal current. `dvl_scale` adds the DVL's scale, and
`heading_bias` adds the compass's constant error. A USBL adds the position at its last ping, so that a late position corrects the present
position exactly ("stochastic cloning": Roumeliotis and Burdick, ICRA 2002). A modem adds the position at a beacon's last message.

Biases are modelled as random walks. The estimate moves with each IMU sample; the covariance moves when a reading arrives and at the end of
an agent step. Updates are scalar, in Joseph's form. Other errors that last an episode (iron, density, alignment) are not states: they
enlarge the standard deviation of each reading, as if they were independent at each reading. After many rejected readings of a sensor in a
row, the filter accepts all readings of this sensor until a reading passes the gate, as ArduPilot's EKF3 does after a time-out. For model,
modem and water track, the filter never does this.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import called
from auvbench.dynamics.layout import Matrix, Vector
from auvbench.dynamics.vectors import add, cross, dot, product, rotation_matrix, scale, subtract
from auvbench.tasks.navigation import dvl, usbl
from auvbench.tasks.navigation.imu import put_attitude
from auvbench.tasks.navigation.state import (
    ACCELERATION_BIAS,
    ATTITUDE,
    CURRENT,
    DEPTH,
    DVL,
    GATED,
    GATED_FIXES,
    GNSS,
    HEADING,
    MODEL,
    MODEM,
    RATE_BIAS,
    STATES,
    USBL,
    VELOCITY,
    WATER,
)
from auvbench.tasks.navigation.turns import attitude_of, cross_matrix, multiply, turn
from auvbench.tasks.records import Record
from auvbench.tasks.rows import put, row, triple, wrap

Floats = NDArray[np.float64]

WORK = 7
"""Number of rows of the memory of `Work`"""
PARTS = 4
"""Number of counters of each sensor in `rejected`: a DVL needs one for each beam"""
MOVING = 9
"""Number of states that change between readings: position, velocity and attitude"""
LEVEL = 0.01
"""smallest cosine of the pitch at which a heading is used"""


class Work(NamedTuple):
    """Arrays for the correction by a reading, for s states."""

    slope: Floats  # (s,) derivatives of the reading
    gain: Floats  # (s,)
    shared: Floats  # (s,) P times the derivatives
    change: Floats  # (s,) change of the states
    innovation: Floats  # (3, s); the first three columns are the covariance of a position's innovation


@row
def work_in(memory: Any) -> Work:
    """Return the arrays of `Work` as views of a memory (WORK, s)."""
    return Work(memory[0], memory[1], memory[2], memory[3], memory[4:])


@row
def begin(P: Floats, p: Record) -> None:
    """Write the covariance of the errors at the start."""
    P[:, :] = 0.0
    yaw = math.sqrt(p.heading_noise**2 + p.heading_slow**2)
    for i in range(3):
        P[i, i] = p.start_position**2
        P[VELOCITY + i, VELOCITY + i] = p.start_velocity**2
        P[ATTITUDE + i, ATTITUDE + i] = p.start_tilt**2 if i < 2 else yaw**2
        P[ACCELERATION_BIAS + i, ACCELERATION_BIAS + i] = p.accelerometer_turn_on**2
        P[RATE_BIAS + i, RATE_BIAS + i] = p.gyro_turn_on**2
    for j in range(CURRENT, p.current_end):
        P[j, j] = p.model_current**2
    if p.scale_state > 0:
        P[p.scale_state, p.scale_state] = p.dvl_scale**2
    if p.bias_state > 0:  # The compass's constant error is also an error of the first yaw.
        k, north, variance = p.bias_state, ATTITUDE + 2, p.heading_bias**2
        P[k, k] = variance
        P[k, north] = P[north, k] = -variance
        P[north, north] += variance


@row
def collect(d: Record, force: Vector, R: Matrix, seconds: float) -> None:
    """Add an IMU sample to the integrals that `propagate` needs; `force` is in world axes, `R` the attitude in the middle of the sample."""
    d.elapsed += seconds
    put(d.force_sum, add(triple(d.force_sum), scale(seconds, force)))
    for i in range(3):
        for j in range(3):
            d.rotation_sum[3 * i + j] += seconds * R[i][j]


@row
def carried(
    T: float,
    R: Matrix,
    C: Matrix,
    position: Vector,
    velocity: Vector,
    attitude: Vector,
    force: Vector,
    rates: Vector,
) -> tuple[Vector, Vector, Vector]:
    """Return the errors of position, velocity and attitude after a time.

    Args:
        T: time, s.
        R: integral of the rotation matrix, s.
        C: cross matrix of the integral of the specific force in world axes, m/s.
        position: position error before, m.
        velocity: velocity error before, m/s.
        attitude: attitude error before, rad.
        force: error of the accelerometers' bias, m/s2.
        rates: error of the gyros' bias, rad/s.
    """
    turned = product(R, rates)
    pushed = add(product(C, attitude), product(R, force))
    late = product(C, turned)
    gained = subtract(scale(1.0 / 6.0, late), scale(0.5, pushed))
    return (
        add(position, scale(T, add(velocity, gained))),
        add(velocity, subtract(scale(0.5, late), pushed)),
        subtract(attitude, turned),
    )


@row
def integrals(d: Record) -> tuple[Matrix, Matrix]:
    """Return R and C of `carried` since the last propagation."""
    s = d.rotation_sum
    R: Matrix = (s[0], s[1], s[2]), (s[3], s[4], s[5]), (s[6], s[7], s[8])
    return R, cross_matrix(triple(d.force_sum))


@row
def three(P: Floats, i: int, j: int) -> Vector:
    """Return the entries i, i + 1 and i + 2 of column j."""
    return triple(P[i:, j])


@called
def propagate(d: Record, p: Record, P: Floats) -> None:
    """Propagate the covariance over the time since the last propagation: P = F P F^T + Q."""
    T = d.elapsed
    if T <= 0.0:
        return
    R, C = integrals(d)
    for j in range(P.shape[0]):  # F P
        x, v, a = three(P, 0, j), three(P, VELOCITY, j), three(P, ATTITUDE, j)
        errors = carried(T, R, C, x, v, a, three(P, ACCELERATION_BIAS, j), three(P, RATE_BIAS, j))
        (P[0, j], P[1, j], P[2, j]), (P[3, j], P[4, j], P[5, j]), (P[6, j], P[7, j], P[8, j]) = errors
    for i in range(MOVING):  # (F P) F^T; the columns of the biases are the same as in F P
        row = P[i]
        x, v, a = (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8])
        errors = carried(T, R, C, x, v, a, (row[9], row[10], row[11]), (row[12], row[13], row[14]))
        (row[0], row[1], row[2]), (row[3], row[4], row[5]), (row[6], row[7], row[8]) = errors
    for i in range(MOVING):
        for j in range(i):
            P[j, i] = P[i, j]
        for j in range(MOVING, P.shape[0]):
            P[j, i] = P[i, j]
    force, rates = (p.inflation * p.accelerometer_density) ** 2, (p.inflation * p.gyro_density) ** 2
    walk, drift = (p.inflation * p.accelerometer_walk) ** 2, (p.inflation * p.gyro_walk) ** 2
    for i in range(3):
        P[i, i] += force * T**3 / 3.0
        P[i, VELOCITY + i] += 0.5 * force * T**2
        P[VELOCITY + i, i] += 0.5 * force * T**2
        P[VELOCITY + i, VELOCITY + i] += force * T
        P[ATTITUDE + i, ATTITUDE + i] += rates * T
        P[ACCELERATION_BIAS + i, ACCELERATION_BIAS + i] += walk * T
        P[RATE_BIAS + i, RATE_BIAS + i] += drift * T
    for j in range(CURRENT, p.current_end):
        P[j, j] += (p.inflation * p.model_walk) ** 2 * T
    d.elapsed = 0.0
    put(d.force_sum, (0.0, 0.0, 0.0))
    for j in range(9):
        d.rotation_sum[j] = 0.0


@row
def shared(P: Floats, work: Work, first: int, stop: int) -> float:
    """Write P H^T to `work.shared` and return H P H^T; H is `work.slope`, which is 0 except at first .. stop - 1."""
    variance = 0.0
    for i in range(P.shape[0]):
        total = 0.0
        for j in range(first, stop):
            total += P[i, j] * work.slope[j]
        work.shared[i] = total
    for j in range(first, stop):
        variance += work.slope[j] * work.shared[j]
    return variance


@called
def update(
    d: Record,
    p: Record,
    P: Floats,
    work: Work,
    sensor: int,
    part: int,
    innovation: float,
    sd: float,
    first: int,
    stop: int,
) -> bool:
    """Correct states and covariance by a scalar reading whose derivatives are in `work`; return False if the reading is rejected.

    Args:
        d: state with the counters of the sensor.
        p: parameters.
        P: covariance.
        work: its `change` gets the change of the states.
        sensor: DVL, DEPTH, HEADING, MODEL, GNSS, MODEM or WATER.
        part: axis or beam of a reading of DVL, MODEL, GNSS or WATER, which the gate judges separately; 0 for other sensors.
        innovation: reading minus prediction.
        sd: standard deviation of the reading.
        first: first state that the reading depends on.
        stop: index after the last state that the reading depends on.
    """
    noise, y = (p.inflation * sd) ** 2, innovation
    for j in range(first, stop):
        y -= work.slope[j] * work.change[j]
    s = noise + shared(P, work, first, stop)
    nis = y * y / s
    d.nis[sensor] += nis
    d.innovations[sensor] += 1.0
    gated = sensor * PARTS + part
    if nis <= p.gate:
        d.rejected[gated] = 0
    # Readings of these three sensors that fail the gate are never accepted: a sheet, a beacon or the current may stay wrong.
    elif sensor in (MODEL, MODEM, WATER) or d.rejected[gated] < GATED:
        d.rejected[gated] += 1
        return False
    else:  # The covariance is wrong. The reading's states get the innovation as uncertainty; other states keep their uncertainty.
        for j in range(first, min(first + 3, stop)):
            P[j, :] = 0.0
            P[:, j] = 0.0
            P[j, j] = y * y
        s = noise + shared(P, work, first, stop)
    absorb(P, work, y, s)
    return True


@row
def absorb(P: Floats, work: Work, y: float, s: float) -> None:
    """Correct states and covariance by an innovation y with the variance s, after `shared`."""
    share = 1.0 / s
    for i in range(P.shape[0]):
        work.gain[i] = work.shared[i] * share
        work.change[i] += work.gain[i] * y
    # Joseph, (I - K H) P (I - K H)^T + K r K^T, with u = P H^T and s = H u + r: P - K u^T - u K^T + K s K^T.
    for i in range(P.shape[0]):
        gain, u = work.gain[i], work.shared[i]
        weighted = s * gain - u
        for j in range(P.shape[0]):  # whole rows, which become vector instructions
            P[i, j] = P[i, j] - gain * work.shared[j] + weighted * work.gain[j]
    for i in range(P.shape[0]):
        for j in range(i):
            P[j, i] = P[i, j]


@called
def inject(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Add the change of the states to the estimate, and transform the attitude error's covariance accordingly (Sola, eq. 314)."""
    x = work.change
    put(d.position, add(triple(d.position), (x[0], x[1], x[2])))
    put(d.velocity, add(triple(d.velocity), (x[3], x[4], x[5])))
    phi = x[6], x[7], x[8]
    put_attitude(d.attitude, multiply(turn(phi), attitude_of(d.attitude)))
    put(d.acceleration_bias, add(triple(d.acceleration_bias), (x[9], x[10], x[11])))
    put(d.rate_bias, add(triple(d.rate_bias), (x[12], x[13], x[14])))
    for j in range(CURRENT, p.current_end):
        d.current[j - CURRENT] += x[j]
    if p.scale_state > 0:
        d.scale += x[p.scale_state]
    if p.bias_state > 0:
        d.bias += x[p.bias_state]
    if p.ping_state > 0:
        k = p.ping_state
        put(d.ping_position, add(triple(d.ping_position), (x[k], x[k + 1], x[k + 2])))
    if p.modem_state > 0:
        k = p.modem_state
        put(d.range_position, add(triple(d.range_position), (x[k], x[k + 1], x[k + 2])))
    half = scale(0.5, phi)
    for j in range(P.shape[0]):
        own = P[ATTITUDE, j], P[ATTITUDE + 1, j], P[ATTITUDE + 2, j]
        P[ATTITUDE, j], P[ATTITUDE + 1, j], P[ATTITUDE + 2, j] = add(own, cross(half, own))
    for j in range(P.shape[0]):
        own = P[j, ATTITUDE], P[j, ATTITUDE + 1], P[j, ATTITUDE + 2]
        P[j, ATTITUDE], P[j, ATTITUDE + 1], P[j, ATTITUDE + 2] = add(own, cross(half, own))


@row
def put_row(work: Work, first: int, vector: Vector) -> None:
    """Write three derivatives of a reading."""
    work.slope[first], work.slope[first + 1], work.slope[first + 2] = vector


@row
def velocity_row(d: Record, p: Record, way: Vector, work: Work) -> None:
    """Write the derivatives of the velocity at the DVL along a direction in body axes.

    This velocity is h = (1 + k) way . (R^T v + w x l), with v - c instead of v if the last ping measured the water. The rates w are the
    measured rates minus the gyro bias, so that the column of the gyro bias is [l]x.
    """
    seen = scale(1.0 + d.scale, way)
    x, y, _ = along = product(rotation_matrix(attitude_of(d.attitude)), seen)
    work.slope[:] = 0.0
    put_row(work, VELOCITY, along)
    put_row(work, ATTITUDE, cross(along, dvl.relative(d)))
    put_row(work, RATE_BIAS, cross(seen, triple(p.dvl_lever)))
    if p.scale_state > 0:
        work.slope[p.scale_state] = dot(way, dvl.predicted(d, p)) / (1.0 + d.scale)
    if d.on_water > 0:
        work.slope[CURRENT], work.slope[CURRENT + 1] = -x, -y


@row
def heading_row(d: Record, p: Record, work: Work) -> float:
    """Write the derivatives of the compass's heading; return the squared cosine of the pitch, near 0 if the heading is undefined."""
    R = rotation_matrix(attitude_of(d.attitude))
    x, y, z = R[0][0], R[1][0], R[2][0]
    level = x * x + y * y
    work.slope[:] = 0.0
    if level > LEVEL**2:
        put_row(work, ATTITUDE, (-z * x / level, -z * y / level, 1.0))
    if p.bias_state > 0:
        work.slope[p.bias_state] = 1.0
    return level


@called
def correct_velocity(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Correct the estimate by the DVL's last ping: by the velocity, or by the valid beams if only three beams are valid."""
    propagate(d, p, P)
    error = subtract(triple(d.dvl_velocity), triple(d.predicted_velocity))
    work.change[:] = 0.0
    sensor, factor = (WATER, p.dvl_water_noise) if d.on_water > 0 else (DVL, 1.0)
    level, beam_sd = factor * d.merit, factor * dvl.beam_sd(d, p)
    upright = 0.5 * beam_sd / p.dvl_cosine
    four = d.beams == dvl.BEAMS
    speed = dot(triple(d.dvl_velocity), triple(d.dvl_velocity))
    unknown = 0.0 if p.scale_state > 0 else p.dvl_scale**2
    slow = (unknown + p.dvl_mounting**2) * speed
    stop = max(p.scale_state + 1, p.current_end if d.on_water > 0 else STATES)
    for k in range(3 if four else dvl.BEAMS):
        if four:
            way = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
            sd = level if k < 2 else upright
        else:
            way, sd = dvl.beam(p, k), beam_sd
            if d.valid[k] == 0:
                continue
        velocity_row(d, p, way, work)
        update(d, p, P, work, sensor, k, dot(way, error), math.sqrt(sd * sd + slow), VELOCITY, stop)
    inject(d, p, P, work)
    d.stamp[sensor] = d.time - p.dvl_delay


@called
def correct_depth(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Correct the estimate by a reading of the depth sensor."""
    propagate(d, p, P)
    work.change[:] = 0.0
    work.slope[:] = 0.0
    work.slope[2] = 1.0
    # Rounding to a resolution has the variance of a uniform error.
    variance = p.depth_noise**2 + p.depth_resolution**2 / 12.0
    slow = p.depth_offset**2 + (p.depth_density * d.height) ** 2 + d.wave_variance * d.wave_readings
    if update(d, p, P, work, DEPTH, 0, d.height - d.predicted_height, math.sqrt(variance + slow), 2, 3):
        inject(d, p, P, work)
    d.stamp[DEPTH] = d.time - p.depth_delay


@called
def correct_heading(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Correct the estimate by a reading of the compass."""
    propagate(d, p, P)
    work.change[:] = 0.0
    sd = math.sqrt(p.heading_noise**2 + p.heading_slow**2 + 0.5 * d.thruster_iron**2)
    stop = max(p.bias_state + 1, ATTITUDE + 3)
    if heading_row(d, p, work) > LEVEL**2 and update(
        d, p, P, work, HEADING, 0, wrap(d.heading - d.predicted_heading), sd, ATTITUDE, stop
    ):
        inject(d, p, P, work)
    d.stamp[HEADING] = d.time - p.heading_delay


@called
def remember(d: Record, p: Record, P: Floats, k: int) -> None:
    """Copy the present position's covariance to states k to k + 2: the position at a USBL's last ping or a beacon's last message."""
    propagate(d, p, P)
    for j in range(P.shape[0]):
        P[k, j], P[k + 1, j], P[k + 2, j] = three(P, 0, j)
    for j in range(P.shape[0]):
        P[j, k], P[j, k + 1], P[j, k + 2] = P[j, 0], P[j, 1], P[j, 2]


@row
def put_sight(p: Record, way: Vector, work: Work) -> None:
    """Write the derivatives of the position at the ping along a direction."""
    work.slope[:] = 0.0
    put_row(work, p.ping_state, way)


@called
def correct_fix(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Correct the estimate by the USBL's position: by the range and by both components perpendicular to the line of sight.

    The gate judges the range and the two components together.
    """
    propagate(d, p, P)
    k, boat = p.ping_state, triple(p.usbl_position)
    B, r = usbl.sight(subtract(triple(d.ping_position), boat))
    seen = subtract(triple(d.fix), boat)
    aside = p.usbl_angle_noise**2 + p.usbl_alignment**2
    errors = math.sqrt(dot(seen, seen)) - r, dot(B[1], seen), dot(B[2], seen)
    noise = p.usbl_range_noise**2, aside * r * r, aside * r * r
    noise = scale(p.inflation**2, noise)
    S = work.innovation
    for i in range(3):
        put_sight(p, B[i], work)
        shared(P, work, k, k + 3)
        for j in range(3):
            S[i, j] = dot(B[j], (work.shared[k], work.shared[k + 1], work.shared[k + 2]))
        S[i, i] += noise[i]
    squared = nees(errors, S)
    d.nis[USBL] += squared
    d.innovations[USBL] += 3.0
    d.stamp[USBL] = d.ping_time
    gated = USBL * PARTS
    if squared <= p.gate_of_three:
        d.rejected[gated] = 0
    elif d.rejected[gated] < GATED_FIXES:
        d.rejected[gated] += 1
        return
    else:  # The covariance is wrong, as in `update`: the positions now and at the ping get the innovation as uncertainty.
        for i in range(3):
            P[i, :] = 0.0
            P[:, i] = 0.0
            P[i, i] = dot(errors, errors)
        remember(d, p, P, k)
    work.change[:] = 0.0
    for i in range(3):
        put_sight(p, B[i], work)
        y = errors[i] - dot(B[i], (work.change[k], work.change[k + 1], work.change[k + 2]))
        absorb(P, work, y, noise[i] + shared(P, work, k, k + 3))
    inject(d, p, P, work)


@called
def correct_surface(d: Record, p: Record, P: Floats, work: Work) -> None:
    """Correct the estimate by the horizontal position of a GNSS."""
    propagate(d, p, P)
    work.change[:] = 0.0
    sd, fix, position = math.sqrt(p.gnss_noise**2 + p.gnss_offset**2), d.gnss_fix, triple(d.position)
    x, y, _ = position
    for k in range(2):
        work.slope[:] = 0.0
        work.slope[k] = 1.0
        update(d, p, P, work, GNSS, k, fix[k] - (x if k == 0 else y), sd, k, k + 1)
    inject(d, p, P, work)
    d.stamp[GNSS] = d.time


@row
def nees(error: Vector, P: Floats) -> float:
    """Return the normalised estimation error squared of the position: error^T P^-1 error, 3 on average if P is right."""
    (a, b, c), (_, f, g), (_, _, k) = three(P, 0, 0), three(P, 0, 1), three(P, 0, 2)
    x, y, z = error
    minors = f * k - g * g, c * g - b * k, b * g - c * f
    determinant = a * minors[0] + b * minors[1] + c * minors[2]
    squares = x * x * minors[0] + y * y * (a * k - c * c) + z * z * (a * f - b * b)
    mixed = x * y * minors[1] + x * z * minors[2] + y * z * (b * c - a * g)
    return float((squares + 2.0 * mixed) / determinant) if determinant > 0.0 else math.inf
