"""Tests that are killed or started twice: nobody goes on behind the user's back, and no row is written twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from auvbench.config.compose import compose
from auvbench.evaluation.evaluate import is_done
from auvbench.runs import lock
from auvbench.runs.directory import RunDirectory
from tests.unit.runs.test_damage import frozen
from tests.waiting import LIMIT, until

# Long enough to be met in the midst of it: random agents swim until their time is over.
LONG = ["protocol.episodes=100", "protocol.batch=50", "protocol.trajectories=0"]
BRIEF = ["protocol.episodes=4", "protocol.trajectories=1"]


def evaluate(folder: Path, *overrides: str, workers: int = 2) -> subprocess.Popen[str]:
    arguments = [sys.executable, "-P", "-m", "auvbench.cli", "evaluate", str(folder)]
    return subprocess.Popen(
        [*arguments, *overrides, "--workers", str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


@pytest.fixture
def runs(tmp_path: Path) -> list[RunDirectory]:
    return [frozen(tmp_path, "algo=random", f"seed={seed}") for seed in range(3)]


@pytest.fixture
def killed() -> Iterator[list[psutil.Process]]:
    """Whatever a test leaves is ended after it."""
    left: list[psutil.Process] = []
    yield left
    for process in left:
        if process.is_running():
            process.kill()


def being_tested(runs: list[RunDirectory]) -> list[lock.RunLock]:
    """The runs whose evaluation somebody holds."""
    return [run for run in runs if lock.living_holder(run.path / "evaluations" / ".test") is not None]


@pytest.mark.slow
def test_a_killed_evaluate_leaves_no_worker(
    runs: list[RunDirectory], tmp_path: Path, killed: list[psutil.Process]
) -> None:
    main = evaluate(tmp_path, *LONG)
    until(lambda: being_tested(runs) or main.poll() is not None, "an evaluation under way")
    workers = psutil.Process(main.pid).children(recursive=True)
    killed += workers
    assert len(being_tested(runs)) > 0
    main.kill()
    main.wait()
    until(lambda: not any(_lives(worker) for worker in workers), "the end of the workers")
    assert not being_tested(runs)
    assert not list(tmp_path.glob("*/*/evaluations/test"))


@pytest.mark.slow
def test_a_killed_worker_is_named_and_every_run_is_tested(runs: list[RunDirectory], tmp_path: Path) -> None:
    process = evaluate(tmp_path, *LONG)
    until(lambda: being_tested(runs) or process.poll() is not None, "an evaluation under way")
    run = being_tested(runs)[0]
    holder = lock.living_holder(run.path / "evaluations" / ".test")
    assert holder is not None
    os.kill(holder.pid, signal.SIGKILL)
    _, error = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, error
    (line,) = [line for line in error.splitlines() if "worker was killed" in line]
    assert str(run.path) in line
    assert len(list(tmp_path.glob("*/*/evaluations/test/summary.json"))) == len(runs)


def _lives(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.slow
def test_three_at_once_test_each_run_once(runs: list[RunDirectory], tmp_path: Path) -> None:
    three = [
        evaluate(tmp_path, "protocol.episodes=20", "protocol.trajectories=0", workers=1) for _ in range(3)
    ]
    said = [(process.wait(), *process.communicate()) for process in three]
    assert all("Traceback" not in error for _, _, error in said)
    for code, _, error in said:
        # Who comes second names whom it leaves the run to, or finds it done.
        assert code in (0, 1)
        if code:
            assert "is testing it by the protocol test" in error
    tested = sum(out.count(": success ") for _, out, _ in said)
    assert tested == len(runs)
    protocol = compose("evaluate", ["protocol.episodes=20", "protocol.trajectories=0"])
    from auvbench.config.validate import evaluate_config

    assert all(is_done(run, evaluate_config(protocol).protocol) for run in runs)


@pytest.mark.slow
def test_a_run_that_is_being_tested_is_left_alone_and_the_others_are_tested(
    runs: list[RunDirectory], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from auvbench import cli

    held = runs[0].path / "evaluations" / ".test"
    held.mkdir(parents=True)
    with lock.acquire(held):
        assert (
            cli.main(["evaluate", str(runs[0].path), *BRIEF, "--workers", "1"]) == 1
        )  # nothing was wrong with the input
        assert f"pid {os.getpid()}" in capsys.readouterr().err
        assert cli.main(["evaluate", str(tmp_path), *BRIEF, "--workers", "1"]) == 1
    said = capsys.readouterr()
    assert f"{runs[0].id}: " in said.err
    assert f"pid {os.getpid()}" in said.err
    assert said.out.count(": success ") == 2
    assert cli.main(["evaluate", str(tmp_path), *BRIEF, "--workers", "1"]) == 0
