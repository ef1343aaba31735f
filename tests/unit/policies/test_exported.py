"""A policy as a file: what anybody's ONNX file answers, and the one line that a damaged or hostile one gets."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("onnx")
from onnx import TensorProto, helper

from auvbench.policies import exported
from auvbench.policies.exported import PolicyError
from tests import onnx_files
from tests.onnx_files import model, port, saved

SEEN = np.random.default_rng(1).normal(size=(200, 10)).astype(np.float32)


def load(path: Path, **sizes: Any) -> exported.Policy:
    return exported.load(path, **({"observations": 10, "actions": 6} | sizes))


def test_a_file_of_another_framework_answers(tmp_path: Path) -> None:
    policy = load(saved(tmp_path / "mine.onnx", model()))
    expected = np.tanh(SEEN @ onnx_files.weights())
    np.testing.assert_allclose(policy.act(SEEN), expected, atol=1e-6)
    assert policy.act(SEEN[:0]).shape == (0, 6)


@pytest.mark.parametrize("rows", [1, 7, 64])
def test_an_answer_does_not_depend_on_its_company(tmp_path: Path, rows: int) -> None:
    policy = load(saved(tmp_path / "mine.onnx", model()), rows=rows)
    together = policy.act(SEEN)
    np.testing.assert_array_equal(together, np.concatenate([policy.act(row[None]) for row in SEEN]))
    np.testing.assert_array_equal(together[::-1], policy.act(SEEN[::-1]))


def test_a_file_for_one_observation_at_a_time_is_asked_so(tmp_path: Path) -> None:
    fixed = model(inputs=[port("x", 1, 10)], outputs=[port("a", 1, 6)])
    open_ = load(saved(tmp_path / "open.onnx", model()))
    np.testing.assert_allclose(
        load(saved(tmp_path / "one.onnx", fixed)).act(SEEN), open_.act(SEEN), atol=1e-6
    )


def test_double_precision_is_asked_in_its_own(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("Cast", ["x"], ["f"], to=TensorProto.FLOAT),
        helper.make_node("MatMul", ["f", "W"], ["h"]),
        helper.make_node("Tanh", ["h"], ["a"]),
    ]
    made = model(nodes, inputs=[port("x", "n", 10, kind=TensorProto.DOUBLE)])
    np.testing.assert_allclose(
        load(saved(tmp_path / "d.onnx", made)).act(SEEN), np.tanh(SEEN @ onnx_files.weights()), atol=1e-6
    )


def whole_numbers() -> Any:
    nodes = [
        helper.make_node("Cast", ["x"], ["f"], to=TensorProto.FLOAT),
        helper.make_node("MatMul", ["f", "W"], ["a"]),
    ]
    return model(nodes, inputs=[port("x", "n", 10, kind=TensorProto.INT64)])


def two_inputs() -> Any:
    nodes = [
        helper.make_node("Add", ["x", "y"], ["s"]),
        helper.make_node("MatMul", ["s", "W"], ["h"]),
        helper.make_node("Tanh", ["h"], ["a"]),
    ]
    return model(nodes, inputs=[port("x", "n", 10), port("y", "n", 10)])


def two_outputs() -> Any:
    nodes = [
        helper.make_node("MatMul", ["x", "W"], ["h"]),
        helper.make_node("Tanh", ["h"], ["a"]),
        helper.make_node("Abs", ["h"], ["value"]),
    ]
    return model(nodes, outputs=[port("a", "n", 6), port("value", "n", 6)])


def custom() -> Any:
    made = model(
        [
            helper.make_node("MatMul", ["x", "W"], ["h"]),
            helper.make_node("Evil", ["h"], ["a"], domain="com.evil"),
        ]
    )
    made.opset_import.append(helper.make_opsetid("com.evil", 1))
    return made


REFUSED = [
    (lambda: model(n_in=12), r"its input 'x' \(n, 12\) float32 must be \(n, 10\) for this vehicle"),
    (lambda: model(n_out=8), r"its output 'a' \(n, 8\) float32 must be \(n, 6\)"),
    (lambda: model(inputs=[port("x", 10)]), r"must have two dimensions, \(n, 10\)"),
    (lambda: model(inputs=[port("x", 5000, 10)]), "at most 1000"),
    (whole_numbers, "'x' .* int64 must be float32 or float64"),
    (two_inputs, r"has 2 inputs \('x' .*'y' .*\); a policy must have one, the observation"),
    (two_outputs, r"has 2 outputs .*; a policy must have one, the action"),
    (custom, "com.evil:Evil"),
    (lambda: onnx_files.ending("RandomNormalLike"), "answers the same observations differently"),
    (lambda: onnx_files.ending("NoSuchOperator"), "NoSuchOperator"),
    (lambda: model(opset=9999), "not an ONNX file that ONNX Runtime can load"),
    (lambda: onnx_files.ending("ReduceSum"), r"answers 64 observations with an array of shape \(1, 1\)"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED)
def test_what_is_refused_is_named_in_one_line(tmp_path: Path, make: Any, message: str) -> None:
    path = saved(tmp_path / "theirs.onnx", make())
    with pytest.raises(PolicyError, match=message) as caught:
        load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_weights_in_other_files_are_never_opened(tmp_path: Path) -> None:
    path = onnx_files.with_external_data(tmp_path / "theirs.onnx")
    (tmp_path / "weights.bin").unlink()
    with pytest.raises(PolicyError, match="another file, which auvbench does not read"):
        load(path)


def test_external_data_of_an_attribute_is_found_too(tmp_path: Path) -> None:
    tensor = TensorProto(name="t", data_type=1, dims=[6], data_location=TensorProto.EXTERNAL)
    tensor.external_data.add(key="location", value="/etc/passwd")
    nodes = [
        helper.make_node("Constant", [], ["c"], value=tensor),
        helper.make_node("MatMul", ["x", "W"], ["h"]),
        helper.make_node("Add", ["h", "c"], ["a"]),
    ]
    with pytest.raises(PolicyError, match="another file, which auvbench does not read"):
        load(saved(tmp_path / "theirs.onnx", model(nodes)))


@pytest.mark.parametrize(
    "data",
    [b"", b"\x00", b"not an onnx file at all", b"\x08\x08", b"\xff" * 100, b"PK\x03\x04" + b"\x00" * 60],
)
def test_what_is_no_onnx_file_says_so(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.onnx").write_bytes(data)
    with pytest.raises(PolicyError, match="not an ONNX file that ONNX Runtime can load"):
        load(tmp_path / "x.onnx")


def test_every_cut_and_many_flipped_bits_are_one_line_or_a_policy(
    capfd: pytest.CaptureFixture[str],
) -> None:
    whole = model().SerializeToString()
    rng = np.random.default_rng(0)
    harmed = [whole[:length] for length in range(0, len(whole), 29)]
    cuts = len(harmed)
    for _ in range(40):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        harmed.append(bytes(data))
    refused = []
    for data in harmed:
        try:
            load_bytes(data).act(SEEN[:2])
        except PolicyError as error:
            refused.append(str(error))
    assert len(refused) >= cuts
    assert not any("\n" in message for message in refused)
    assert capfd.readouterr() == ("", "")


def load_bytes(data: bytes) -> exported.Policy:
    return exported.Policy(data, "harmed.onnx", observations=10, actions=6)


def test_a_missing_file_a_pipe_and_an_endless_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    with pytest.raises(PolicyError, match="no such file"):
        load(tmp_path / "none.onnx")
    with pytest.raises(PolicyError, match="is a folder; name the ONNX file"):
        load(tmp_path)
    with pytest.raises(PolicyError, match="is a card; name the ONNX file"):
        load(tmp_path / "mine.json")
    os.mkfifo(tmp_path / "pipe.onnx")
    with pytest.raises(PolicyError, match="a pipe"):
        load(tmp_path / "pipe.onnx")
    monkeypatch.setattr(exported, "LARGEST", 100)
    with pytest.raises(PolicyError, match="more than 100 bytes"):
        load(saved(tmp_path / "long.onnx", model()))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: onnx_files.ending("Sqrt"), r"answers nan \(action \d\) to the observation"),
        (lambda: onnx_files.ending("Identity", gain=5.0), r"answers .* \(action \d\) to the observation"),
    ],
)
def test_an_answer_that_is_no_action_names_the_observation(tmp_path: Path, make: Any, message: str) -> None:
    policy = load(saved(tmp_path / "wild.onnx", make()))
    with pytest.raises(PolicyError, match=message):
        policy.act(SEEN)


def card(data: bytes, **changes: Any) -> dict[str, Any]:
    entries: dict[str, Any] = {
        "format": "auvbench-policy",
        "schema_version": 1,
        "name": "mine",
        "file": {"sha256": hashlib.sha256(data).hexdigest()},
        "vehicle": {"name": "bluerov2"},
        "task": {"position_frame": "world"},
        "frequency_hz": 10.0,
        "observation": [{"name": f"o{i}"} for i in range(10)],
        "action": [{"name": f"thruster{i + 1}"} for i in range(6)],
    }
    return entries | changes


def test_a_card_is_read_with_its_file(tmp_path: Path) -> None:
    path = saved(tmp_path / "mine.onnx", model())
    path.with_suffix(".json").write_text(json.dumps(card(path.read_bytes())))
    policy = exported.load(path)
    assert policy.card is not None
    assert (policy.card.name, policy.card.frequency_hz, policy.n_actions) == ("mine", 10.0, 6)
    assert exported.read_card(path.with_suffix(".json")).actuators[0] == "thruster1"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 2}, "schema_version 2, but this auvbench reads 1"),
        ({"file": {"sha256": "0" * 64}}, "belongs to another file than mine.onnx"),
        ({"file": 3}, "file is 3"),
        ({"file": {}}, "file.sha256 is missing"),
        ({"name": "a\nb"}, r"name is 'a\\nb'"),
        ({"frequency_hz": -1}, "frequency_hz is -1"),
        ({"frequency_hz": "10"}, "frequency_hz is '10'"),
        ({"task": {"position_frame": "moon"}}, "world, body"),
        ({"action": [{"name": 3}]}, r"action\[0\]"),
        ({"action": []}, "action has 0 entries"),
        ({"action": {}}, "action is {}"),
        ({"observation": [{"name": "yaw"}]}, "must have the 1 entries that its card names"),
    ],
)
def test_a_card_that_is_not_right_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    path = saved(tmp_path / "mine.onnx", model())
    path.with_suffix(".json").write_text(json.dumps(card(path.read_bytes(), **change)))
    with pytest.raises(PolicyError, match=message):
        exported.load(path)


def test_json_beside_it_that_is_no_card_does_not_matter(tmp_path: Path) -> None:
    path = saved(tmp_path / "mine.onnx", model())
    path.with_suffix(".json").write_text('{"hyperparameters": 3}')
    assert exported.load(path).card is None
    path.with_suffix(".json").write_text("{")
    with pytest.raises(PolicyError, match="is not JSON"):
        exported.load(path)


@pytest.mark.slow
def test_reading_needs_numpy_and_onnx_runtime_alone(tmp_path: Path) -> None:
    path = saved(tmp_path / "mine.onnx", model())
    script = f"""
import sys
class No:
    def find_spec(self, name, path=None, target=None):
        heavy = ("torch", "stable_baselines3", "numba", "onnx", "pyarrow", "pandas", "scipy", "hydra", "omegaconf", "onnxscript", "yaml", "gymnasium")
        if name.partition(".")[0] in heavy:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, No())
sys.argv = ["auvbench"]
from auvbench.policies import exported
import numpy as np
print(exported.load({str(path)!r}).act(np.zeros((2, 10), dtype=np.float32)).shape)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "(2, 6)", done.stderr


SHIPPED = sorted((Path(__file__).parents[3] / "results").rglob("policies/*.onnx"))


@pytest.mark.parametrize("path", SHIPPED[::4], ids=lambda path: path.stem)
def test_a_shipped_policy_answers_as_the_standard_says(path: Path) -> None:
    """Compared with the reference implementation of the onnx package on the file as it lies there."""
    from onnx.reference import ReferenceEvaluator

    policy = exported.load(path)
    seen = np.random.default_rng(2).normal(size=(50, policy.n_observations)).astype(np.float32)
    (expected,) = ReferenceEvaluator(str(path)).run(None, {"observation": seen})
    np.testing.assert_allclose(policy.act(seen), expected, atol=1e-5)
