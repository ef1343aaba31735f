"""Dead reckoning: integrate the DVL's velocity along the estimated attitude.

The gyros give the attitude; accelerometers (roll and pitch) and compass (yaw) correct this attitude with a time constant. The height is
the last reading of the depth sensor. Without bottom lock, the estimate keeps the last velocity in body axes.
"""

from __future__ import annotations

import math

from auvbench.dynamics.layout import Vector
from auvbench.dynamics.vectors import add, cross, dot, product, rotation_matrix, scale, subtract
from auvbench.tasks.navigation.imu import put_attitude
from auvbench.tasks.navigation.state import DEPTH, DVL, HEADING
from auvbench.tasks.navigation.turns import attitude_of, multiply, turn
from auvbench.tasks.records import Record
from auvbench.tasks.rows import put, row, triple, wrap


@row
def advance(d: Record, p: Record, before: Vector, force: Vector, seconds: float) -> None:
    """Correct the estimate after the IMU has moved it over an interval: roll and pitch by the specific force, velocity by the DVL.

    Args:
        d: estimate, whose attitude the gyros have moved.
        p: parameters.
        before: position before the interval, m.
        force: specific force, m/s2, world axes.
        seconds: length of the interval.
    """
    length = math.sqrt(dot(force, force))
    if length > 0.0:
        x, y, _ = force
        level = scale(seconds / (p.settling * length), (y, -x, 0.0))
        put_attitude(d.attitude, multiply(turn(level), attitude_of(d.attitude)))
    velocity = product(rotation_matrix(attitude_of(d.attitude)), triple(d.water_velocity))
    put(d.velocity, velocity)
    (x, y, _), (_, _, z) = add(before, scale(seconds, velocity)), before
    put(d.position, (x, y, z))


@row
def correct_velocity(d: Record, p: Record) -> None:
    """Set the velocity of the body origin to the velocity of the DVL's last ping, corrected for the DVL's lever arm."""
    rates = subtract(triple(d.rates), triple(d.rate_bias))
    put(d.water_velocity, subtract(triple(d.dvl_velocity), cross(rates, triple(p.dvl_lever))))
    d.stamp[DVL] = d.time - p.dvl_delay


@row
def correct_depth(d: Record, p: Record) -> None:
    """Set the height to the depth sensor's reading."""
    d.position[2] = d.height
    d.stamp[DEPTH] = d.time - p.depth_delay


@row
def correct_heading(d: Record, p: Record) -> None:
    """Turn the estimated yaw towards the compass's heading, by the fraction of the error that follows from the time constant."""
    share = 1.0 - math.exp(-1.0 / (p.heading_rate * p.settling))
    way = turn((0.0, 0.0, share * wrap(d.heading - d.predicted_heading)))
    put_attitude(d.attitude, multiply(way, attitude_of(d.attitude)))
    d.stamp[HEADING] = d.time - p.heading_delay
