"""Read and write the records of `layout`: one vehicle of a block, a single field, or a discretisation.

Only this module and `vectors` use numeric indices of vectors and matrices.
"""

from __future__ import annotations

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Matrix, Pair, Quaternion, Record, Rows, Vector


# --- Access to one lane of a block ------------------------------------------------------------------------------------------------
@inline
def three(rows: Rows, lane: int) -> Vector:
    """Return one vehicle's vector from rows (3, LANES)."""
    return rows[0, lane], rows[1, lane], rows[2, lane]


@inline
def four(rows: Rows, lane: int) -> Quaternion:
    """Return one vehicle's quaternion from rows (4, LANES)."""
    return rows[0, lane], rows[1, lane], rows[2, lane], rows[3, lane]


@inline
def matrix(rows: Rows, lane: int) -> Matrix:
    """Return one vehicle's matrix from rows (3, 3, LANES)."""
    return (
        (rows[0, 0, lane], rows[0, 1, lane], rows[0, 2, lane]),
        (rows[1, 0, lane], rows[1, 1, lane], rows[1, 2, lane]),
        (rows[2, 0, lane], rows[2, 1, lane], rows[2, 2, lane]),
    )


@inline
def diagonal(rows: Rows, lane: int) -> Vector:
    """Return xx, yy, zz of one vehicle's symmetric matrix from rows (6, LANES)."""
    return rows[0, lane], rows[1, lane], rows[2, lane]


@inline
def off_diagonal(rows: Rows, lane: int) -> Vector:
    """Return xy, xz, yz of one vehicle's symmetric matrix from rows (6, LANES)."""
    return rows[3, lane], rows[4, lane], rows[5, lane]


@inline
def symmetric_of(diagonal: Vector, off_diagonal: Vector) -> Matrix:
    """Return the symmetric matrix with the diagonal (xx, yy, zz) and the off-diagonal entries (xy, xz, yz)."""
    xx, yy, zz = diagonal
    xy, xz, yz = off_diagonal
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


@inline
def symmetric(rows: Rows, lane: int) -> Matrix:
    """Return one vehicle's symmetric matrix from rows (6, LANES)."""
    return symmetric_of(diagonal(rows, lane), off_diagonal(rows, lane))


@inline
def put3(rows: Rows, lane: int, a: Vector) -> None:
    """Write one vehicle's vector to rows (3, LANES)."""
    rows[0, lane] = a[0]
    rows[1, lane] = a[1]
    rows[2, lane] = a[2]


@inline
def put4(rows: Rows, lane: int, q: Quaternion) -> None:
    """Write one vehicle's quaternion to rows (4, LANES)."""
    rows[0, lane] = q[0]
    rows[1, lane] = q[1]
    rows[2, lane] = q[2]
    rows[3, lane] = q[3]


@inline
def add3(rows: Rows, lane: int, a: Vector) -> None:
    """Add a to one vehicle's vector in rows (3, LANES)."""
    rows[0, lane] += a[0]
    rows[1, lane] += a[1]
    rows[2, lane] += a[2]


@inline
def add4(rows: Rows, lane: int, q: Quaternion) -> None:
    """Add q to one vehicle's quaternion in rows (4, LANES)."""
    rows[0, lane] += q[0]
    rows[1, lane] += q[1]
    rows[2, lane] += q[2]
    rows[3, lane] += q[3]


@inline
def subtract3(rows: Rows, lane: int, a: Vector) -> None:
    """Subtract a from one vehicle's vector in rows (3, LANES)."""
    rows[0, lane] -= a[0]
    rows[1, lane] -= a[1]
    rows[2, lane] -= a[2]


@inline
def vector(a: Rows) -> Vector:
    """Return a field (3,) as a tuple."""
    return a[0], a[1], a[2]


@inline
def quaternion(a: Rows) -> Quaternion:
    """Return a field (4,) as a tuple."""
    return a[0], a[1], a[2], a[3]


@inline
def set3(field: Rows, a: Vector) -> None:
    """Write a tuple to a field (3,)."""
    field[0] = a[0]
    field[1] = a[1]
    field[2] = a[2]


@inline
def set4(field: Rows, q: Quaternion) -> None:
    """Write a tuple to a field (4,)."""
    field[0] = q[0]
    field[1] = q[1]
    field[2] = q[2]
    field[3] = q[3]


# --- Access to a discretisation -------------------------------------------------------------------------------------------------
@inline
def order_1(D: Record) -> Vector:
    """Return A, B and C of a `DISCRETE` of order 1."""
    return D.A[0, 0], D.B[0], D.C[0]


@inline
def order_2(D: Record) -> tuple[tuple[Pair, Pair], Pair, Pair]:
    """Return A, B and C of a `DISCRETE` of order 2."""
    A, B, C = D.A, D.B, D.C
    return ((A[0, 0], A[0, 1]), (A[1, 0], A[1, 1])), (B[0], B[1]), (C[0], C[1])


@inline
def order_3(D: Record) -> tuple[Matrix, Vector, Vector]:
    """Return A, B and C of a `DISCRETE` of order 3."""
    A = D.A
    rows = (A[0, 0], A[0, 1], A[0, 2]), (A[1, 0], A[1, 1], A[1, 2]), (A[2, 0], A[2, 1], A[2, 2])
    return rows, vector(D.B), vector(D.C)
