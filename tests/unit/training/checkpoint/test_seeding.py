"""The copy of a checkpoint into a longer run: what it names stays inside both runs."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.agents.base import Components
from auvbench.runs import integrity
from auvbench.training.checkpoint.extending import seed
from auvbench.training.checkpoint.logs import GrowingLog
from auvbench.training.checkpoint.store import CheckpointStore, CheckpointWarning

LOG = "train/episodes.csv"


@pytest.fixture
def run(tmp_path: Path) -> Path:
    path = tmp_path / "x" / "short"
    (path / LOG).parent.mkdir(parents=True)
    (path / LOG).write_text("a\nb\n")
    components = Components(arrays={"learner": {"x": np.arange(3)}}, values={"counters": {"step": 7}})
    CheckpointStore(path).save(7, components, logs={LOG: GrowingLog(path / LOG).mark()})
    return path


def resealed(run: Path, **changes: Any) -> None:
    manifest = run / "checkpoints" / "7" / "manifest.json"
    manifest.write_text(json.dumps(integrity.sealed(json.loads(manifest.read_text()) | changes)))


def test_a_checkpoint_and_its_logs_are_copied(run: Path, tmp_path: Path) -> None:
    with (run / LOG).open("a") as file:
        file.write("after the checkpoint")
    found = CheckpointStore(run).peek()
    assert found is not None
    target = tmp_path / "x" / "long"
    for _ in range(2):  # a second time, as after a kill
        seed(run, found, target)
    assert (target / LOG).read_text() == "a\nb\n"
    copy = CheckpointStore(target).peek()
    assert copy is not None
    assert copy.components.values == {"counters": {"step": 7}}


@pytest.mark.parametrize("name", ["{tmp}/diary", "../../diary", "train/../../../diary", "link/diary"])
def test_a_log_outside_the_run_is_neither_read_nor_written(name: str, run: Path, tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    diary.write_text("dear diary")
    (run / "link").symlink_to(tmp_path)
    name = name.format(tmp=tmp_path)
    resealed(run, logs={name: {"bytes": 0, "sha256": hashlib.sha256().hexdigest()}})
    target = tmp_path / "x" / "long"
    with pytest.warns(CheckpointWarning, match="damaged"):
        found = CheckpointStore(run).peek()
    if found is not None:
        seed(run, found, target)
    assert diary.read_text() == "dear diary"
    assert not target.exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"logs": None},
        {"logs": {LOG: 3}},
        {"logs": {LOG: {"bytes": -1, "sha256": "0"}}},
        {"files": {"../manifest.json": {"bytes": 1, "sha256": "0"}}},
        {"replay": [{"first": "../x", "last": 1, "bytes": 1, "sha256": "0"}]},
        {"replay": [{"first": 0}]},
        {"step": "7"},
    ],
)
def test_a_manifest_of_other_types_is_damaged(changes: dict[str, Any], run: Path) -> None:
    resealed(run, **changes)
    with pytest.warns(CheckpointWarning, match=r"damaged \(.*using|damaged \(.*starting"):
        assert CheckpointStore(run).peek() is None


def test_a_folder_named_with_a_superscript_is_no_checkpoint(run: Path) -> None:
    (run / "checkpoints" / "²").mkdir()
    assert CheckpointStore(run).steps() == [7]
