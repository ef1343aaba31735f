"""A trained policy as an ONNX graph: observations scaled and clipped, the network, actions clipped.

The network is taken as PyTorch computes it: `torch.export` records its deterministic action as a list of elementary
operations, and each of them has one line here. So any policy whose action is a function of the observation alone is
written, whatever algorithm trained it; an operation without a line is refused by name. Scaling is done in float64
as the policy itself does it, so that the network gets the same bits.

The same policy gives the same bytes: names come from the policy's own parameters, and the message is serialised in a
fixed order.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy

from auvbench.errors import MissingExtraError, RunError
from auvbench.untrusted.text import first_line

OPSET = 18
IR_VERSION = 9
"""of 2023: runtimes since ONNX Runtime 1.15 read both"""

INPUT, OUTPUT = "observation", "action"

Floats = NDArray[np.float64]


def require() -> Any:
    """The onnx package.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise MissingExtraError("onnx", extra="onnx", purpose="exported policies") from error
    return onnx


def build(
    policy: BasePolicy,
    n_observations: int,
    scaling: tuple[Floats, Floats, float] | None,
    about: Mapping[str, str],
) -> bytes:
    """The ONNX file of a policy.

    Args:
        policy: out of training mode; its action is `policy._predict(observation, deterministic=True)`.
        n_observations: length of an observation.
        scaling: mean (n,) and scale (n,) by which observations are normalised, and the clip; None where they are not.
        about: readable entries for the file's metadata.

    Raises:
        RunError: the policy keeps a state, or uses an operation that is not translated.
        MissingExtraError: the onnx package is not installed.
    """
    onnx = require()
    helper, kinds = onnx.helper, onnx.TensorProto
    graph = Graph(onnx)
    value = INPUT
    if scaling is not None:
        mean, scale, clip = scaling
        value = graph.node("Cast", value, to=kinds.DOUBLE)
        value = graph.node("Sub", value, graph.constant("observation_mean", mean))
        value = graph.node("Div", value, graph.constant("observation_scale", scale))
        low, high = (
            graph.constant(f"observation_{n}", np.float64(v)) for n, v in (("low", -clip), ("high", clip))
        )
        value = graph.node("Clip", value, low, high)
        value = graph.node("Cast", value, to=kinds.FLOAT)
    program = _recorded(policy, n_observations)
    value = _translate(program, graph, value)
    low, high = (graph.constant(f"action_{n}", np.float32(v)) for n, v in (("low", -1.0), ("high", 1.0)))
    graph.node("Clip", value, low, high, output=OUTPUT)
    n_actions = int(np.prod(policy.action_space.shape or ()))
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "policy",
            [helper.make_tensor_value_info(INPUT, kinds.FLOAT, ["n", n_observations])],
            [helper.make_tensor_value_info(OUTPUT, kinds.FLOAT, ["n", n_actions])],
            graph.tensors,
        ),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="auvbench",
    )
    for key, text in about.items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, text
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


@dataclass
class Graph:
    """Nodes and constants as they are added."""

    onnx: Any
    nodes: list[Any] = field(default_factory=list)
    tensors: list[Any] = field(default_factory=list)
    _named: set[str] = field(default_factory=set)

    def node(self, kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Adds an operator; returns the name of its result."""
        output = output or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def constant(self, name: str, value: NDArray[Any] | np.floating[Any] | np.integer[Any]) -> str:
        """Adds numbers under a name; returns it."""
        if name not in self._named:
            self._named.add(name)
            array = np.asarray(value)
            self.tensors.append(self.onnx.numpy_helper.from_array(np.array(array, order="C"), name))
        return name


class _Action(torch.nn.Module):
    def __init__(self, policy: BasePolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return self.policy._predict(observation, deterministic=True)


def _recorded(policy: BasePolicy, n_observations: int) -> torch.export.ExportedProgram:
    """The policy's action as a list of elementary operations, for any number of rows."""
    distribution = torch.distributions.Distribution
    checked = distribution._validate_args
    # The bounds of a normal distribution are looked at in Python, which cannot be recorded.
    distribution.set_default_validate_args(False)
    try:
        return torch.export.export(
            _Action(policy),
            (torch.zeros(3, n_observations),),
            dynamic_shapes=({0: torch.export.Dim("n")},),
        )
    except TypeError as error:
        raise RunError(
            f"a {type(policy).__name__} keeps a state between observations, and is not written as a file: {error}"
        ) from error
    except Exception as error:  # whatever PyTorch finds that cannot be recorded
        raise RunError(
            f"a {type(policy).__name__} cannot be written as a file: {first_line(error)}"
        ) from error
    finally:
        distribution.set_default_validate_args(checked)


def _translate(program: torch.export.ExportedProgram, graph: Graph, observation: str) -> str:
    """Adds what leads from the observation to the action; returns the action's name."""
    fixed = _fixed(program)
    written: dict[Any, str] = {}

    def name_of(node: Any) -> str:
        return written[node]

    nodes = list(program.graph.nodes)
    for node in _needed(nodes):
        if node.op == "placeholder":
            written[node] = graph.constant(*fixed[node.name]) if node.name in fixed else observation
        elif node.op == "call_function":
            written[node] = _operation(node, graph, name_of)
    (result,) = next(node for node in nodes if node.op == "output").args[0]
    return written[result]


def _fixed(program: torch.export.ExportedProgram) -> dict[str, tuple[str, NDArray[Any]]]:
    """Of each placeholder that stands for weights: their name, and the numbers."""
    signature = program.graph_signature
    found = {}
    for placeholder, name in {**signature.inputs_to_parameters, **signature.inputs_to_buffers}.items():
        tensor = program.state_dict[name] if name in program.state_dict else program.constants[name]
        found[placeholder] = (name.removeprefix("policy."), tensor.detach().numpy())
    for placeholder, name in signature.inputs_to_lifted_tensor_constants.items():
        found[placeholder] = (name, program.constants[name].detach().numpy())
    return found


def _needed(nodes: list[Any]) -> list[Any]:
    """Those on which the output depends, in order: critics, and the spread of an action, are no part of it."""
    wanted = {node for node in nodes if node.op == "output"}
    for node in reversed(nodes):
        if node in wanted:
            taken = _taken(node)
            wanted.update(node.all_input_nodes if taken is None else [taken])
    return [node for node in nodes if node in wanted and node.op != "output"]


def _taken(node: Any) -> Any | None:
    """The tensor that `broadcast_tensors(a, b, ...)[i]` is, where nothing of it is repeated; None for all else."""
    if node.target is not operator.getitem:
        return None
    source, index = node.args
    if source.target is not torch.ops.aten.broadcast_tensors.default:
        return None
    tensor = source.args[0][index]
    return tensor if _shape(tensor) == _shape(node) else None


def _shape(node: Any) -> tuple[str, ...]:
    return tuple(str(length) for length in node.meta["val"].shape)


def _operation(node: Any, graph: Graph, name_of: Callable[[Any], str]) -> str:
    target = node.target
    if (taken := _taken(node)) is not None:
        return name_of(taken)
    kind = str(target).removeprefix("aten.").partition(".")[0]

    def operand(value: Any) -> str:
        """Of a tensor, its name; of a number, that of a constant."""
        if isinstance(value, torch.fx.Node):
            return name_of(value)
        return graph.constant(f"number_{float(value)!r}", np.float32(value))

    arguments = [*node.args]
    if kind in _UNARY:
        return graph.node(_UNARY[kind], operand(arguments[0]))
    if kind in _BINARY and node.kwargs.get("alpha", 1) == 1:
        return graph.node(_BINARY[kind], *(operand(value) for value in arguments[:2]))
    if kind in _SAME and _shape(node) == _shape(arguments[0]) and _type(node) == _type(arguments[0]):
        return name_of(arguments[0])
    if kind in _SPECIAL:
        return _SPECIAL[kind](graph, operand, arguments, dict(node.kwargs))
    raise RunError(f"the policy uses the operation {target}, which is not written to ONNX files")


def _type(node: Any) -> torch.dtype:
    dtype: torch.dtype = node.meta["val"].dtype
    return dtype


Operand = Callable[[Any], str]

_UNARY = {
    "relu": "Relu", "tanh": "Tanh", "sigmoid": "Sigmoid", "exp": "Exp", "log": "Log", "sqrt": "Sqrt", "neg": "Neg",
    "abs": "Abs", "erf": "Erf", "sin": "Sin", "cos": "Cos", "reciprocal": "Reciprocal", "softsign": "Softsign",
}  # fmt: skip
_BINARY = {
    "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "pow": "Pow", "maximum": "Max", "minimum": "Min",
    "matmul": "MatMul", "mm": "MatMul",
}  # fmt: skip
_SAME = (
    "flatten", "view", "reshape", "alias", "clone", "detach", "detach_", "contiguous", "to", "_to_copy", "expand",
    "dropout", "lift_fresh_copy",
)  # fmt: skip
"""operations that change nothing where shape and type stay"""


def _linear(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    return graph.node("Gemm", *(operand(value) for value in arguments if value is not None), transB=1)


def _addmm(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    bias, left, right = arguments[:3]
    return graph.node("Gemm", operand(left), operand(right), operand(bias))


def _clamp(graph: Graph, operand: Operand, arguments: list[Any], given: dict[str, Any]) -> str:
    bounds = {"min": None, "max": None} | dict(zip(("min", "max"), arguments[1:], strict=False)) | given
    names = ["" if bounds[key] is None else operand(bounds[key]) for key in ("min", "max")]
    return graph.node("Clip", operand(arguments[0]), *names)


def _elu(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    return graph.node("Elu", operand(arguments[0]), alpha=float(arguments[1]) if len(arguments) > 1 else 1.0)


def _leaky_relu(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    return graph.node(
        "LeakyRelu", operand(arguments[0]), alpha=float(arguments[1]) if len(arguments) > 1 else 0.01
    )


def _silu(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    value = operand(arguments[0])
    return graph.node("Mul", value, graph.node("Sigmoid", value))


def _softplus(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    return graph.node("Softplus", operand(arguments[0]))


def _unsqueeze(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    axis = int(arguments[1])
    return graph.node("Unsqueeze", operand(arguments[0]), graph.constant(f"axis_{axis}", np.array([axis])))


def _transposed(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    return graph.node("Transpose", operand(arguments[0]), perm=[1, 0])


def _concatenated(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    axis = int(arguments[1]) if len(arguments) > 1 else 0
    return graph.node("Concat", *(operand(value) for value in arguments[0]), axis=axis)


def _layer_norm(graph: Graph, operand: Operand, arguments: list[Any], _: dict[str, Any]) -> str:
    value, shape, weight, *rest = arguments
    names = [operand(v) for v in (value, weight, *rest[:1]) if v is not None]
    epsilon = float(rest[1]) if len(rest) > 1 else 1e-5
    return graph.node("LayerNormalization", *names, axis=-len(shape), epsilon=epsilon)


_SPECIAL: dict[str, Callable[[Graph, Operand, list[Any], dict[str, Any]], str]] = {
    "linear": _linear,
    "addmm": _addmm,
    "clamp": _clamp,
    "elu": _elu,
    "leaky_relu": _leaky_relu,
    "silu": _silu,
    "softplus": _softplus,
    "unsqueeze": _unsqueeze,
    "t": _transposed,
    "cat": _concatenated,
    "layer_norm": _layer_norm,
}
