"""ONNX files that attack: each is one line within seconds, and no other file is opened."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
from onnx import TensorProto, helper

from auvbench.policies import exported
from auvbench.policies.exported import PolicyError
from auvbench.untrusted import onnx_file
from tests import hostile_onnx as hostile
from tests.onnx_files import model, port

SEEN = np.random.default_rng(1).normal(size=(5, 10)).astype(np.float32)


def policy(made: Any) -> exported.Policy:
    data = made if isinstance(made, bytes) else made.SerializeToString()
    return exported.Policy(data, "theirs.onnx", observations=10, actions=6)


def branch() -> Any:
    graphs = [
        helper.make_graph([helper.make_node("Identity", ["h"], [name])], name, [], [port(name, "n", 6)])
        for name in ("yes", "no")
    ]
    return hostile.linear(
        helper.make_node("ReduceMax", ["h"], ["most"], keepdims=0),
        helper.make_node("Cast", ["most"], ["c"], to=TensorProto.BOOL),
        helper.make_node("If", ["c"], ["a"], then_branch=graphs[0], else_branch=graphs[1]),
    )


def plain_loop() -> Any:
    made = hostile.linear(hostile.loop())
    made.graph.initializer.append(hostile.turns())
    return made


def with_sparse_weights() -> Any:
    made = model()
    sparse = made.graph.sparse_initializer.add()
    sparse.values.CopyFrom(made.graph.initializer[0])
    return made


ATTACKS: dict[str, Callable[[], Any]] = {
    "hidden loop": hostile.hidden_loop,
    "hidden operator of another domain": hostile.hidden_foreign,
    "hidden external data": lambda: hostile.external("weights.bin", high=True),
    "external data": lambda: hostile.external("weights.bin", high=False),
    "loop": plain_loop,
    "if": branch,
    "dropout": lambda: hostile.linear(helper.make_node("Dropout", ["h"], ["a"])),
    "operator of another domain": lambda: hostile.linear(
        helper.make_node("Gelu", ["h"], ["a"], domain="com.microsoft")
    ),
    "sparse weights": with_sparse_weights,
    "huge input": lambda: model(inputs=[port("x", 2**40, 10)]),
    "huge observation": lambda: model(inputs=[port("x", "n", 2**62)]),
    "huge weights": lambda: hostile.large_weights(2**31, 2**31),
    "huge weights with some numbers": lambda: hostile.large_weights(2**31, 2**31, keep=True),
    "weights whose number overflows": lambda: hostile.large_weights(2**32 * 10, 2**32 * 6, keep=True),
    "too few weights": lambda: hostile.large_weights(10, 7, keep=True),
    "weights of negative length": lambda: hostile.large_weights(-1, 6),
    "huge constant": lambda: hostile.large_constant(2**40),
    "huge ConstantOfShape": lambda: hostile.sized("ConstantOfShape", [2**20, 2**20]),
    "huge Expand": lambda: hostile.sized("Expand", [2**31, 2**31], "one"),
    "huge Tile": lambda: hostile.sized("Tile", [2**40, 6], "h"),
    "negative lengths": lambda: hostile.sized("ConstantOfShape", [-1, 6]),
    "outer sum": hostile.outer,
    "many large tensors": hostile.many,
    "a shape from data": hostile.from_data,
    "many parts": lambda: hostile.empty_parts(onnx_file.MESSAGES + 1),
    "nested": lambda: hostile.nested(2_000),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_is_one_line_and_opens_nothing(
    attack: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    hostile.write_weights(tmp_path / "weights.bin")
    data = ATTACKS[attack]()
    with pytest.raises(PolicyError) as caught:
        policy(data).act(SEEN)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400
    assert capfd.readouterr() == ("", "")


def test_the_runtime_gets_known_fields_alone() -> None:
    data = hostile.with_unknown_fields()
    assert data.count(b"UNKNOWN") == 4
    theirs, ours = policy(data), policy(model())
    assert b"UNKNOWN" not in theirs.file.serialised()
    np.testing.assert_array_equal(theirs.act(SEEN), ours.act(SEEN))


def test_what_has_no_effect_is_left_out() -> None:
    made = model()
    made.producer_name = made.doc_string = made.graph.node[0].doc_string = "NOTE"
    made.metadata_props.add(key="ort_config", value="NOTE")
    made.graph.value_info.append(port("h", 77, 77))  # a lie
    assert b"NOTE" not in policy(made).file.serialised()


def test_a_file_that_takes_too_many_observations_at_once_is_refused() -> None:
    fixed = model(inputs=[port("x", 1000, 10)], outputs=[port("a", 1000, 6)])
    assert policy(fixed).act(SEEN).shape == (5, 6)
    with pytest.raises(PolicyError, match="at most 1000"):
        policy(model(inputs=[port("x", 1001, 10)]))
