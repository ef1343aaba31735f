"""DVL: four beams to the bottom, at least three of which must return. With water track, beams can measure the water instead.

Beam i points along b_i = (sin t cos a_i, sin t sin a_i, -cos t), with the tilt t and azimuths a_i of 45, 135, 225 and 315 degrees, in
body axes (forward, port, up). The beam measures b_i . (v + w x l), with the lever arm l of the DVL. The velocity is the
least-squares solution of the valid beams. With four beams, each with the standard deviation s, the standard deviations of the velocity
are s / (sqrt(2) sin t) along x and y and s / (2 cos t) along z.

Water track has the same geometry: a beam measures b_i . (v - c + w x l), with the current c in the middle of the layer. A beam is valid
only if it meets no solid before the far end of the layer (Water Linked's DVL A50: 1.5 to 4.5 m below the DVL, at 2 Hz). Each ping without
bottom lock measures the water; a real A50 measures bottom or water, as its computer commands. Left out: this command, the change of the
current and the motion of waves within the layer, the bias that a bottom beyond the layer may cause, and water with too few scatterers.
Bursts interrupt only the bottom lock.
"""

from __future__ import annotations

import math
from typing import Any

from auvbench.dynamics.compiled import called
from auvbench.dynamics.layout import Quaternion, Vector
from auvbench.dynamics.vectors import (
    add,
    cross,
    dot,
    plus_product,
    product,
    rotation_matrix,
    scale,
    subtract,
    transposed_product,
)
from auvbench.tasks.navigation.state import DVL, expect, next_of_burst, normals, uniforms
from auvbench.tasks.navigation.turns import attitude_of
from auvbench.tasks.records import Record
from auvbench.tasks.rows import current_at, put, row, triple
from auvbench.worlds.casting import distance_to, first_hit

BEAMS = 4
ENOUGH = 3
"""Number of valid beams that a velocity needs"""
_HALF = math.sqrt(0.5)


@row
def beam(p: Record, i: int) -> Vector:
    """Return the direction of a beam in body axes."""
    level = _HALF * p.dvl_sine
    fore = level if i == 0 or i == 3 else -level
    port = level if i < 2 else -level
    return fore, port, -p.dvl_cosine


@row
def beam_sd(d: Record, p: Record) -> float:
    """Return the standard deviation of a beam's velocity in m/s.

    The figure of merit is the standard deviation of a horizontal velocity from four beams.
    """
    return float(d.merit * math.sqrt(2.0) * p.dvl_sine)


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the episode."""
    x, y, z, k = normals(e, d, stream, 5)
    u, lost, _, _ = uniforms(e, d, stream, 6)
    d.dvl_scale = p.dvl_scale * k
    put(d.mounting, scale(p.dvl_mounting, (x, y, z)))
    d.merit = p.dvl_merit_low * (p.dvl_merit_high / p.dvl_merit_low) ** u if p.has_dvl > 0 else 0.0
    d.burst = 1 if lost < p.dvl_lost else 0
    d.beams = d.on_water = 0
    d.altitude = 0.0
    periods = p.dvl_periods
    d.dvl_period = periods[0]
    d.due[DVL] = d.dvl_period


@row
def period(p: Record, altitude: float) -> float:
    """Return the time in s between pings at an altitude in m; without an altitude (0), the time of the slowest mode."""
    last = len(p.dvl_altitudes) - 1
    if altitude <= 0.0:
        slowest = 0.0
        for mode in range(last + 1):
            slowest = max(slowest, p.dvl_periods[mode])
        return float(slowest)
    for mode in range(last):
        if altitude <= p.dvl_altitudes[mode]:
            return float(p.dvl_periods[mode])
    return float(p.dvl_periods[last])


@row
def height_along(p: Record, solids: Any, heights: Any, time: float, origin: Vector, way: Vector) -> float:
    """Return the altitude in m that a beam measures: distance to the echo times cosine of the beam's tilt; 0 if no echo returns.

    Args:
        p: parameters.
        solids: records of the solids in the water.
        heights: heights of terrain, m.
        time: time since the start of the episode, s.
        origin: start of the beam, m, world axes.
        way: direction of the beam, world axes.
    """
    upright = p.dvl_cosine
    longest = p.dvl_high / upright
    distance, solid = first_hit(solids, heights, time, origin, way, longest + 1.0)
    if distance > longest or distance * upright < p.dvl_low:
        return 0.0
    # Just before the surface, the gradient of the distance is the surface's normal.
    spot = add(origin, scale(distance - min(1e-3, 0.5 * distance), way))
    _, normal = distance_to(solids[solid], heights, time, spot, 1.0)
    return distance * upright if -dot(normal, way) > p.dvl_flattest else 0.0


@row
def solve(d: Record, p: Record) -> Vector:
    """Return the velocity in m/s, body axes, from the valid beams: all four, or three."""
    u = d.beam_velocity
    if d.beams == BEAMS:
        level = _HALF / (2.0 * p.dvl_sine)
        x = level * (u[0] - u[1] - u[2] + u[3])
        y = level * (u[0] + u[1] - u[2] - u[3])
        return x, y, -(u[0] + u[1] + u[2] + u[3]) / (4.0 * p.dvl_cosine)
    valid = d.valid
    first = 1 if valid[0] == 0 else 0
    second = 2 if valid[1] == 0 or first == 1 else 1
    third = 3 if valid[3] > 0 else 2
    a, b, c = beam(p, first), beam(p, second), beam(p, third)
    # The rows of the inverse are cross products of the beams.
    ab, bc, ca = cross(a, b), cross(b, c), cross(c, a)
    total = add(add(scale(u[first], bc), scale(u[second], ca)), scale(u[third], ab))
    return scale(1.0 / dot(a, bc), total)


@row
def through_water(d: Record) -> Vector:
    """Return the estimate's velocity through the water in m/s, world axes."""
    current = d.current
    return subtract(triple(d.velocity), (current[0], current[1], 0.0))


@row
def relative(d: Record) -> Vector:
    """Return the estimate's velocity in m/s, world axes, relative to the bottom or the water, whichever the last ping measured."""
    return through_water(d) if d.on_water > 0 else triple(d.velocity)


@row
def predicted(d: Record, p: Record) -> Vector:
    """Return the velocity at the DVL in m/s, body axes, that the last ping would measure if the estimate were exact."""
    own = transposed_product(rotation_matrix(attitude_of(d.attitude)), relative(d))
    there = add(own, cross(subtract(triple(d.rates), triple(d.rate_bias)), triple(p.dvl_lever)))
    return scale(1.0 + d.scale, there)


@row
def with_errors(d: Record, velocity: Vector) -> Vector:
    """Return a velocity with the errors of scale and mounting."""
    return scale(1.0 + d.dvl_scale, add(velocity, cross(velocity, triple(d.mounting))))


@row
def is_clear(p: Record, solids: Any, heights: Any, time: float, origin: Vector, way: Vector) -> bool:
    """Return whether a beam meets no solid before the far end of the water layer; for the arguments, see `height_along`."""
    end = p.dvl_water_far / p.dvl_cosine
    distance, _ = first_hit(solids, heights, time, origin, way, end + 1.0)
    return bool(distance > end)


@called
def sense_water(
    d: Record, p: Record, solids: Any, heights: Any, origin: Vector, velocity: Vector, noise: Quaternion
) -> None:
    """Measure the beams' velocities relative to the water; `velocity` is the DVL's velocity through the water in m/s, body axes."""
    rotation, measured = rotation_matrix(attitude_of(d.true_attitude)), with_errors(d, velocity)
    sd = p.dvl_water_noise * beam_sd(d, p)
    d.beams, d.on_water, d.dvl_period = 0, 1, 1.0 / p.dvl_water_rate
    for i in range(BEAMS):
        way = beam(p, i)
        clear = is_clear(p, solids, heights, d.time, origin, product(rotation, way))
        d.valid[i] = 1 if clear else 0
        d.beams += d.valid[i]
        d.beam_velocity[i] = dot(way, measured) + sd * noise[i]


@called
def sense(e: Record, d: Record, p: Record, stream: int, solids: Any, heights: Any, water: Record) -> None:
    """Ping: measure the beams' velocities and the DVL's velocity.

    The velocities are relative to the bottom or, for a DVL with water track and without bottom lock, to the water. `water` is the
    current as `Simulator.set_current` stores it.
    """
    rotation = rotation_matrix(attitude_of(d.true_attitude))
    lever = triple(p.dvl_lever)
    origin = plus_product(triple(d.true_position), rotation, lever)
    velocity = add(transposed_product(rotation, triple(d.true_velocity)), cross(triple(d.true_rates), lever))
    measured = with_errors(d, velocity)
    u, _, _, _ = uniforms(e, d, stream, 6)
    noise = normals(e, d, stream, 7)
    d.burst = next_of_burst(d.burst, p.dvl_lost, d.dvl_period / p.dvl_burst, u)
    able = d.burst == 0 and dot(velocity, velocity) <= p.dvl_fastest**2
    sd = beam_sd(d, p)
    d.beams, d.on_water, total = 0, 0, 0.0
    for i in range(BEAMS):
        way = beam(p, i)
        altitude = height_along(p, solids, heights, d.time, origin, product(rotation, way)) if able else 0.0
        d.valid[i] = 1 if altitude > 0.0 else 0
        d.beams += d.valid[i]
        total += altitude
        d.beam_velocity[i] = dot(way, measured) + sd * noise[i]
    d.altitude = total / d.beams if d.beams > 0 else 0.0
    d.dvl_period = period(p, d.altitude)
    if d.beams < ENOUGH and p.dvl_water_track > 0:
        _, _, z = origin
        current = current_at(water, z - 0.5 * (p.dvl_water_near + p.dvl_water_far))
        through = subtract(velocity, transposed_product(rotation, current))
        sense_water(d, p, solids, heights, origin, through, noise)
    if d.beams >= ENOUGH:
        put(d.dvl_velocity, solve(d, p))
    put(d.predicted_velocity, predicted(d, p))
    expect(d, DVL, d.dvl_period, p.dvl_delay)
