"""The SLURM backend on a real cluster without accounting: requeue, kill, failure, and a sweep that comes back."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from auvbench.errors import AuvbenchError
from auvbench.integrations.cluster.slurm import SlurmBackend
from auvbench.integrations.cluster.spec import Slurm
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.grid import sweep
from auvbench.scheduling.loop import Outcome, Result
from auvbench.training.worker import TARGET
from tests import fake_training
from tests.cluster import slurm_cluster
from tests.cluster.slurm_cluster import ask, until

pytestmark = pytest.mark.cluster
ROOT = Path(__file__).parents[2]
FAKE = "tests.fake_training:execute"


@pytest.fixture(scope="module", autouse=True)
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    os.environ["PYTHONPATH"] = str(ROOT)  # workers find the tests
    with slurm_cluster.running(tmp_path_factory.mktemp("slurm")):
        yield
    del os.environ["PYTHONPATH"]


def options(**changes: Any) -> Slurm:
    defaults: dict[str, Any] = {
        "name": "slurm",
        "workers": 0,
        "partition": None,
        "account": None,
        "time": None,
        "mem": "500M",
        "cpus": 1,
        "signal_before": 30,
        "poll": 1.0,
        "grace": 5.0,
        "setup": [],
        "sbatch": [],
    }
    return Slurm(**{**defaults, **changes})


def carry_out(runs: list[RunDirectory], target: str = FAKE, **changes: Any) -> tuple[Result, str]:
    text = io.StringIO()
    result = sweep(runs, SlurmBackend(options(**changes), target=target), Console(file=text, width=200))
    return result, text.getvalue()


def job_of(run: RunDirectory) -> str:
    return str(json.loads((run.path / "slurm.json").read_text())["job"])


def meanwhile(action: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=action)
    thread.start()
    return thread


def begun(run: RunDirectory) -> bool:
    return (run.path / "saved.json").exists()


def requeue(run: RunDirectory) -> None:
    """As a preemption does; SLURM then waits two minutes, which the test need not."""
    subprocess.run(["scontrol", "requeue", job_of(run)], check=True)
    hurry(run)


def hurry(run: RunDirectory) -> None:
    """Starts a requeued job now, once it is back in the queue or the run complete."""
    until(lambda: run.manifest()["state"] == "complete" or waits(run), 60)
    if waits(run):
        subprocess.run(["scontrol", "update", f"JobId={job_of(run)}", "StartTime=now"], check=False)


def waits(run: RunDirectory) -> bool:
    return "PENDING" in ask("squeue", "-h", "-o", "%T", "-j", job_of(run))


def test_a_grid_completes_with_a_failure_among_it(tmp_path: Path) -> None:
    good = [fake_training.make(tmp_path / f"good{number}") for number in range(3)]
    bad = fake_training.make(tmp_path / "bad", fail_at=20)
    result, text = carry_out([bad, *good])
    assert result.exit_code == 1
    assert result.of(Outcome.FAILED) == {bad.path: "the loss is not a number"}
    assert set(result.of(Outcome.COMPLETE)) == {run.path for run in good}
    for run in (bad, *good):
        assert f"{run.path.name}: queued as slurm job {job_of(run)}" in text
    for run in good:
        assert (run.path / "result.txt").read_text() == fake_training.chain(50)
        assert "worker, pid" in (run.path / "train" / "log.txt").read_text()


def test_a_large_grid_is_an_array_whose_tasks_fail_and_go_on_one_by_one(tmp_path: Path) -> None:
    good = [fake_training.make(tmp_path / f"good{number}", total_steps=10) for number in range(99)]
    slow = fake_training.make(tmp_path / "slow", step_s=0.1, total_steps=80)
    bad = fake_training.make(tmp_path / "bad", fail_at=20)

    def disturb() -> None:
        until(lambda: begun(slow), 600)
        requeue(slow)

    thread = meanwhile(disturb)
    result, text = carry_out([slow, bad, *good])
    thread.join()
    array, task = job_of(slow).split("_")
    assert task == "0"
    assert {job_of(run) for run in (bad, *good)} == {f"{array}_{task}" for task in range(1, 101)}
    assert result.of(Outcome.FAILED) == {bad.path: "the loss is not a number"}
    assert set(result.of(Outcome.COMPLETE)) == {run.path for run in (slow, *good)}
    assert f"slow: queued as slurm job {array}_0" in text
    assert slow.manifest()["attempts"] == 2
    assert (slow.path / "result.txt").read_text() == fake_training.chain(80)
    assert "worker, pid" in (good[50].path / "train" / "log.txt").read_text()


def test_a_killed_job_is_noticed_without_accounting(tmp_path: Path) -> None:
    shot = fake_training.make(tmp_path / "shot", kill_at=30, once=True)
    good = fake_training.make(tmp_path / "good")
    start = time.monotonic()
    result, _ = carry_out([shot, good])
    took = time.monotonic() - start
    assert took < 60
    assert set(result.of(Outcome.FAILED)) == {shot.path}
    message = result.of(Outcome.FAILED)[shot.path]
    assert "signal 9" in message
    assert "possibly out of memory" in message
    assert (shot.manifest()["state"], shot.manifest()["error"]["message"]) == ("failed", message)
    result, _ = carry_out([shot, good])
    assert result.exit_code == 0
    assert (shot.path / "result.txt").read_text() == fake_training.chain(50)


def test_a_requeued_job_goes_on(tmp_path: Path) -> None:
    run = fake_training.make(tmp_path / "it's 100% odd" / "run", step_s=0.1, total_steps=80)

    def disturb() -> None:
        until(lambda: begun(run), 60)
        requeue(run)

    thread = meanwhile(disturb)
    result, _ = carry_out([run])
    thread.join()
    assert result.exit_code == 0
    assert run.manifest()["attempts"] == 2
    assert (run.path / "result.txt").read_text() == fake_training.chain(80)


def test_before_its_time_limit_a_run_saves_and_requeues_itself(tmp_path: Path) -> None:
    run = fake_training.make(tmp_path / "long", step_s=0.5, total_steps=100)

    def hurry_on() -> None:
        until(lambda: "is requeued" in log(run), 90)
        while run.manifest()["state"] != "complete":
            hurry(run)
            time.sleep(1)

    thread = meanwhile(hurry_on)
    # SLURM counts time limits in minutes and looks at them twice a minute.
    result, _ = carry_out([run], time="00:01:00", signal_before=50)
    thread.join()
    assert result.exit_code == 0, log(run)
    assert run.manifest()["attempts"] >= 2
    assert (run.path / "result.txt").read_text() == fake_training.chain(100)


def log(run: RunDirectory) -> str:
    file = run.path / "train" / "log.txt"
    return file.read_text() if file.exists() else ""


def test_a_killed_sweep_finds_its_jobs_again(tmp_path: Path) -> None:
    runs = [fake_training.make(tmp_path / f"run{i}", step_s=0.1, total_steps=80) for i in range(3)]
    code = (
        "import sys; from pathlib import Path; from tests.cluster import test_slurm as t;"
        "from auvbench.runs.directory import RunDirectory;"
        "t.carry_out([RunDirectory(p) for p in sorted(Path(sys.argv[1]).glob('run*'))])"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])
    until(lambda: all((run.path / "slurm.json").exists() for run in runs), 60)
    until(lambda: begun(runs[0]), 60)
    process.send_signal(signal.SIGKILL)
    process.wait()
    jobs = [job_of(run) for run in runs]
    result, text = carry_out(runs)
    assert result.exit_code == 0, text
    assert [job_of(run) for run in runs] == jobs  # nothing was submitted twice
    assert all(run.manifest()["attempts"] == 1 for run in runs)


def test_ctrl_c_reaches_the_jobs_which_save(tmp_path: Path) -> None:
    runs = [fake_training.make(tmp_path / f"run{i}", step_s=0.1, total_steps=600) for i in range(3)]

    def interrupt() -> None:
        until(lambda: begun(runs[0]) and begun(runs[1]), 60)
        os.kill(os.getpid(), signal.SIGINT)

    thread = meanwhile(interrupt)
    result, text = carry_out(runs)
    thread.join()
    assert result.exit_code == 130, text
    assert sorted(run.manifest()["state"] for run in runs) == ["interrupted", "interrupted", "pending"]
    assert ask("squeue", "-h", "-t", "PENDING,RUNNING") == ""
    for run in runs[:2]:
        assert json.loads((run.path / "saved.json").read_text())[0] == run.manifest()["steps"] > 0


def test_a_refusal_is_one_clear_line(tmp_path: Path) -> None:
    run = fake_training.make(tmp_path / "run")
    with pytest.raises(AuvbenchError, match=r"sbatch refused: .*partition"):
        carry_out([run], partition="no-such")
    assert run.manifest()["state"] == "pending"


def trained(folder: Path) -> RunDirectory:
    """A small real training, frozen."""
    from auvbench.config.compose import compose
    from auvbench.runs.plan import prepare

    overrides = [
        f"output={folder}",
        "algo=ppo",
        "seed=3",
        "train.total_steps=200000",
        "train.checkpoint.steps=8192",
    ]
    return prepare(compose("train", overrides))


def test_a_training_requeued_in_mid_run_ends_with_the_same_bits(tmp_path: Path) -> None:
    whole, cut = trained(tmp_path / "whole"), trained(tmp_path / "cut")

    def disturb() -> None:
        until(lambda: any(cut.checkpoints.glob("[0-9]*")), 120)
        requeue(cut)

    thread = meanwhile(disturb)
    result, text = carry_out([whole, cut], target=TARGET, mem="1500M")
    thread.join()
    assert result.exit_code == 0, text
    assert (whole.manifest()["attempts"], cut.manifest()["attempts"]) == (1, 2)
    for name in ("train/episodes.csv", "model/policy.pt", "model/normalisation.npz"):
        assert (whole.path / name).read_bytes() == (cut.path / name).read_bytes(), name
