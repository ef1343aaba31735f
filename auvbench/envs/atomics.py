"""What compiled threads need to talk to each other: loads and stores that keep their order, and a polite wait."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

sched_yield = types.ExternalFunction("sched_yield", types.int32())
"""sched_yield(2): lets another thread have the processor if one waits for it."""


def _pointer(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return cgutils.get_item_pointer(  # type: ignore[no-untyped-call]
        context, builder, signature.args[0], array, [arguments[1]], wraparound=False
    )


@intrinsic
def load(_context: Any, array: Any, index: Any) -> Any:
    """`array[index]` of 64-bit integers; what its writer wrote before `store` is seen after it (acquire)."""

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(_pointer(context, builder, signature, arguments), "acquire", 8)

    return types.int64(array, types.intp), generate


@intrinsic
def store(_context: Any, array: Any, index: Any, value: Any) -> Any:
    """`array[index] = value` after everything that this thread wrote before it (release)."""

    def generate(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature, arguments)
        builder.store_atomic(arguments[2], pointer, "release", 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.int64), generate
