"""`auvbench runs`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from auvbench import cli
from auvbench.runs import lock
from auvbench.runs.progress import Reporter
from tests import fake_training


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    """One run in each state, in two experiments."""
    root = tmp_path / "outputs"
    first, second = root / "first", root / "second"
    fake_training.make(first / "ppo-a", total_steps=1000)
    done = fake_training.make(first / "sac-b", algo="sac", total_steps=1000)
    done.update_manifest(state="complete", steps=1000, episodes=80, success_rate=0.97, wall_time_s=3720.0)
    failed = fake_training.make(second / "ppo-c", total_steps=1000)
    failed.update_manifest(
        state="failed", steps=300, error={"type": "X", "message": "the loss is [bold]", "step": 1}
    )
    dead = fake_training.make(second / "ppo-d", total_steps=1000)
    dead.update_manifest(state="running", seed=1)
    Reporter(dead.path / "progress.json", 1000).step(400, force=True)
    return root


def rows(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[dict[str, Any]]:
    assert cli.main(["runs", "--json", *arguments]) == 0
    loaded: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    return loaded


def ids(found: list[dict[str, Any]]) -> list[str]:
    return [row["id"] for row in found]


def test_states_and_figures(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = {row["id"]: row for row in rows(capsys, str(outputs))}
    assert {name: row["state"] for name, row in found.items()} == {
        "ppo-a": "pending",
        "sac-b": "complete",
        "ppo-c": "failed",
        "ppo-d": "interrupted",  # running, says its manifest, but nobody is there
    }
    assert (found["sac-b"]["progress"], found["sac-b"]["success_rate"]) == (1.0, 0.97)
    assert found["ppo-d"]["progress"] == 0.4
    assert found["ppo-c"]["error"] == "the loss is [bold]"


def test_a_living_holder_makes_it_running(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with lock.acquire(outputs / "second" / "ppo-d"):
        (row,) = rows(capsys, str(outputs), "--where", "id=ppo-d")
    assert row["state"] == "running"
    assert f"pid {os.getpid()}" in row["holder"]


def test_filters_and_order(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = str(outputs)
    assert ids(rows(capsys, root, "--where", "state=failed,pending")) == ["ppo-a", "ppo-c"]
    assert ids(rows(capsys, root, "--where", "algo=sac")) == ["sac-b"]
    assert ids(rows(capsys, root, "--where", "experiment=second", "seed=1")) == ["ppo-d"]
    assert ids(rows(capsys, str(outputs / "first"), str(outputs / "second" / "ppo-c"))) == [
        "ppo-a",
        "sac-b",
        "ppo-c",
    ]


def test_the_table(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["runs", str(outputs)]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["run", "state", "steps", "success", "wall", "time", "experiment", "progress"]
    assert ["sac-b", "complete", "1,000", "97%", "1", "h", "2", "min", "first", "100%"] in lines
    assert ["ppo-c", "failed", "300", "second", "30%"] in lines
    assert ["ppo-c:", "the", "loss", "is", "[bold]"] in lines
    assert lines[-1][:2] == ["4", "runs:"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], ["nowhere", "no such"]),
        (["--where", "state=complte"], ["complte", "did you mean 'complete'"]),
        (["--bogus"], ["--bogus", "--help"]),
    ],
)
def test_bad_input_is_one_line(
    outputs: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    paths = [] if arguments == ["nowhere"] else [str(outputs)]
    assert cli.main(["runs", *paths, *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err


def test_a_damaged_run_hides_no_other(outputs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (outputs / "first" / "ppo-a" / "manifest.json").write_text("{")
    assert cli.main(["runs", "--json", str(outputs)]) == 1
    captured = capsys.readouterr()
    assert len(json.loads(captured.out)) == 3
    assert "ppo-a" in captured.err
    assert "damaged" in captured.err


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [
        (["runs", "OUTPUTS"], "torch,pandas,omegaconf,hydra,numba,scipy"),
        (["train", "--cfg", "job"], "torch,pandas,numpy,gymnasium,numba,scipy"),
    ],
)
def test_nothing_heavy_is_imported(arguments: list[str], heavy: str, outputs: Path) -> None:
    code = (
        "import sys; sys.argv[0] = 'auvbench'; from auvbench.cli import main; main(sys.argv[2:]);"
        "print([name for name in sys.argv[1].split(',') if name in sys.modules])"
    )
    words = [str(outputs) if word == "OUTPUTS" else word for word in arguments]
    done = subprocess.run(
        [sys.executable, "-c", code, heavy, *words], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
