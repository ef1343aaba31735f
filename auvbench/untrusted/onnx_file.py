"""Read an ONNX file that another person may have written, and keep only what a policy needs.

The file is parsed by the `onnx` package, reduced to known fields and operators, and serialised again. A runtime gets these
bytes, never the file: what this reader does not know cannot reach it. Refused are

* weights in other files (`external_data`): a path in the file would be read;
* operators outside `OPERATORS`: other domains, functions, control flow, random numbers;
* tensors whose shape does not follow from the shape of the input, or that are too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from auvbench.errors import MissingExtraError
from auvbench.untrusted.text import first_line, short

LARGEST = 16 * 1024**2
"""bytes of a file; parsing may take a hundred times as much memory"""
MESSAGES = 100_000
"""parts of a file: operators, attributes, tensors, dimensions, ..."""
ELEMENTS = 1 << 25
"""numbers in all tensors that are computed together"""

KEPT = {
    "ModelProto": "ir_version opset_import graph",
    "OperatorSetIdProto": "domain version",
    "GraphProto": "node name initializer input output",
    "NodeProto": "input output name op_type domain attribute",
    "AttributeProto": "name type f i s t floats ints strings",
    "TensorProto": "dims data_type name raw_data float_data int32_data int64_data double_data uint64_data data_location",
    "ValueInfoProto": "name type",
    "TypeProto": "tensor_type",
    "Tensor": "elem_type shape",
    "TensorShapeProto": "dim",
    "Dimension": "dim_value dim_param",
}
"""Fields by message of onnx.proto"""

DROPPED = "doc_string metadata_props producer_name producer_version model_version domain value_info denotation overload"
"""Fields without an effect on the numbers, where they are not in `KEPT`"""

GRAPH = "an operator in it holds a graph of its own (control flow), which is not run"
REFUSED = {
    "external_data": "its weights lie in another file (external data), which is not read; export one file",
    "functions": "it defines functions of its own; write them out (onnx.inliner.inline_local_functions)",
    "g": GRAPH,
    "graphs": GRAPH,
}
"""Reasons for refused fields"""

OPERATORS = frozenset((
    "Abs", "Acos", "Acosh", "Add", "And", "ArgMax", "ArgMin", "Asin", "Asinh", "Atan", "Atanh",
    "BatchNormalization", "Cast", "CastLike", "Ceil", "Celu", "Clip", "Concat", "Constant",
    "ConstantOfShape", "Cos", "Cosh", "CumSum", "DequantizeLinear", "Div", "Elu", "Equal", "Erf", "Exp",
    "Expand", "Flatten", "Floor", "Gather", "GatherElements", "Gelu", "Gemm", "Greater", "GreaterOrEqual",
    "HardSigmoid", "HardSwish", "Identity", "InstanceNormalization", "IsInf", "IsNaN", "LayerNormalization",
    "LeakyRelu", "Less", "LessOrEqual", "Log", "LogSoftmax", "LpNormalization", "MatMul", "Max", "Mean",
    "Min", "Mish", "Mod", "Mul", "Neg", "Not", "Or", "PRelu", "Pad", "Pow", "QuantizeLinear",
    "RMSNormalization", "Reciprocal", "ReduceL1", "ReduceL2", "ReduceLogSum", "ReduceLogSumExp",
    "ReduceMax", "ReduceMean", "ReduceMin", "ReduceProd", "ReduceSum", "ReduceSumSquare", "Relu", "Reshape",
    "Round", "Selu", "Shape", "Sigmoid", "Sign", "Sin", "Sinh", "Size", "Slice", "Softmax", "Softplus",
    "Softsign", "Split", "Sqrt", "Squeeze", "Sub", "Sum", "Tan", "Tanh", "ThresholdedRelu", "Tile",
    "Transpose", "Unsqueeze", "Where", "Xor",
))  # fmt: skip
"""Operators of the ONNX standard that a policy may use"""

DOMAINS = ("", "ai.onnx")
"""Both name the ONNX standard"""


Lengths = tuple[int | None, ...]
"""of a tensor; None for an open one"""


@dataclass(frozen=True, slots=True)
class Port:
    """An input or output of the graph."""

    name: str
    type: str  # float32, float64, ...
    shape: Lengths | None  # None if the file does not say

    def __str__(self) -> str:
        lengths = "?" if self.shape is None else ", ".join("n" if d is None else str(d) for d in self.shape)
        return f"{short(self.name, 60)!r} ({lengths}) {self.type}"


@dataclass(frozen=True, slots=True)
class OnnxFile:
    """A checked network."""

    model: Any  # onnx.ModelProto with known fields alone
    inputs: tuple[Port, ...]  # without those that the file has numbers for
    outputs: tuple[Port, ...]
    opset: int  # version of the standard operators

    def serialised(self) -> bytes:
        """Return the bytes for a runtime."""
        return bytes(self.model.SerializeToString(deterministic=True))

    def answer(self, *shape: int) -> Lengths:
        """Return the shape of the first output for a shape of the first input.

        Raises:
            ValueError: the shape of a tensor cannot be known in advance, or is too large.
        """
        shapes = _shapes(self.model, self.inputs[0].name, shape)
        total = 0
        for name, found in shapes.items():
            if found is None or None in found:
                raise ValueError(f"the shape of its tensor {short(name, 60)!r} cannot be known in advance")
            total += math.prod(length or 0 for length in found)
            if total > ELEMENTS:
                raise ValueError(
                    f"it computes more than {ELEMENTS:,} numbers at once, the most that is allowed (tensor {short(name, 60)!r})"
                )
        return shapes[self.outputs[0].name] or ()


def require() -> Any:
    """Return the onnx package.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise MissingExtraError("onnx", extra="onnx", purpose="policies as ONNX files") from error
    return onnx


def parse(data: bytes) -> OnnxFile:
    """Return the network of an ONNX file.

    Raises:
        ValueError: it is no ONNX file, is damaged, or holds what is refused; in one line.
        MissingExtraError: the onnx package is not installed.
    """
    onnx = require()
    try:
        model = onnx.load_model_from_string(data)
    except Exception as error:  # the parser's own error class depends on its version
        raise ValueError("it is no ONNX file, or damaged") from error
    if not model.HasField("graph"):
        raise ValueError("it is no ONNX file, or damaged (there is no graph in it)")
    model.DiscardUnknownFields()
    _reduce(model)
    opset = _opset(model)
    if opset > (newest := onnx.defs.onnx_opset_version()):
        raise ValueError(
            f"it uses version {opset} of the operators; onnx {onnx.__version__} knows them up to {newest}"
        )
    for node in model.graph.node:
        if node.domain not in DOMAINS or node.op_type not in OPERATORS:
            name = short(f"{node.domain}:{node.op_type}".removeprefix(":"), 60)
            raise ValueError(
                f"its operator {name} is not one that a policy may use (docs/policies-as-files.md)"
            )
    try:
        onnx.checker.check_model(model)
    except Exception as error:  # it raises of all kinds
        raise ValueError(f"it breaks the ONNX standard: {short(first_line(error), 200)}") from error
    weights = {tensor.name for tensor in model.graph.initializer}
    inputs = tuple(_port(value) for value in model.graph.input if value.name not in weights)
    return OnnxFile(model, inputs, tuple(map(_port, model.graph.output)), opset)


def _reduce(model: Any) -> None:
    """Clear or refuse every field that is not in `KEPT`."""
    waiting, count = [model], 0
    while waiting:
        message = waiting.pop()
        kind = message.DESCRIPTOR.name
        for descriptor, value in message.ListFields():
            name = descriptor.name
            if name not in KEPT[kind].split():
                if name not in DROPPED.split():
                    raise ValueError(REFUSED.get(name, f"it has {kind}.{name}, which a policy does not need"))
                message.ClearField(name)
            elif descriptor.message_type is not None:
                parts = [value] if hasattr(value, "ListFields") else value
                count += len(parts)
                if count > MESSAGES:
                    raise ValueError(f"it has more than {MESSAGES:,} parts, the most that are read")
                waiting += parts
        if kind == "TensorProto" and message.data_location:
            raise ValueError(REFUSED["external_data"])


def _opset(model: Any) -> int:
    versions = [entry.version for entry in model.opset_import if entry.domain in DOMAINS]
    if len(versions) != 1:
        raise ValueError("it is no ONNX file, or damaged (it does not name one version of the operators)")
    model.ClearField("opset_import")
    model.opset_import.add(domain="", version=versions[0])
    return int(versions[0])


def _port(value: Any) -> Port:
    tensor = value.type.tensor_type
    try:
        kind = require().helper.tensor_dtype_to_np_dtype(tensor.elem_type).name
    except KeyError:
        kind = "of no type"
    return Port(value.name, kind, _lengths(tensor.shape) if tensor.HasField("shape") else None)


def _lengths(shape: Any) -> Lengths:
    return tuple(dim.dim_value if dim.dim_value > 0 else None for dim in shape.dim)


def _shapes(model: Any, entry: str, shape: tuple[int, ...]) -> dict[str, Lengths | None]:
    """Return the shape of each tensor that is computed, for a shape of the input."""
    onnx = require()
    asked = onnx.ModelProto()
    asked.CopyFrom(model)
    for value in asked.graph.input:
        if value.name == entry:
            value.type.tensor_type.ClearField("shape")
            for length in shape:
                value.type.tensor_type.shape.dim.add(dim_value=length)
    for value in asked.graph.output:  # what the file says of its answers is not believed
        value.type.tensor_type.ClearField("shape")
    try:
        inferred = onnx.shape_inference.infer_shapes(asked, check_type=True, strict_mode=True, data_prop=True)
    except Exception as error:  # it raises of all kinds
        raise ValueError(f"its shapes do not fit: {short(first_line(error), 200)}") from error
    known = {
        value.name: _lengths(value.type.tensor_type.shape)
        for value in (*inferred.graph.value_info, *inferred.graph.output)
        if value.type.tensor_type.HasField("shape")
    }
    computed = [name for node in model.graph.node for name in node.output if name]
    return {name: known.get(name) for name in (*computed, model.graph.output[0].name)}
