"""USBL: positions from a boat's transceiver, by range and direction of the sound of the vehicle's transponder.

The reading is a position in world axes. Along the line of sight, its standard deviation is `range_noise`. Perpendicular to the line of
sight, its standard deviation is `angle_noise` times the range. The head's misalignment about the vertical lasts an episode and turns all
positions round the boat. Multipath makes outliers; positions are missing in bursts. A reading is the vehicle's position when the
transponder sends. The reading arrives after the sound has reached the boat and the boat's message has reached the vehicle.
"""

from __future__ import annotations

import math

from auvbench.config.ranges import SOUND
from auvbench.dynamics.layout import Matrix, Vector
from auvbench.dynamics.vectors import add, cross, dot, scale, subtract
from auvbench.tasks.navigation.state import NEVER, USBL, expect, next_of_burst, normals, uniforms
from auvbench.tasks.records import Record
from auvbench.tasks.rows import VEHICLE, put, row, triple

STEEP = 0.5
"""Squared cosine of the angle between line of sight and vertical above which `sight` derives its axes from x instead of z"""


@row
def has(e: Record, p: Record) -> bool:
    """Return whether the vehicle has a transponder; in a team, only the first `usbl_vehicles` vehicles have one."""
    return bool(e.environment // VEHICLE < p.usbl_vehicles)


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the episode."""
    if not has(e, p):
        return
    turned, _, _, _ = normals(e, d, stream, 15)
    lost, _, _, _ = uniforms(e, d, stream, 17)
    d.alignment = p.usbl_alignment * turned
    d.usbl_burst = 1 if lost < p.usbl_lost else 0
    d.ping_time = 0.0
    put(d.ping_position, (0.0, 0.0, 0.0))
    d.due[USBL] = 1.0 / p.usbl_rate


@row
def sight(way: Vector) -> tuple[Matrix, float]:
    """Return three unit vectors as rows, the first along the vector `way` from the boat, and the length of `way` in m."""
    r = math.sqrt(dot(way, way))
    along = scale(1.0 / r, way) if r > 1e-6 else (0.0, 0.0, -1.0)
    _, _, z = along
    side = cross((1.0, 0.0, 0.0) if z * z > STEEP else (0.0, 0.0, 1.0), along)
    across = scale(1.0 / math.sqrt(dot(side, side)), side)
    return (along, across, cross(along, across)), r


@row
def sense(e: Record, d: Record, p: Record, stream: int) -> bool:
    """Ping the transponder; return whether a position is under way to the vehicle."""
    u, wrong, _, _ = uniforms(e, d, stream, 18)
    a, b, c, _ = normals(e, d, stream, 16)
    way = subtract(triple(d.true_position), triple(p.usbl_position))
    (along, across, over), r = sight(way)
    d.usbl_burst = next_of_burst(d.usbl_burst, p.usbl_lost, 1.0 / (p.usbl_rate * p.usbl_burst), u)
    lost = d.usbl_burst > 0 or r > p.usbl_reach
    delay = r / SOUND + p.usbl_delay
    expect(d, USBL, 1.0 / p.usbl_rate, delay)
    if lost:
        d.arrives[USBL] = NEVER
        return False
    aside = add(scale(p.usbl_angle_noise * b, across), scale(p.usbl_angle_noise * c, over))
    (seen, _, _), _ = sight(add(along, aside))
    x, y, z = scale(r + p.usbl_range_noise * a, seen)
    cosine, sine = math.cos(d.alignment), math.sin(d.alignment)
    fix = add(triple(p.usbl_position), (cosine * x - sine * y, sine * x + cosine * y, z))
    if wrong < p.usbl_outliers:
        x, y, z, _ = normals(e, d, stream, 19)
        fix = add(fix, scale(p.usbl_outlier, (x, y, z)))
    put(d.fix, fix)
    put(d.ping_position, triple(d.position))
    d.ping_time = d.time
    return True
