"""`auvbench train --dry-run` tells what would happen, and does nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvbench.cli import main
from auvbench.scheduling import dry_run
from tests import configs, synthetic

WORDS = ["train", *configs.ORIGINAL, "--dry-run"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().out.splitlines()


def test_it_lists_the_runs_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*WORDS, "-m", "algo=ppo,pid", "seed=0", "train.total_steps=2000"]) == 0
    said = lines(capsys)
    assert said[0] == "2 runs"
    assert (
        sum(line.startswith("outputs/default/ppo-") and line.endswith(": 2,000 steps") for line in said) == 1
    )
    assert (
        sum(line.startswith("outputs/default/pid-") and line.endswith(": nothing to train") for line in said)
        == 1
    )
    assert "ppo on waypoint: cost unknown until one such run is complete" in said
    assert list(folder.iterdir()) == []


def test_the_cost_is_that_of_complete_runs_for_the_steps_that_are_left(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run,) = synthetic.write_experiment(folder / "outputs" / "old", algorithms=("ppo",), seeds=(0,))
    config = synthetic.read_yaml(run / "config.yaml")
    config["algo"]["agent"] = "ppo"
    synthetic.write_yaml(run / "config.yaml", config)
    synthetic.seal(run / "manifest.json", steps=1000, cpu_time_s=30.0)
    assert main([*WORDS, "-m", "algo=ppo", "seed=0,1", "train.total_steps=4000"]) == 0
    size = 2 * sum(path.stat().st_size for path in run.rglob("*") if path.is_file()) / 1e6
    # Two runs of 4,000 steps at 30 ms each.
    assert f"about 4 min of processor time and {size:,.1f} MB, from 1 complete run here" in lines(capsys)


def test_a_run_that_cannot_start_is_an_error_as_without_the_flag(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(folder))
    assert main([*WORDS, "algo=ppo", "launcher=slurm"]) == 2
    assert "sbatch not found" in capsys.readouterr().err


def test_another_command_has_no_such_flag(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "--dry-run", "algo=pid"]) == 2
    assert "--dry-run" in capsys.readouterr().err


def test_with_another_way_to_start_nothing_it_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*WORDS, "--cfg", "job"]) == 2
    assert (
        "--cfg job shows a configuration, --dry-run lists runs: give one of them" in capsys.readouterr().err
    )


def test_runs_of_other_kinds_are_not_measured(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(dry_run, "_runs", lambda output: pytest.fail("reads runs without a need"))
    assert main([*WORDS, "algo=pid"]) == 0
    assert "nothing to train" in capsys.readouterr().out
