"""The scheduling loop over real processes of this machine, and the faults it has to live with."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from rich.console import Console

from auvbench.runs import interruption, lock, status
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.grid import sweep
from auvbench.scheduling.local import LocalBackend
from auvbench.scheduling.loop import Outcome, Result, judge
from auvbench.training import worker
from tests import fake_training
from tests.waiting import LIMIT, until

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.usefixtures("own_fork_servers")
TARGET = "tests.fake_training:execute"
SWEEP = """
import sys
from pathlib import Path
from rich.console import Console
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.local import LocalBackend
from auvbench.scheduling.grid import sweep
runs = [RunDirectory(path) for path in sorted(Path(sys.argv[1]).glob("*/"))]
backend = LocalBackend(2, target="tests.fake_training:execute", preload=())
sys.exit(sweep(runs, backend, Console(width=200)).exit_code)
"""


@pytest.fixture(autouse=True)
def workers_find_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    assert living_workers(tmp_path) == []  # whatever happened, nothing is left behind


def carry_out(runs: list[RunDirectory], workers: int = 2) -> tuple[Result, str]:
    text = io.StringIO()
    result = sweep(runs, LocalBackend(workers, target=TARGET, preload=()), Console(file=text, width=200))
    return result, text.getvalue()


def start_sweep(folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", SWEEP, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def living_workers(folder: Path) -> list[lock.Holder]:
    holders = [lock.living_holder(path) for path in sorted(folder.glob("*/"))]
    return [holder for holder in holders if holder is not None]


def saved_steps(runs: list[RunDirectory]) -> int:
    files = [run.path / "saved.json" for run in runs]
    return sum(json.loads(file.read_text())[0] for file in files if file.exists())


def under_way(runs: list[RunDirectory]) -> int:
    """How many have made a step."""
    return sum((run.path / "progress.json").exists() for run in runs)


@pytest.mark.slow
def test_all_complete_and_a_second_time_skips(folder: Path) -> None:
    runs = [fake_training.make(folder / f"run{number}") for number in range(5)]
    result, text = carry_out(runs)
    assert result.exit_code == 0
    assert set(result.of(Outcome.COMPLETE)) == {run.path for run in runs}
    assert ["missing", "5", "started"] in [line.split() for line in text.splitlines()]
    for run in runs:
        assert (run.path / "result.txt").read_text() == fake_training.chain(50)
        assert "worker, pid" in (run.path / "train" / "log.txt").read_text()
    result, text = carry_out(runs)
    assert result.exit_code == 0
    assert ["complete", "5", "skipped"] in [line.split() for line in text.splitlines()]
    assert all(run.manifest()["attempts"] == 1 for run in runs)


@pytest.mark.slow
def test_one_failure_costs_no_other(folder: Path) -> None:
    bad = fake_training.make(folder / "bad", fail_at=20)
    good = [fake_training.make(folder / f"good{number}") for number in range(3)]
    result, text = carry_out([bad, *good])
    assert result.exit_code == 1
    assert result.of(Outcome.FAILED) == {bad.path: "the loss is not a number"}
    assert len(result.of(Outcome.COMPLETE)) == 3
    assert f"failed: {bad.path}: the loss is not a number" in text
    error = bad.manifest()["error"]
    assert error["type"] == "ValueError"
    assert "fake_training.py" in error["traceback"]
    assert "ValueError" in (bad.path / "train" / "log.txt").read_text()


@pytest.mark.slow
def test_a_worker_killed_by_the_system_fails_alone_and_is_resumed_next_time(folder: Path) -> None:
    shot = fake_training.make(folder / "shot", kill_at=25, once=True)
    good = fake_training.make(folder / "good")
    result, _ = carry_out([shot, good])
    message = "killed by signal 9 (SIGKILL), possibly out of memory"
    assert result.of(Outcome.FAILED) == {shot.path: message}
    manifest = shot.manifest()
    assert (manifest["state"], manifest["error"]["message"]) == ("failed", message)
    assert result.of(Outcome.COMPLETE) == {good.path: ""}
    result, text = carry_out([shot, good])
    assert result.exit_code == 0
    assert f"failed: shot {message}" in text
    assert (shot.path / "result.txt").read_text() == fake_training.chain(50)


def test_a_target_that_cannot_be_imported_fails_with_its_reason(folder: Path) -> None:
    run = fake_training.make(folder / "run")
    backend = LocalBackend(1, target="tests.no_such_module:execute", preload=())
    result = sweep([run], backend, Console(file=io.StringIO()))
    assert "no_such_module" in result.of(Outcome.FAILED)[run.path]
    assert run.manifest()["error"]["type"] == "ModuleNotFoundError"


@pytest.mark.slow
def test_the_server_of_the_workers_dies_and_the_runs_go_on(folder: Path) -> None:
    runs = [fake_training.make(folder / f"run{number}", step_s=0.02) for number in range(2)]
    process = start_sweep(folder)
    until(lambda: under_way(runs) == 2)
    worker = living_workers(folder)[0].pid
    server = int(Path(f"/proc/{worker}/stat").read_text().rpartition(")")[2].split()[1])
    os.kill(server, signal.SIGKILL)
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, output
    assert "it is resumed" in output
    for run in runs:
        assert (run.path / "result.txt").read_text() == fake_training.chain(50)
        assert run.manifest()["attempts"] == 2


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_is_passed_on_and_the_runs_save(folder: Path, number: signal.Signals, code: int) -> None:
    runs = [fake_training.make(folder / f"run{i}", step_s=0.02, total_steps=500) for i in range(3)]
    process = start_sweep(folder)
    until(lambda: under_way(runs) == 2)
    process.send_signal(number)
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == code, output
    assert "the 2 active runs save and exit" in output
    assert "2 interrupted, 1 not started" in output
    states = [run.manifest()["state"] for run in runs]
    assert sorted(states) == ["interrupted", "interrupted", "pending"]
    for run in runs:
        if run.manifest()["state"] == "interrupted":
            assert json.loads((run.path / "saved.json").read_text())[0] == run.manifest()["steps"] > 0


@pytest.mark.slow
def test_a_second_signal_kills(folder: Path) -> None:
    deaf = fake_training.make(folder / "deaf", step_s=60.0)
    process = start_sweep(folder)
    until(lambda: deaf.manifest()["state"] == "running")
    process.send_signal(signal.SIGINT)
    assert process.stdout is not None
    for line in process.stdout:
        if "a second signal kills" in line:
            break
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=LIMIT)
    assert process.returncode == 130


@pytest.mark.slow
def test_kill_9_of_the_sweep_leaves_nothing_behind_and_costs_nothing(folder: Path) -> None:
    runs = [fake_training.make(folder / f"run{i}", step_s=0.01, total_steps=60) for i in range(4)]
    for _ in range(6):
        process = start_sweep(folder)
        before = saved_steps(runs)
        until(lambda: saved_steps(runs) > before or process.poll() is not None)  # noqa: B023
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        until(lambda: living_workers(folder) == [])
        assert all(status.of(run).state is not status.State.RUNNING for run in runs)
    process = start_sweep(folder)
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, output
    for run in runs:
        assert (run.path / "result.txt").read_text() == fake_training.chain(60)


@pytest.mark.slow
def test_two_sweeps_at_once_share_the_work(folder: Path) -> None:
    runs = [fake_training.make(folder / f"run{i}", step_s=0.01) for i in range(6)]
    sweeps = [start_sweep(folder) for _ in range(2)]
    outputs = [process.communicate(timeout=LIMIT)[0] for process in sweeps]
    # 1 says that the other sweep still had runs of this one when it ended.
    for process, output in zip(sweeps, outputs, strict=True):
        assert process.returncode == (1 if "  locked: " in output else 0), output
    assert "locked by" in outputs[0] + outputs[1]
    for run in runs:
        assert (run.path / "result.txt").read_text() == fake_training.chain(50)
        assert run.manifest()["attempts"] == 1  # nobody did anything twice


def test_a_held_run_is_left_alone_and_named(folder: Path) -> None:
    held, free = fake_training.make(folder / "held"), fake_training.make(folder / "free")
    with lock.acquire(held.path):
        result, text = carry_out([held, free])
    assert result.exit_code == 1  # whoever goes on with `&&` counts on all of them
    assert set(result.of(Outcome.HELD)) == {held.path}
    assert f"locked: held by {interruption.host()}, pid {os.getpid()}" in text
    assert held.manifest()["state"] == "pending"


def test_outputs_that_cannot_be_written_fail_with_a_clear_message(folder: Path) -> None:
    run = fake_training.make(folder / "run")
    (run.path / lock.FOLDER).touch()  # where the lock's folder should be: nothing can be written there
    result, _ = carry_out([run])
    assert "cannot be locked" in (run.path / "train" / "log.txt").read_text()
    assert result.exit_code == 1


@pytest.mark.slow
def test_a_run_that_is_removed_meanwhile_costs_no_other(folder: Path) -> None:
    gone = fake_training.make(folder / "gone", step_s=0.05)
    good = fake_training.make(folder / "good", step_s=0.05)
    process = start_sweep(folder)
    until(lambda: under_way([gone, good]) == 2)
    shutil.rmtree(gone.path, ignore_errors=True)
    output, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 1, output
    assert f"failed: {gone.path}: " in output
    assert good.manifest()["state"] == "complete"
    shutil.rmtree(gone.path, ignore_errors=True)


@pytest.mark.slow
def test_a_worker_computes_with_one_thread(folder: Path) -> None:
    run = fake_training.make(folder / "run")
    backend = LocalBackend(1, target="tests.fake_training:report_threads", preload=("torch",))
    assert sweep([run], backend, Console(file=io.StringIO())).exit_code == 0
    assert json.loads((run.path / "threads.json").read_text()) == {"torch": 1, "OMP_NUM_THREADS": "1"}


def test_a_worker_whose_run_is_renamed_ends_with_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = fake_training.make(folder / "before")

    monkeypatch.setattr(worker.path_safety, "refuse_links", lambda path: path.rename(folder / "after"))
    assert worker.work(run.path, log=True) == 1
    error = capsys.readouterr().err
    assert error == f"auvbench: {folder / 'before'}: was renamed or removed; this process stops\n"


@pytest.fixture
def endless(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mark that appears when the fork server imports the module `endless`, which takes for ever."""
    modules = tmp_path_factory.mktemp("modules")
    mark = modules / "mark"
    (modules / "endless.py").write_text(
        f"import pathlib, signal\npathlib.Path({str(mark)!r}).touch()\nsignal.pause()"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(modules)]))
    return mark


def test_an_interrupted_sweep_does_not_wait_for_imports(folder: Path, endless: Path) -> None:
    runs = [fake_training.make(folder / f"run{number}") for number in range(3)]
    backend = LocalBackend(2, target=TARGET, preload=("endless",))
    jobs = [backend.submit(run.path) for run in runs[:2]]
    until(lambda: backend.wait(0.02) or endless.exists())
    for job in jobs:
        job.cancel()
    assert [job.poll().code for job in jobs] == [128 + signal.SIGTERM] * 2
    found = [judge(run, job, job.poll(), cancelled=True) for run, job in zip(runs, jobs, strict=False)]
    backend.close()
    assert found == [(Outcome.INTERRUPTED, "stopped before it started")] * 2
    assert [run.manifest()["state"] for run in runs] == ["pending"] * 3


IMPORTING = SWEEP.replace("preload=()", 'preload=("endless",)')


@pytest.mark.slow
def test_a_killed_sweep_leaves_no_server_that_imports(folder: Path, endless: Path) -> None:
    fake_training.make(folder / "ppo-a")
    process = subprocess.Popen([sys.executable, "-c", IMPORTING, str(folder)], start_new_session=True)
    until(endless.exists)
    left = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.wait()
    until(lambda: not any(lives(child) for child in left))


def lives(process: psutil.Process) -> bool:
    try:
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
