"""What of an evaluation is not good any more: it is done again, and evaluate says why."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.evaluation import reference
from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from tests.unit.runs.test_damage import frozen

BRIEF = ["protocol.episodes=3", "protocol.trajectories=1", "--workers", "1"]


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> RunDirectory:
    made = frozen(tmp_path, "algo=random", "task.max_steps=20")
    assert cli.main(["evaluate", str(made.path), *BRIEF]) == 0
    capsys.readouterr()
    return made


def summary_of(run: RunDirectory) -> Path:
    return run.evaluation("test") / "summary.json"


def resealed(of: RunDirectory, /, **changes: object) -> None:
    path = summary_of(of)
    path.write_text(json.dumps(integrity.sealed(json.loads(path.read_text()) | changes)))


def unsealed(run: RunDirectory) -> None:
    path = summary_of(run)
    old = json.loads(path.read_text())
    path.write_text(json.dumps({key: old[key] for key in old if key not in ("seal", "files")}))


def flipped(name: str) -> Callable[[RunDirectory], None]:
    def harm(run: RunDirectory) -> None:
        path = run.evaluation("test") / name
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)

    return harm


def emptied(run: RunDirectory) -> None:
    (run.evaluation("test") / "episodes.csv").write_bytes(b"")


def parts_of(run: RunDirectory) -> dict[str, str]:
    parts: dict[str, str] = json.loads((run.evaluation("test") / "summary.json").read_text())[
        "fingerprint_parts"
    ]
    return parts


HARMS = [
    (flipped("episodes.csv"), "episodes.csv differs from its digest"),
    (flipped("trajectories.npz"), "trajectories.npz differs from its digest"),
    (flipped("summary.json"), "its summary is damaged"),
    (emptied, "episodes.csv has 0 bytes instead of"),
    (lambda run: (run.evaluation("test") / "trajectories.npz").unlink(), "trajectories.npz is missing"),
    (unsealed, "its summary is damaged"),
    (lambda run: resealed(run, run="random-k1-f10-s7-01234567"), "random-k1-f10-s7-01234567"),
    (lambda run: resealed(run, model={"model/policy.pt": "0"}), "the run's model has changed"),
    (lambda run: resealed(run, fingerprint_parts=None), "its summary is damaged"),
    (
        lambda run: resealed(run, fingerprint_parts=parts_of(run) | {"outcomes": "0"}),
        "now have other outcomes",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("harm", "why"), HARMS, ids=[why[:20] for _, why in HARMS])
def test_what_is_stale_is_tested_again_and_why_is_said(
    run: RunDirectory,
    harm: Callable[[RunDirectory], None],
    why: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = (run.evaluation("test") / "episodes.csv").read_bytes()
    harm(run)
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 0
    out = capsys.readouterr().out.replace("\n", " ")
    assert f"{run.id}: tested again: " in out
    assert why in out
    assert (run.evaluation("test") / "episodes.csv").read_bytes() == rows
    assert not list(run.evaluation("test").parent.glob(".test.*"))
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 0
    assert "tested again" not in capsys.readouterr().out


@pytest.mark.slow
def test_rows_of_another_physics_are_stale(
    run: RunDirectory, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from auvbench.evaluation import protocol

    monkeypatch.setattr(protocol, "_plays", {})
    monkeypatch.setattr(reference, "digest", lambda *_: "of another physics")
    assert cli.main(["evaluate", str(run.path), *BRIEF]) == 0
    assert "the same commands now have other outcomes: the simulator or the task has changed" in (
        capsys.readouterr().out.replace("\n", " ")
    )


@pytest.mark.slow
def test_an_evaluation_that_was_copied_in_is_not_this_run_s(run: RunDirectory, tmp_path: Path) -> None:
    other = frozen(tmp_path, "algo=random", "task.max_steps=20", "seed=7")
    shutil.copytree(run.evaluation("test"), other.evaluation("test"))
    assert cli.main(["evaluate", str(other.path), *BRIEF]) == 0
    assert json.loads(summary_of(other).read_text())["run"] == other.id
