"""Sweeps of real trainings, typed as a user types them."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from auvbench.cli import main
from auvbench.runs import interruption, lock
from auvbench.runs.directory import RunDirectory, find_runs
from tests.waiting import LIMIT, until

AUVBENCH = [sys.executable, "-m", "auvbench"]
KILLS = int(os.environ.get("AUVBENCH_KILLS", "2"))
"""`make soak` sets more"""
Command = Callable[..., "subprocess.CompletedProcess[str]"]
GRID = """
# @package _global_
hydra:
  mode: MULTIRUN
  sweeper:
    grids:
      - {algo: "ppo,random", reward.k: "1,40", seed: "range(0,2)"}
      - {algo: pid, seed: 0}
name: study
train:
  total_steps: 6000
  checkpoint: {steps: 2048}
"""


def auvbench(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*AUVBENCH, *arguments], cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Somebody's working directory with an experiment of their own."""
    experiments = tmp_path / "conf" / "experiment"
    experiments.mkdir(parents=True)
    (experiments / "study.yaml").write_text(GRID)
    return tmp_path


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Return `auvbench` for this process, in somebody's working directory."""
    monkeypatch.chdir(folder)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        code = main(list(arguments))
        said = capsys.readouterr()
        return subprocess.CompletedProcess(arguments, code, said.out, said.err)

    return run


def result(run: RunDirectory) -> dict[str, bytes]:
    """What a run ends with."""
    names = ("train/episodes.csv", "model/policy.pt", "model/normalisation.npz")
    return {name: (run.path / name).read_bytes() for name in names if (run.path / name).exists()}


def named(folder: Path) -> dict[str, RunDirectory]:
    return {run.id: run for run in find_runs([folder])}


def words(output: str) -> list[list[str]]:
    return [line.split() for line in output.splitlines()]


@pytest.mark.slow
def test_an_experiment_is_started_narrowed_and_typed_again(folder: Path, here: Command) -> None:
    done = here("train", "experiment=study", "algo=random,pid", "reward.k=40")
    assert done.returncode == 0, done.stderr
    assert ["missing", "3", "started"] in words(done.stdout)
    # A value that no grid has replaces the axis: one more run, of the two grids' 8 + 1 that are left to do.
    again = here("train", "experiment=study", "algo=random,pid", "seed=0,7", "reward.k=40")
    assert again.returncode == 0, again.stderr
    assert ["complete", "2", "skipped"] in words(again.stdout)
    assert ["missing", "2", "started"] in words(again.stdout)
    states = {run.manifest()["state"] for run in named(folder).values()}
    assert (len(named(folder)), states) == (5, {"complete"})
    assert sorted(path.name for path in folder.iterdir()) == [
        "conf",
        "outputs",
    ]  # Hydra wrote nothing of its own


@pytest.mark.slow
def test_nothing_starts_when_one_job_is_wrong(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(["train", "-m", "experiment=study", "seed=0,1,-1"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("auvbench: seed=-1: ")
    assert error.count("\n") == 1
    assert not (folder / "outputs").exists()


@pytest.mark.slow
def test_editing_yaml_during_a_sweep_changes_nothing_and_a_changed_config_is_refused(
    folder: Path, here: Command
) -> None:
    done = here("train", "-m", "algo=random", "seed=0,1")
    assert done.returncode == 0, done.stderr
    run = next(iter(named(folder).values()))
    run.config_path.write_text(run.config_path.read_text().replace("k: 1", "k: 2", 1))
    refused = here("train", "-m", "algo=random", f"seed={run.manifest()['seed']},5")
    assert refused.returncode == 2
    assert "its id is random-bluerov2_2026-k2-" in refused.stderr
    assert refused.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_worker_of_a_sweep_and_a_process_of_its_own_compute_the_same_bits(
    folder: Path, here: Command
) -> None:
    arguments = ["algo=ppo", "train.total_steps=3000", "task.max_steps=200"]
    swept = here("train", "-m", *arguments, "seed=0,1", "name=swept")
    assert swept.returncode == 0, swept.stderr
    alone = auvbench(folder, "train", *arguments, "seed=1", "name=alone")
    assert alone.returncode == 0, alone.stderr
    (one,) = find_runs([folder / "outputs" / "alone"])
    two = RunDirectory(folder / "outputs" / "swept" / one.id)
    assert result(one) == result(two)
    assert len(result(one)) == 3


@pytest.mark.slow
def test_a_single_run_that_is_held_is_left_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    assert main(["train", "algo=random", "seed=3"]) == 0
    (run,) = find_runs([folder])
    run.update_manifest(state="interrupted")
    with lock.acquire(run.path):
        assert main(["train", "algo=random", "seed=3"]) == 1
    assert f"locked by {interruption.host()}, pid {os.getpid()}, since" in capsys.readouterr().err


@pytest.mark.slow
def test_a_training_whose_run_was_taken_over_stops_without_writing_more(folder: Path) -> None:
    """As after a night in a suspended laptop, while a cluster went on with the run."""
    process = subprocess.Popen(
        [*AUVBENCH, "train", "algo=ppo", "train.total_steps=100000000", "train.checkpoint.steps=4096"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        wait_for_work(folder / "outputs" / "default", process)
        (run,) = find_runs([folder])
        held = lock.current(run.path)
        assert held is not None
        thief = asdict(replace(held, host="node7", token="another", path=""))
        (run.path / lock.FOLDER / lock.HOLDER).write_text(json.dumps(thief))
        output, _ = process.communicate(timeout=LIMIT)
    finally:
        process.kill()
    assert process.returncode == 1
    assert "node7" in output.splitlines()[-1]
    assert run.manifest()["state"] == "running"
    assert lock.current(run.path) == replace(held, host="node7", token="another")


@pytest.mark.long
@pytest.mark.slow
def test_a_sweep_killed_again_and_again_ends_as_one_that_was_not(folder: Path) -> None:
    """Kill the whole process group of four runs `KILLS` times, each time a random moment after a new checkpoint."""
    sweep = ["train", "-m", "algo=ppo,sac", "seed=0,1", "algo.n_envs=8", "algo.net_arch=[32,32]"]
    sweep += ["train.total_steps=3000", "train.checkpoint.steps=250"]
    whole = auvbench(folder, *sweep, "name=whole")
    assert whole.returncode == 0, whole.stdout + whole.stderr
    chance = random.Random(4)
    for _ in range(KILLS):
        before = checkpoints(folder)
        process = subprocess.Popen(
            [*AUVBENCH, *sweep, "name=killed"],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        until(lambda: checkpoints(folder) - before or process.poll() is not None, "a new checkpoint")  # noqa: B023
        time.sleep(chance.uniform(0.0, 0.3))
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    end = auvbench(folder, *sweep, "name=killed")
    assert end.returncode == 0, end.stdout + end.stderr
    expected, found = named(folder / "outputs" / "whole"), named(folder / "outputs" / "killed")
    assert len(expected) == 4
    assert found.keys() == expected.keys()
    for name, run in expected.items():
        assert result(found[name]) == result(run), name
    assert sum(json.loads(run.manifest_path.read_text())["attempts"] for run in found.values()) > 4


def checkpoints(folder: Path) -> set[Path]:
    return set(folder.glob("outputs/killed/*/checkpoints/[0-9]*"))


def wait_for_work(folder: Path, process: subprocess.Popen[Any]) -> None:
    """Wait until a worker has a run, or the sweep is over."""

    def begun() -> bool:
        return folder.exists() and any(lock.living_holder(path) for path in folder.glob("*/"))

    until(lambda: begun() or process.poll() is not None, "a worker with a run")


def test_a_single_run_goes_where_the_launcher_says(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(folder))
    assert main(["train", "algo=pid", "launcher=slurm"]) == 2
    assert "sbatch" in capsys.readouterr().err
    assert not list((folder / "outputs").glob("*/*/model"))
