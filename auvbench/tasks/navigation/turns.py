"""Products and logarithms of unit quaternions (w, x, y, z), for attitudes that turn by small steps."""

from __future__ import annotations

import math
from typing import Any

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Matrix, Quaternion, Vector
from auvbench.dynamics.vectors import dot, scale, unit

SMALL = 1e-3
"""Squared angle below which series replace sine and cosine, rad2; a turn at 3 rad/s for 0.01 s has the squared angle 9e-4"""


@inline
def attitude_of(field: Any) -> Quaternion:
    """Return a field (4,) as a quaternion tuple."""
    return field[0], field[1], field[2], field[3]


@inline
def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product a b: the rotation b, followed by the rotation a."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@inline
def turn(vector: Vector) -> Quaternion:
    """Return the rotation about a vector by its length in rad."""
    x, y, z = vector
    squared = dot(vector, vector)
    if squared < SMALL:  # series, accurate to the last bit but one
        share = 0.5 - squared / 48.0 * (1.0 - squared / 80.0 * (1.0 - squared / 168.0))
        cosine = 1.0 - squared / 8.0 * (1.0 - squared / 48.0 * (1.0 - squared / 120.0))
    else:
        angle = math.sqrt(squared)
        share, cosine = math.sin(0.5 * angle) / angle, math.cos(0.5 * angle)
    return cosine, share * x, share * y, share * z


@inline
def half(q: Quaternion) -> Quaternion:
    """Return half of a rotation by less than half a turn, with w > 0."""
    w, x, y, z = q
    return unit((w + 1.0, x, y, z))


@inline
def vector_of(q: Quaternion) -> Vector:
    """Return the rotation vector in rad of a rotation by less than half a turn; the inverse of `turn`."""
    w, x, y, z = q
    squared = x * x + y * y + z * z
    if squared < 0.25 * SMALL:  # series of the arcsine, accurate to the last bit but one
        share = 2.0 + squared * (
            1.0 / 3.0 + squared * (3.0 / 20.0 + squared * (5.0 / 56.0 + squared * 35.0 / 576.0))
        )
    else:
        length = math.sqrt(squared)
        share = 2.0 * math.atan2(length, abs(w)) / length
    return scale(share if w >= 0.0 else -share, (x, y, z))


@inline
def cross_matrix(a: Vector) -> Matrix:
    """Return [a]x, so that [a]x b = a x b."""
    x, y, z = a
    return (0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)
