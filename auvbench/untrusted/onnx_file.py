"""An ONNX file from anybody, looked at before a runtime gets it: what goes in and out, and that it is only a network.

The file is a Protocol Buffers message (onnx.proto of https://github.com/onnx/onnx). Its wire format is walked here as
it lies in the file, with no more than the standard library: nothing is built from it, and nothing that it names is opened.
Refused is what a policy does not need and a stranger could use:

* tensors whose numbers lie in other files (`external_data`): a path in the file would be read;
* operators that are not of the ONNX standard, functions of the file's own, and training information;
* control flow (If, Loop, Scan, SequenceMap): a file of some bytes could compute for ever;
* random numbers: a policy in a test is deterministic.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from auvbench.untrusted.text import short

LARGEST = 256 * 1024**2
"""bytes of the longest file that is read; the networks of this benchmark have some hundred thousand"""
NODES = 100_000
"""operators in a graph"""
DIMENSIONS = 32
"""of an input or output"""

STANDARD = ("", "ai.onnx", "ai.onnx.ml")
"""domains of the operators that ONNX itself defines"""

CONTROL_FLOW = ("If", "Loop", "Scan", "SequenceMap")
RANDOM = (
    "Bernoulli",
    "Multinomial",
    "RandomNormal",
    "RandomNormalLike",
    "RandomUniform",
    "RandomUniformLike",
)

FLOAT, DOUBLE = 1, 11
"""element types, as TensorProto.DataType numbers them"""
TYPES = {
    1: "float32", 2: "uint8", 3: "int8", 4: "uint16", 5: "int16", 6: "int32", 7: "int64", 8: "string", 9: "bool",
    10: "float16", 11: "float64", 12: "uint32", 13: "uint64", 14: "complex64", 15: "complex128", 16: "bfloat16",
}  # fmt: skip

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


@dataclass(frozen=True, slots=True)
class Port:
    """An input or output of the graph."""

    name: str
    type: str
    """float32, float64, ...; a name that says what it is where it is no tensor"""
    shape: tuple[int | None, ...] | None
    """None for a length that is open; None altogether where the file does not say"""

    def __str__(self) -> str:
        lengths = "?" if self.shape is None else ", ".join("n" if d is None else str(d) for d in self.shape)
        return f"{short(self.name, 60)!r} ({lengths}) {self.type}"


@dataclass(slots=True)
class OnnxFile:
    """What an ONNX file says of itself."""

    inputs: list[Port] = field(default_factory=list)
    """what has to be given: without those that the file has numbers for"""
    outputs: list[Port] = field(default_factory=list)
    opset: int | None = None
    """version of the standard operators"""
    nodes: int = 0
    graphs: int = 0
    initializers: set[str] = field(default_factory=set)


def inspect(data: bytes) -> OnnxFile:
    """Looks at the whole of an ONNX file.

    Raises:
        ValueError: it is none, is damaged, or holds what is refused; in one line.
    """
    found = OnnxFile()
    try:
        _model(memoryview(data), found)
    except _DamagedError as error:
        raise ValueError(f"it is no ONNX file, or damaged ({error})") from None
    if not found.graphs:
        raise ValueError("it is no ONNX file, or damaged (there is no graph in it)")
    if found.opset is None:
        raise ValueError(
            "it is no ONNX file, or damaged (it does not say which version of the operators it uses)"
        )
    found.inputs = [port for port in found.inputs if port.name not in found.initializers]
    return found


class _DamagedError(Exception):
    """The bytes are not those of a message."""


_Value = int | memoryview


def _fields(message: memoryview) -> Iterator[tuple[int, _Value]]:
    """Number and value of each field of a message: a whole number, or the bytes of what has a length."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, wire = key >> 3, key & 7
        if number == 0:
            raise _DamagedError("a field without a number")
        if wire == _VARINT:
            value, at = _varint(message, at)
            yield number, value
            continue
        if wire == _BYTES:
            length, at = _varint(message, at)
        elif wire in (_FIXED64, _FIXED32):
            length = 8 if wire == _FIXED64 else 4
        else:
            raise _DamagedError(f"a field of the kind {wire}")
        if length > len(message) - at:
            raise _DamagedError("it ends in the midst of a field")
        yield number, message[at : at + length]
        at += length


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """A number of seven bits per byte, and where the next begins."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise _DamagedError("it ends in the midst of a number")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFFFFFFFFFFFFFF, at
    raise _DamagedError("a number of more than ten bytes")


def _message(value: _Value) -> memoryview:
    if isinstance(value, int):
        raise _DamagedError("a number where a message is expected")
    return value


def _text(value: _Value) -> str:
    try:
        return bytes(_message(value)).decode("utf-8")
    except UnicodeDecodeError:
        raise _DamagedError("a name that is no text") from None


def _number(value: _Value) -> int:
    if not isinstance(value, int):
        raise _DamagedError("bytes where a number is expected")
    return value


# The numbers are those of the fields in onnx.proto.


def _model(message: memoryview, found: OnnxFile) -> None:
    for number, value in _fields(message):
        if number == 7:
            found.graphs += 1
            _graph(_message(value), found)
        elif number == 8:
            _operators(_message(value), found)
        elif number == 20:
            raise ValueError("it holds training information; export the network alone")
        elif number == 25:
            raise ValueError(
                "it defines functions of its own; write them out as operators (onnx.inliner.inline_local_functions)"
            )


def _operators(message: memoryview, found: OnnxFile) -> None:
    domain, version = "", 0
    for number, value in _fields(message):
        if number == 1:
            domain = _text(value)
        elif number == 2:
            version = _number(value)
    if domain in ("", "ai.onnx"):
        found.opset = version


def _graph(message: memoryview, found: OnnxFile) -> None:
    for number, value in _fields(message):
        if number == 1:
            found.nodes += 1
            if found.nodes > NODES:
                raise ValueError(f"it has more than {NODES:,} operators, the most that are read")
            _node(_message(value))
        elif number == 5:
            found.initializers.add(_tensor(_message(value)))
        elif number == 11:
            found.inputs.append(_port(_message(value)))
        elif number == 12:
            found.outputs.append(_port(_message(value)))
        elif number == 15:
            _sparse(_message(value))


def _node(message: memoryview) -> None:
    kind = domain = ""
    for number, value in _fields(message):
        if number == 4:
            kind = _text(value)
        elif number == 7:
            domain = _text(value)
        elif number == 5:
            _attribute(_message(value))
    if domain not in STANDARD:
        raise ValueError(
            f"its operator {short(domain, 60)}:{short(kind, 60)} is not one of the ONNX standard; only those are run"
        )
    if kind in CONTROL_FLOW:
        raise ValueError(f"its operator {kind} is control flow; a policy is read without")
    if kind in RANDOM:
        raise ValueError(f"its operator {kind} draws random numbers; export the deterministic action")


def _attribute(message: memoryview) -> None:
    for number, value in _fields(message):
        if number in (5, 10):
            _tensor(_message(value))
        elif number in (22, 23):
            _sparse(_message(value))
        elif number in (6, 11):
            raise ValueError(
                "an operator in it holds a graph of its own (control flow); a policy is read without"
            )


def _tensor(message: memoryview) -> str:
    """The tensor's name."""
    name = ""
    for number, value in _fields(message):
        if number == 8:
            name = _text(value)
        elif number == 13 or (number == 14 and _number(value) == 1):
            raise ValueError(
                "its weights lie in another file (external data), which is not read; save it as one file "
                "(onnx.save with save_as_external_data=False, torch.onnx.export with external_data=False)"
            )
    return name


def _sparse(message: memoryview) -> None:
    for number, value in _fields(message):
        if number in (1, 2):
            _tensor(_message(value))


def _port(message: memoryview) -> Port:
    name, kind, shape = "", "of no type", None
    for number, value in _fields(message):
        if number == 1:
            name = _text(value)
        elif number == 2:
            kind, shape = _type(_message(value))
    return Port(name, kind, shape)


def _type(message: memoryview) -> tuple[str, tuple[int | None, ...] | None]:
    kind: str = "no tensor"
    shape: tuple[int | None, ...] | None = None
    for number, value in _fields(message):
        if number == 1:
            for part, content in _fields(_message(value)):
                if part == 1:
                    kind = TYPES.get(_number(content), f"type {_number(content)}")
                elif part == 2:
                    shape = tuple(
                        _dimension(_message(dim)) for tag, dim in _fields(_message(content)) if tag == 1
                    )
                    if len(shape) > DIMENSIONS:
                        raise _DamagedError("an input or output of too many dimensions")
    return kind, shape


def _dimension(message: memoryview) -> int | None:
    """A length; None where it has a name or nothing."""
    length = None
    for number, value in _fields(message):
        if number == 1:
            length = _number(value)
    return length if length is not None and 0 < length < 1 << 63 else None
