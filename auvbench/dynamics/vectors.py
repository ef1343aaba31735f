"""Vectors of three numbers, matrices of three rows and unit quaternions (w, x, y, z), all as tuples.

Functions are inlined into their callers: LLVM removes the tuples, and a loop over vehicles stays one loop of vector
instructions. The order of sums must not change, so that results keep their last bit.
"""

from __future__ import annotations

import math

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Matrix, Quaternion, Vector

ZERO = (0.0, 0.0, 0.0)


@inline
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def scale(s: float, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@inline
def times(a: Vector, b: Vector) -> Vector:
    """Return diag(a) b."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@inline
def absolute(a: Vector) -> Vector:
    """Return the absolute values."""
    return abs(a[0]), abs(a[1]), abs(a[2])


@inline
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b = S(a) b (Fossen 2011, definition 2.2)."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def plus_cross(h: Vector, a: Vector, b: Vector) -> Vector:
    """Return h + a x b."""
    return (
        h[0] + a[1] * b[2] - a[2] * b[1],
        h[1] + a[2] * b[0] - a[0] * b[2],
        h[2] + a[0] * b[1] - a[1] * b[0],
    )


@inline
def product(M: Matrix, a: Vector) -> Vector:
    """Return M a."""
    return (
        M[0][0] * a[0] + M[0][1] * a[1] + M[0][2] * a[2],
        M[1][0] * a[0] + M[1][1] * a[1] + M[1][2] * a[2],
        M[2][0] * a[0] + M[2][1] * a[1] + M[2][2] * a[2],
    )


@inline
def plus_product(h: Vector, M: Matrix, a: Vector) -> Vector:
    """Return h + M a."""
    return (
        h[0] + M[0][0] * a[0] + M[0][1] * a[1] + M[0][2] * a[2],
        h[1] + M[1][0] * a[0] + M[1][1] * a[1] + M[1][2] * a[2],
        h[2] + M[2][0] * a[0] + M[2][1] * a[1] + M[2][2] * a[2],
    )


@inline
def transposed_product(M: Matrix, a: Vector) -> Vector:
    """Return M^T a; for a rotation matrix, the inverse rotation."""
    return (
        M[0][0] * a[0] + M[1][0] * a[1] + M[2][0] * a[2],
        M[0][1] * a[0] + M[1][1] * a[1] + M[2][1] * a[2],
        M[0][2] * a[0] + M[1][2] * a[1] + M[2][2] * a[2],
    )


@inline
def hollow_product(off: Vector, a: Vector) -> Vector:
    """Return N a for the symmetric matrix N with a zero diagonal and the off-diagonal entries `off` = (xy, xz, yz)."""
    xy, xz, yz = off
    return xy * a[1] + xz * a[2], xy * a[0] + yz * a[2], xz * a[0] + yz * a[1]


@inline
def plus_hollow_product(h: Vector, off: Vector, a: Vector) -> Vector:
    """Return h + N a for the symmetric matrix N with a zero diagonal and the off-diagonal entries `off` = (xy, xz, yz)."""
    xy, xz, yz = off
    return h[0] + xy * a[1] + xz * a[2], h[1] + xy * a[0] + yz * a[2], h[2] + xz * a[0] + yz * a[1]


@inline
def rotation_matrix(q: Quaternion) -> Matrix:
    """Return R(q), body to world, of a quaternion; a rotation if q has length 1 (Fossen 2011, eq. 2.65)."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@inline
def up_axis(R: Matrix) -> Vector:
    """Return the world's z axis in body axes, R^T [0; 0; 1]."""
    return R[2]


@inline
def quaternion_rate(q: Quaternion, omega: Vector) -> Quaternion:
    """Return q' = T(q) omega of a body that turns with `omega` in body axes (Fossen 2011, section 2.2.2)."""
    w, x, y, z = q
    roll, pitch, yaw = omega
    return (
        -0.5 * (x * roll + y * pitch + z * yaw),
        0.5 * (w * roll + y * yaw - z * pitch),
        0.5 * (w * pitch + z * roll - x * yaw),
        0.5 * (w * yaw + x * pitch - y * roll),
    )


@inline
def add_quaternions(q: Quaternion, r: Quaternion) -> Quaternion:
    """Return q + r."""
    return q[0] + r[0], q[1] + r[1], q[2] + r[2], q[3] + r[3]


@inline
def scale_quaternion(s: float, q: Quaternion) -> Quaternion:
    """Return s q."""
    return s * q[0], s * q[1], s * q[2], s * q[3]


@inline
def unit(q: Quaternion) -> Quaternion:
    """Return q / |q|."""
    w, x, y, z = q
    shrink = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * shrink, x * shrink, y * shrink, z * shrink
