"""A run that says complete and whose model is lost or damaged: noticed, named, brought back, and no cost to others."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from auvbench import cli
from auvbench.runs.directory import RunDirectory
from auvbench.training.checkpoint.store import CheckpointStore
from tests import configs
from tests.conftest import Trained
from tests.soak.bits import bits
from tests.soak.campaign import CASES, frozen

BRIEF = ["protocol.episodes=4", "protocol.trajectories=1", "--workers", "1"]
CASE = "ppo-1"

Harm = Callable[[RunDirectory], object]


@pytest.fixture
def run(trained: Trained, tmp_path: Path) -> RunDirectory:
    run = trained(CASE)
    place = tmp_path / "trained" / run.id
    shutil.copytree(run.path, place)
    return RunDirectory(place)


def command(run: RunDirectory) -> list[str]:
    place = [f"output={run.path.parent.parent}", f"name={run.path.parent.name}"]
    return ["train", *configs.original(*CASES[CASE]), *place, "train.progress=false"]


def flipped(name: str) -> Harm:
    def harm(run: RunDirectory) -> None:
        data = bytearray((run.model / name).read_bytes())
        data[len(data) * 2 // 3] ^= 0x10
        (run.model / name).write_bytes(data)

    return harm


def emptied(run: RunDirectory) -> None:
    (run.model / "policy.pt").write_bytes(b"")


def missing(run: RunDirectory) -> None:
    (run.model / "normalisation.npz").unlink()


HARMS: list[tuple[Harm, str]] = [
    (emptied, "model/policy.pt has 0 bytes instead of"),
    (missing, "model/normalisation.npz is missing"),
    (flipped("policy.pt"), "model/policy.pt differs from its digest"),
    (flipped("normalisation.npz"), "model/normalisation.npz differs from its digest"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("harm", "message"), HARMS)
def test_train_brings_it_back_with_the_same_bits(
    run: RunDirectory,
    trained: Trained,
    harm: Harm,
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    harm(run)
    assert cli.main(command(run)) == 0
    out = capsys.readouterr().out
    assert message in out
    assert "training continues from the last checkpoint" in out
    assert bits(run.path) == bits(trained(CASE).path)
    assert cli.main(command(run)) == 0
    assert "complete already" in capsys.readouterr().out


@pytest.mark.slow
def test_without_a_checkpoint_it_is_trained_anew(run: RunDirectory, trained: Trained) -> None:
    emptied(run)
    shutil.rmtree(CheckpointStore(run.path).folder)
    assert cli.main(["resume", str(run.path)]) == 0
    assert bits(run.path) == bits(trained(CASE).path)


@pytest.mark.slow
def test_a_grid_sees_it_too(run: RunDirectory, capsys: pytest.CaptureFixture[str]) -> None:
    frozen(run.path.parent.parent, "trained", CASE, ["seed=3", "train.total_steps=64"])
    flipped("policy.pt")(run)
    assert cli.main(["resume", str(run.path.parent), "--workers", "1"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "model/policy.pt differs from its digest" in out
    assert "2 complete" in out


@pytest.mark.slow
@pytest.mark.parametrize("harm", [flipped("policy.pt"), flipped("normalisation.npz")])
def test_evaluate_names_it_in_a_line_and_tests_the_others(
    run: RunDirectory, harm: Harm, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = run.path.parent
    assert cli.main(["train", "algo=random", f"output={folder.parent}", f"name={folder.name}"]) == 0
    harm(run)
    capsys.readouterr()
    cli.main(["evaluate", str(folder), *BRIEF])
    said = capsys.readouterr()
    assert said.out.count(": success ") == 1
    lines = [line for line in said.err.splitlines() if str(run.path) in line]
    assert len(lines) == 1
    assert "resume" in lines[0]
    assert "Traceback" not in said.err


def test_replay_refuses_damaged_weights(run: RunDirectory, capsys: pytest.CaptureFixture[str]) -> None:
    flipped("policy.pt")(run)
    assert cli.main(["replay", str(run.path)]) == 2
    error = capsys.readouterr().err
    assert "policy.pt differs from its digest" in error
    assert error.count("\n") == 1
