"""ONNX files that attack: each is one line within seconds, and no other file is opened; the rest is a policy."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
from onnx import TensorProto, helper, numpy_helper

from auvbench.policies import exported
from auvbench.policies.exported import PolicyError
from tests import hostile_onnx as hostile
from tests.onnx_files import model, port, weights

SEEN = np.random.default_rng(1).normal(size=(5, 10)).astype(np.float32)


def policy(made: Any, **options: Any) -> exported.Policy:
    data = made if isinstance(made, bytes) else made.SerializeToString()
    return exported.Policy(data, "theirs.onnx", observations=10, actions=6, **options)


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


def with_functions() -> Any:
    made = model([helper.make_node("F", ["x"], ["a"], domain="own")])
    made.opset_import.append(helper.make_opsetid("own", 1))
    body = [
        helper.make_node("Constant", [], ["W"], value=numpy_helper.from_array(weights(), "W")),
        helper.make_node("MatMul", ["p", "W"], ["q"]),
    ]
    made.functions.append(helper.make_function("own", "F", ["p"], ["q"], body, [helper.make_opsetid("", 17)]))
    return made


def with_sparse_weights() -> Any:
    made = model()
    sparse = made.graph.sparse_initializer.add()
    sparse.values.CopyFrom(made.graph.initializer[0])
    return made


ATTACKS: dict[str, Callable[[], Any]] = {
    "hidden external data": lambda: hostile.external("weights.bin", high=True),
    "external data": lambda: hostile.external("weights.bin", high=False),
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
    "many parts": lambda: hostile.empty_parts(100_001),
    "nested": lambda: hostile.nested(2_000),
    **{
        f"{kind} of the least {np.dtype(dtype)} by -1{' while it is loaded' * folded}": partial(
            hostile.least_over_minus_one, kind, dtype, folded=folded
        )
        for kind in ("Div", "Mod")
        for dtype in (np.int32, np.int64)
        for folded in (False, True)
    },
}

HARMLESS: dict[str, Callable[[], Any]] = {
    "if": branch,
    "dropout": lambda: hostile.linear(helper.make_node("Dropout", ["h"], ["a"])),
    "hidden operator of another domain": hostile.hidden_foreign,
    "a shape from data": hostile.from_data,
    "functions": with_functions,
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


@pytest.mark.parametrize("made", HARMLESS)
def test_operators_of_all_kinds_answer_in_their_own_process(made: str) -> None:
    assert policy(HARMLESS[made]()).act(SEEN).shape == (5, 6)


@pytest.mark.slow
@pytest.mark.parametrize("made", [hostile.hidden_loop, plain_loop])
def test_a_policy_that_never_answers_is_given_up(made: Callable[[], Any]) -> None:
    with pytest.raises(PolicyError, match="takes longer than 1 s"):
        policy(made(), seconds=1)


def test_unknown_fields_change_nothing() -> None:
    data = hostile.with_unknown_fields()
    assert data.count(b"UNKNOWN") == 4
    np.testing.assert_array_equal(policy(data).act(SEEN), policy(model()).act(SEEN))


def test_a_policy_whose_process_is_killed_is_one_line_and_the_next_one_answers() -> None:
    theirs = policy(model())
    os.kill(theirs._child.pid, signal.SIGKILL)
    for _ in range(2):
        with pytest.raises(PolicyError, match=r"theirs\.onnx: cannot be computed: .*died \(SIGKILL\)"):
            theirs.act(SEEN)
    assert policy(model()).act(SEEN).shape == (5, 6)


def test_a_file_that_takes_too_many_observations_at_once_is_refused() -> None:
    fixed = model(inputs=[port("x", 1000, 10)], outputs=[port("a", 1000, 6)])
    assert policy(fixed).act(SEEN).shape == (5, 6)
    with pytest.raises(PolicyError, match="at most 1000"):
        policy(model(inputs=[port("x", 1001, 10)]))
