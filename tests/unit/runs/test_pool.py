"""Jobs in worker processes: deaths, errors, signals, and what is left behind."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from concurrent.futures import process
from pathlib import Path

import psutil
import pytest

from auvbench.errors import AuvbenchWarning, TrainingError
from auvbench.runs.interruption import SIGNALS
from auvbench.runs.pool import Pool, WorkerDiedError
from tests.waiting import until

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.usefixtures("own_fork_servers")


@pytest.fixture(autouse=True)
def workers_find_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))


def square(number: int) -> int:
    return number * number


def die(folder: Path, name: str, deaths: int) -> str:
    """Kill this process the first `deaths` times; then return the name."""
    mark = folder / name
    before = len(mark.read_text()) if mark.exists() else 0
    mark.write_text("x" * (before + 1))
    if before < deaths:
        os.kill(os.getpid(), signal.SIGKILL)
    return name


@pytest.mark.slow
def test_results_come_by_key_and_a_second_pool_follows_at_once() -> None:
    for _ in range(3):
        with Pool(2) as pool:
            jobs = {number: (number,) for number in range(5)}
            assert dict(pool.results(square, jobs, "square")) == {n: n * n for n in jobs}
            assert dict(pool.results(square, {7: (7,)}, "square")) == {7: 49}
        # A thread that is left would close its pipe while the end of Python writes to it.
        assert not [thread for thread in process._threads_wakeups if thread.is_alive()]


def test_an_error_of_a_job_is_raised_and_the_pool_goes_on() -> None:
    with Pool(2) as pool:
        with pytest.raises(ZeroDivisionError):
            dict(pool.results(divmod, {"bad": (1, 0), "good": (1, 1)}, "division"))
        assert dict(pool.results(divmod, {"good": (5, 2)}, "division")) == {"good": (2, 1)}


@pytest.mark.slow
def test_a_killed_worker_costs_no_result_and_is_reported(tmp_path: Path) -> None:
    jobs = {name: (tmp_path, name, deaths) for name, deaths in (("a", 0), ("b", 1), ("c", 0), ("d", 0))}
    with Pool(2) as pool, pytest.warns(AuvbenchWarning, match=r"killed.*\bb\b"):
        assert dict(pool.results(die, jobs, "job")) == {name: name for name in jobs}


@pytest.mark.slow
def test_a_job_that_kills_each_worker_is_named_and_costs_no_other(tmp_path: Path) -> None:
    jobs = {name: (tmp_path, name, deaths) for name, deaths in (("a", 0), ("b", 99), ("c", 0), ("d", 0))}
    with Pool(2) as pool, pytest.warns(AuvbenchWarning):
        found = dict(pool.results(die, jobs, "job"))
    assert isinstance(found["b"], WorkerDiedError)
    assert str(found["b"]).startswith("b: ")
    assert {name: found[name] for name in "acd"} == {"a": "a", "c": "c", "d": "d"}
    assert (tmp_path / "b").read_text() == "xx"


@pytest.mark.slow
def test_a_server_that_was_killed_is_replaced() -> None:
    with Pool(1) as pool:
        assert dict(pool.results(square, {1: (1,)}, "square")) == {1: 1}
        (worker, session, _, server) = dict(pool.results(describe, {0: ()}, "look"))[0]
        assert session == worker
        os.kill(server, signal.SIGKILL)
        until(lambda: not lives(worker), "the end of the worker")
        with pytest.warns(AuvbenchWarning):
            assert dict(pool.results(square, {2: (2,)}, "square")) == {2: 4}


def describe() -> tuple[int, int, list[int], int]:
    """Return pid, session, blocked signals and parent of this process."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    return os.getpid(), os.getsid(0), sorted(blocked), os.getppid()


def lives(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_signals_of_the_terminal_reach_neither_server_nor_workers() -> None:
    with Pool(1) as pool:
        worker, session, blocked, server = dict(pool.results(describe, {0: ()}, "look"))[0]
        assert (session, blocked) == (worker, [])
        line = next(
            line for line in Path(f"/proc/{server}/status").read_text().split("\n") if "SigBlk" in line
        )
        mask = int(line.split()[1], 16)
        assert all(mask & 1 << (number - 1) for number in SIGNALS)
    until(lambda: not lives(worker) and not lives(server), "the end of both")


def where() -> tuple[str, bool]:
    return os.getcwd(), "intruder" in sys.modules


def test_workers_have_the_folder_of_the_command_and_no_module_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "intruder.py").touch()
    monkeypatch.chdir(tmp_path)
    with Pool(1, ["intruder"]) as pool:
        assert dict(pool.results(where, {0: ()}, "look")) == {0: (str(tmp_path), False)}


def loaded() -> bool:
    """Whether this process has the compiled steps of an environment."""
    from auvbench.dynamics import kernel

    return bool(kernel.advance.signatures)


@pytest.mark.parametrize(
    ("preload", "expected"), [("auvbench.envs.batch", False), ("auvbench.envs.batch:load_compiled", True)]
)
def test_compiled_code_is_loaded_before_the_first_fork(preload: str, expected: bool) -> None:
    with Pool(1, [preload]) as pool:
        assert dict(pool.results(loaded, {0: ()}, "look")) == {0: expected}


COMMAND = """
import os, sys
from tests.unit.runs.test_pool import wait_for_ever
from auvbench.runs.pool import Pool
with Pool(2, sys.argv[2:]) as pool:
    list(pool.results(wait_for_ever, {n: (sys.argv[1], n) for n in range(2)}, "wait"))
"""


def wait_for_ever(folder: str, number: int) -> None:
    Path(folder, str(number)).write_text(str(os.getpid()))
    signal.pause()


@pytest.mark.slow
@pytest.mark.parametrize("importing", [True, False])
def test_a_killed_command_leaves_no_process(importing: bool, tmp_path: Path) -> None:
    modules, marks = tmp_path / "modules", tmp_path / "marks"
    modules.mkdir()
    marks.mkdir()
    (modules / "endless.py").write_text(
        f"import pathlib, signal\npathlib.Path({str(marks / 'importing')!r}).touch()\nsignal.pause()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, str(marks), *(["endless"] if importing else [])],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(modules)])},
        stderr=subprocess.DEVNULL,
    )
    wanted = {"importing"} if importing else {"0", "1"}
    until(lambda: {mark.name for mark in marks.iterdir() if mark.stat().st_size or importing} >= wanted)
    left = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    until(lambda: not any(lives(child.pid) for child in left), "the end of all processes")
    process.wait()


def test_without_semaphores_the_reason_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("auvbench.runs.pool.ProcessPoolExecutor", refused)
    with Pool(2) as pool, pytest.raises(TrainingError, match=r"Read-only file system.*/dev/shm"):
        dict(pool.results(divmod, {"one": (1, 1)}, "division"))
