"""ONNX files that attack their reader: fields hidden from other parsers, endless work, huge sizes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from onnx import TensorProto, helper, numpy_helper

from tests.onnx_files import model, port, weights

HIGH = 1 << 32
"""Added to the number of a field: parsers that cut the tag to 32 bits obey it, others see an unknown field"""


def varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def field(number: int, data: bytes, *, high: bool = False) -> bytes:
    """A field of bytes; with `high` its tag has a bit above 2^32."""
    return varint((number << 3 | 2) + (HIGH if high else 0)) + varint(len(data)) + data


def number(number: int, value: int, *, high: bool = False) -> bytes:
    return varint((number << 3) + (HIGH if high else 0)) + varint(value)


def with_graph(made: Any, more: bytes) -> bytes:
    """The file of a model whose graph has further bytes."""
    graph = made.graph.SerializeToString() + more
    made.ClearField("graph")
    return bytes(made.SerializeToString()) + field(7, graph)


def loop() -> Any:
    """A Loop of `turns` turns."""
    body = helper.make_graph(
        [helper.make_node("Identity", ["c"], ["d"]), helper.make_node("Identity", ["v"], ["w"])],
        "body",
        [port("i", kind=TensorProto.INT64), port("c", kind=TensorProto.BOOL), port("v", "n", 6)],
        [port("d", kind=TensorProto.BOOL), port("w", "n", 6)],
    )
    return helper.make_node("Loop", ["turns", "", "h"], ["a"], body=body)


def turns() -> Any:
    return numpy_helper.from_array(np.array(2**62), "turns")


def linear(*nodes: Any) -> Any:
    """h = x W, then further operators."""
    return model([helper.make_node("MatMul", ["x", "W"], ["h"]), *nodes])


def hidden_loop() -> bytes:
    made = linear()
    made.graph.initializer.append(turns())
    return with_graph(made, field(1, loop().SerializeToString(), high=True))


def hidden_foreign() -> bytes:
    made = linear()
    made.opset_import.append(helper.make_opsetid("com.microsoft", 1))
    node = helper.make_node("Gelu", ["h"], ["a"], domain="com.microsoft")
    return with_graph(made, field(1, node.SerializeToString(), high=True))


def external(location: str, *, high: bool) -> bytes:
    """Weights that lie in another file."""
    made = model()
    tensor = made.graph.initializer[0]
    tensor.ClearField("raw_data")
    entry = field(1, b"location") + field(2, location.encode())
    data = tensor.SerializeToString() + field(13, entry, high=high) + number(14, 1, high=high)
    del made.graph.initializer[:]
    return with_graph(made, field(5, data))


def with_unknown_fields() -> bytes:
    """A harmless file with fields that onnx.proto does not have, at every level."""
    made = model()
    node, tensor = made.graph.node[0].SerializeToString(), made.graph.initializer[0].SerializeToString()
    del made.graph.node[0], made.graph.initializer[0]
    unknown = field(1000, b"UNKNOWN")
    last = made.graph.node[0].SerializeToString()
    del made.graph.node[0]
    graph = field(1, node + unknown) + field(1, last) + field(5, tensor + unknown) + unknown
    return with_graph(made, graph) + unknown


def sized(kind: str, lengths: list[int], *more: str) -> Any:
    """An operator whose answer has these lengths; its sum is added to the action."""
    size = numpy_helper.from_array(np.array(lengths), "lengths")
    one = numpy_helper.from_array(np.ones([1] * len(lengths), dtype=np.float32), "one")
    made = linear(
        helper.make_node(kind, [*more, "lengths"], ["large"]),
        helper.make_node("ReduceSum", ["large"], ["sum"], keepdims=0),
        helper.make_node("Add", ["h", "sum"], ["a"]),
    )
    made.graph.initializer.extend([size, one])
    return made


def outer() -> Any:
    """(k, 1) + (1, k): a small file whose sum has k^2 numbers."""
    column = numpy_helper.from_array(np.zeros((200_000, 1), dtype=np.float32), "column")
    row = numpy_helper.from_array(np.zeros((1, 200_000), dtype=np.float32), "row")
    made = linear(
        helper.make_node("Add", ["column", "row"], ["large"]),
        helper.make_node("ReduceSum", ["large"], ["sum"], keepdims=0),
        helper.make_node("Add", ["h", "sum"], ["a"]),
    )
    made.graph.initializer.extend([column, row])
    return made


def many() -> Any:
    """Operators that each keep a million numbers until the last one adds them."""
    made = sized("ConstantOfShape", [1_000_000])
    del made.graph.node[2:]
    names = [f"t{i}" for i in range(200)]
    made.graph.node.extend(helper.make_node("Neg", ["large"], [name]) for name in names)
    made.graph.node.append(helper.make_node("Sum", names, ["all"]))
    made.graph.node.append(helper.make_node("ReduceSum", ["all"], ["sum"], keepdims=0))
    made.graph.node.append(helper.make_node("Add", ["h", "sum"], ["a"]))
    return made


def from_data() -> Any:
    """A shape that depends on the observation."""
    made = linear(
        helper.make_node("ReduceMax", ["x"], ["most"], keepdims=0),
        helper.make_node("Exp", ["most"], ["more"]),
        helper.make_node("Cast", ["more"], ["count"], to=TensorProto.INT64),
        helper.make_node("Reshape", ["count", "minus"], ["lengths"]),
        helper.make_node("ConstantOfShape", ["lengths"], ["large"]),
        helper.make_node("ReduceSum", ["large"], ["sum"], keepdims=0),
        helper.make_node("Add", ["h", "sum"], ["a"]),
    )
    made.graph.initializer.append(numpy_helper.from_array(np.array([-1]), "minus"))
    made.graph.value_info.append(port("large", 1))  # a lie
    return made


def large_weights(*lengths: int, keep: bool = False) -> Any:
    """Weights of these lengths; with `keep` the file has numbers, but too few."""
    made = model()
    tensor = made.graph.initializer[0]
    if not keep:
        tensor.ClearField("raw_data")
    del tensor.dims[:]
    tensor.dims.extend(lengths)
    return made


def large_constant(*lengths: int) -> Any:
    tensor = TensorProto(name="t", data_type=TensorProto.FLOAT, dims=lengths)
    return linear(
        helper.make_node("Constant", [], ["c"], value=tensor), helper.make_node("Add", ["h", "c"], ["a"])
    )


def empty_parts(count: int) -> bytes:
    """So many operators, each of two bytes."""
    return field(7, field(1, b"") * count)


def nested(depth: int) -> bytes:
    """A type of a sequence of a sequence of ..."""
    data = b""
    for _ in range(depth):
        data = field(4, field(1, data))
    return with_graph(model(), field(13, field(1, b"deep") + field(2, data)))


def least_over_minus_one(kind: str, dtype: Any, *, folded: bool) -> Any:
    """The least whole number through -1, at which x86 stops a process; `folded`: while the file is loaded."""
    least = numpy_helper.from_array(np.array([np.iinfo(dtype).min], dtype=dtype), "least")
    minus = numpy_helper.from_array(np.array([-1], dtype=dtype), "minus")
    whole = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
    sign = (
        []
        if folded
        else [
            helper.make_node("ReduceSum", ["x"], ["all"], keepdims=0),
            helper.make_node("Abs", ["all"], ["size"]),
            helper.make_node("Cast", ["size"], ["n"], to=whole),
            helper.make_node("Max", ["n", "zero"], ["k"]),
            helper.make_node("Sub", ["minus", "k"], ["below"]),
            helper.make_node("Max", ["below", "minus"], ["one"]),  # -1, whatever is observed
        ]
    )
    made = linear(
        *sign,
        helper.make_node(kind, ["least", "minus" if folded else "one"], ["q"]),
        helper.make_node("Cast", ["q"], ["f"], to=TensorProto.FLOAT),
        helper.make_node("Add", ["h", "f"], ["a"]),
    )
    made.graph.initializer.extend([least, minus, numpy_helper.from_array(np.array([0], dtype=dtype), "zero")])
    return made


def write_weights(path: Path) -> None:
    path.write_bytes(weights().tobytes())
