"""IMU: means of specific force and angular rates over each interval, with white noise and a bias.

The bias is a constant of the episode plus a first-order Gauss-Markov process, which moves once per agent step by its exact discretisation.
An IMU with coning and sculling compensation gives such means: without sensor errors, the motion follows exactly from these means. The
rotation of the Earth is left out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.layout import Matrix, Quaternion, Vector
from auvbench.dynamics.vectors import add, product, rotation_matrix, scale, subtract, transposed_product
from auvbench.tasks.navigation.state import normals
from auvbench.tasks.navigation.turns import attitude_of, half, multiply, turn, vector_of
from auvbench.tasks.records import Record
from auvbench.tasks.rows import put, row, triple

Floats = NDArray[np.float64]


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the constant biases; the Gauss-Markov processes start at 0."""
    a, b, c, x = normals(e, d, stream, 13)
    y, z, _, _ = normals(e, d, stream, 14)
    put(d.turn_on_acceleration, scale(p.accelerometer_turn_on, (a, b, c)))
    put(d.turn_on_rates, scale(p.gyro_turn_on, (x, y, z)))
    put(d.walk_acceleration, (0.0, 0.0, 0.0))
    put(d.walk_rates, (0.0, 0.0, 0.0))


@row
def decayed(walk: float, tau: float, seconds: float) -> tuple[float, float]:
    """Return a Gauss-Markov process's decay factor over `seconds`, and the standard deviation of the noise added in this time.

    `walk` is the density of the driving noise: the stationary standard deviation is walk sqrt(tau / 2).
    """
    phi = math.exp(-seconds / tau)
    return phi, walk * math.sqrt(0.5 * tau * (1.0 - phi * phi))


@row
def walk(e: Record, d: Record, p: Record, stream: int, seconds: float) -> None:
    """Advance the Gauss-Markov processes of the biases by a time in s."""
    if p.accelerometer_walk == 0.0 and p.gyro_walk == 0.0:
        return
    a, b, c, x = normals(e, d, stream, 10)
    y, z, _, _ = normals(e, d, stream, 11)
    phi, sd = decayed(p.accelerometer_walk, p.accelerometer_tau, seconds)
    put(d.walk_acceleration, add(scale(phi, triple(d.walk_acceleration)), scale(sd, (a, b, c))))
    phi, sd = decayed(p.gyro_walk, p.gyro_tau, seconds)
    put(d.walk_rates, add(scale(phi, triple(d.walk_rates)), scale(sd, (x, y, z))))


@row
def moved(
    before: Quaternion, after: Quaternion, gained: Vector, gravity: float, seconds: float
) -> tuple[Vector, Vector]:
    """Return the mean specific force in m/s2, in the body axes at the middle of an interval, and the mean rates in rad/s.

    Args:
        before: attitude at the start of the interval.
        after: attitude at the end of the interval.
        gained: change of the velocity in world axes, m/s.
        gravity: acceleration of gravity, m/s2.
        seconds: length of the interval.
    """
    w, x, y, z = before
    w, x, y, z = multiply((w, -x, -y, -z), after)
    turned = (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)
    way = vector_of(turned)
    middle = rotation_matrix(multiply(before, half(turned)))
    gx, gy, gz = scale(1.0 / seconds, gained)
    return transposed_product(middle, (gx, gy, gz + gravity)), scale(1.0 / seconds, way)


@row
def sense(e: Record, d: Record, p: Record, stream: int, force: Vector, rates: Vector, seconds: float) -> None:
    """Measure the specific force and the rates, which are means over an interval of `seconds` s."""
    a, b, c, x = normals(e, d, stream, 0)
    y, z, _, _ = normals(e, d, stream, 1)
    root = 1.0 / math.sqrt(seconds)
    bias = add(triple(d.turn_on_acceleration), triple(d.walk_acceleration))
    put(d.specific_force, add(add(force, bias), scale(p.accelerometer_density * root, (a, b, c))))
    bias = add(triple(d.turn_on_rates), triple(d.walk_rates))
    put(d.rates, add(add(rates, bias), scale(p.gyro_density * root, (x, y, z))))


@row
def advance(d: Record, p: Record, seconds: float) -> tuple[Vector, Matrix]:
    """Advance the estimate by the IMU's last measurement.

    Returns:
        Specific force in world axes, m/s2, and the rotation matrix in the middle of the interval.
    """
    rates = subtract(triple(d.rates), triple(d.rate_bias))
    part = turn(scale(0.5 * seconds, rates))
    middle = multiply(attitude_of(d.attitude), part)
    R = rotation_matrix(middle)
    force = product(R, subtract(triple(d.specific_force), triple(d.acceleration_bias)))
    fx, fy, fz = force
    gained = scale(seconds, (fx, fy, fz - p.gravity))
    velocity = triple(d.velocity)
    put(d.position, add(triple(d.position), scale(seconds, add(velocity, scale(0.5, gained)))))
    put(d.velocity, add(velocity, gained))
    put_attitude(d.attitude, multiply(middle, part))
    return force, R


@row
def put_attitude(field: Floats, q: Quaternion) -> None:
    """Scale a quaternion to length 1 and write it to a field of a record."""
    w, x, y, z = q
    length = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    field[0], field[1], field[2], field[3] = w * length, x * length, y * length, z * length
