"""ONNX files made by hand: what anybody's framework writes, and what nobody should."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

N_IN, N_OUT = 10, 6


def weights(n_in: int = N_IN, n_out: int = N_OUT, gain: float = 0.05, seed: int = 0) -> np.ndarray[Any, Any]:
    return (np.random.default_rng(seed).normal(size=(n_in, n_out)) * gain).astype(np.float32)


def port(name: str, *shape: int | str, kind: int = TensorProto.FLOAT) -> Any:
    return helper.make_tensor_value_info(name, kind, list(shape))


def model(
    nodes: list[Any] | None = None,
    inputs: list[Any] | None = None,
    outputs: list[Any] | None = None,
    *,
    gain: float = 0.05,
    seed: int = 0,
    n_in: int = N_IN,
    n_out: int = N_OUT,
    opset: int = 17,
) -> Any:
    """tanh(x W) unless other nodes are given."""
    W = numpy_helper.from_array(weights(n_in, n_out, gain, seed), "W")
    usual = [helper.make_node("MatMul", ["x", "W"], ["h"]), helper.make_node("Tanh", ["h"], ["a"])]
    graph = helper.make_graph(
        nodes or usual,
        "by hand",
        inputs or [port("x", "n", n_in)],
        outputs or [port("a", "n", n_out)],
        [W],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)


def ending(kind: str, **options: Any) -> Any:
    """x W with another operator at its end."""
    nodes = [helper.make_node("MatMul", ["x", "W"], ["h"]), helper.make_node(kind, ["h"], ["a"])]
    return model(nodes, **options)


def saved(path: Path, made: Any) -> Path:
    path.write_bytes(made.SerializeToString())
    return path


def with_external_data(path: Path) -> Path:
    made = model()
    onnx.save(made, path, save_as_external_data=True, location="weights.bin", size_threshold=0)
    return path
