"""Locks: one holder, a clear message for the second, and a lock that ends with its holder."""

from __future__ import annotations

import errno
import fcntl
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from auvbench.errors import AuvbenchError, RunError
from auvbench.runs import interruption, lock
from tests.waiting import LIMIT

HOLD = """
import os, sys, time
from auvbench.runs import lock
from auvbench.runs import interruption
run, host, job, forks = sys.argv[1:]
if host: interruption.host = lambda: host
held = lock.acquire(run, job=job or None)
# A child says so itself: it lets go of the lock a moment after the fork.
if not forks or os.fork() == 0:
    print("held", flush=True)
time.sleep(600)
"""


def hold_elsewhere(run: Path, *, host: str = "", job: str = "", forks: bool = False) -> subprocess.Popen[str]:
    """Start another process that holds the run until it is killed."""
    words = [sys.executable, "-c", HOLD, str(run), host, job, "yes" if forks else ""]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def no_flock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file system without kernel locks."""

    def flock(*_: object) -> None:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))

    monkeypatch.setattr(fcntl, "flock", flock)


def test_release_frees_and_can_be_repeated(tmp_path: Path) -> None:
    for _ in range(3):
        held = lock.acquire(tmp_path)
        assert lock.current(tmp_path) == lock.living_holder(tmp_path) == held.holder
        held.release()
        held.release()
        assert lock.current(tmp_path) is None
    assert [path.name for path in (tmp_path / lock.FOLDER).iterdir()] == [lock.LOCK]  # nothing piles up


def test_the_second_learns_who_holds_it(tmp_path: Path) -> None:
    process = hold_elsewhere(tmp_path)
    try:
        with pytest.raises(lock.RunHeldError) as caught:
            lock.acquire(tmp_path)
        assert caught.value.holder.pid == process.pid
        assert caught.value.exit_code == 1
        for word in (str(tmp_path), interruption.host(), f"pid {process.pid}", "since 20"):
            assert word in str(caught.value)
        assert lock.living_holder(tmp_path) == caught.value.holder
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize("host", ["", "the-name-of-yesterday"])
def test_a_killed_holder_is_replaced_at_once_whatever_its_host_was_called(tmp_path: Path, host: str) -> None:
    process = hold_elsewhere(tmp_path, host=host)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert lock.current(tmp_path) is not None
    assert lock.living_holder(tmp_path) is None
    with lock.acquire(tmp_path):
        pass


def test_a_child_of_a_killed_holder_holds_nothing(tmp_path: Path) -> None:
    process = hold_elsewhere(tmp_path, forks=True)
    try:
        process.send_signal(signal.SIGKILL)
        process.wait()
        lock.acquire(tmp_path).release()
    finally:
        os.killpg(process.pid, signal.SIGKILL)  # the child


def test_a_requeued_job_waits_for_its_own_earlier_life_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = hold_elsewhere(tmp_path, job="slurm:17")
    waits = threading.Event()
    flock = fcntl.flock

    def noted(*arguments: Any) -> None:
        try:
            flock(*arguments)
        except BlockingIOError:
            waits.set()
            raise

    taken: list[lock.RunLock] = []
    try:
        with pytest.raises(lock.RunHeldError, match="slurm job 17"):
            lock.acquire(tmp_path, job="slurm:18")
        monkeypatch.setattr(fcntl, "flock", noted)
        heir = threading.Thread(target=lambda: taken.append(lock.acquire(tmp_path, job="slurm:17")))
        heir.start()
        assert waits.wait(LIMIT)
    finally:
        process.kill()  # the file server notices the death of the node
        process.wait()
    heir.join(LIMIT)
    assert lock.living_holder(tmp_path) == taken[0].holder
    taken[0].release()


def rename_at_the_first_flock(monkeypatch: pytest.MonkeyPatch, rename: Callable[[], None]) -> None:
    flock = fcntl.flock

    def renamed(*arguments: Any) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        rename()
        flock(*arguments)

    monkeypatch.setattr(fcntl, "flock", renamed)


def test_the_lock_of_a_run_that_was_renamed_meanwhile_is_not_that_of_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    lock.acquire(run).release()
    holders: list[subprocess.Popen[str]] = []

    def rename() -> None:
        """The folder makes room for a new one of the same name, which another process holds."""
        run.rename(tmp_path / "old")
        run.mkdir()
        holders.append(hold_elsewhere(run))

    rename_at_the_first_flock(monkeypatch, rename)
    try:
        with pytest.raises(lock.RunHeldError):
            lock.acquire(run)
    finally:
        holders[0].kill()
        holders[0].wait()


def test_a_run_that_vanished_meanwhile_cannot_be_locked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    run.mkdir()
    rename_at_the_first_flock(monkeypatch, lambda: run.rename(tmp_path / "old") and None)
    with pytest.raises(RunError, match="cannot be locked"):
        lock.acquire(run)


def test_a_holder_whose_run_was_replaced_learns_it(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    held = lock.acquire(run)
    held.verify()
    run.rename(tmp_path / "old")
    with pytest.raises(lock.LockLostError, match="was removed"):
        held.verify()
    run.mkdir()
    process = hold_elsewhere(run)
    try:
        with pytest.raises(lock.LockLostError, match=f"pid {process.pid}"):
            held.verify()
        held.release()
        assert lock.living_holder(run) is not None  # it did not free what is not its own
    finally:
        process.kill()
        process.wait()


def test_a_holder_file_that_cannot_be_read_is_no_loss(tmp_path: Path) -> None:
    with lock.acquire(tmp_path) as held:
        (tmp_path / lock.FOLDER / lock.HOLDER).write_text("{")
        held.verify()


def test_a_look_may_be_left_out(tmp_path: Path) -> None:
    with lock.acquire(tmp_path):
        (tmp_path / lock.FOLDER / lock.HOLDER).unlink()
        lock.verify(tmp_path, every=600.0)
        with pytest.raises(lock.LockLostError):
            lock.verify(tmp_path)
        lock.verify(tmp_path / "another")


@pytest.mark.usefixtures("no_flock")
def test_a_file_system_without_locks_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="use an output folder on a file system with flock") as caught:
        lock.acquire(tmp_path)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_code == 2
    assert lock.living_holder(tmp_path) is None


@pytest.mark.parametrize(("number", "code"), [(errno.ENOSPC, 1), (errno.EACCES, 2)])
def test_a_disk_that_fails_leaves_nothing_held_and_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, code: int
) -> None:
    def fails(_: int) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fails)
        with pytest.raises(AuvbenchError) as caught:
            lock.acquire(tmp_path)
    assert caught.value.exit_code == code
    assert {path.name for path in (tmp_path / lock.FOLDER).iterdir()} <= {lock.LOCK}
    lock.acquire(tmp_path).release()


def test_a_directory_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    file = tmp_path / "no-directory"
    file.touch()
    with pytest.raises(RunError, match="cannot be locked"):
        lock.acquire(file)


@pytest.mark.parametrize("key", ["host", "since", "command", "job"])
def test_no_text_of_a_holder_reaches_the_terminal_as_it_is(tmp_path: Path, key: str) -> None:
    file = tmp_path / lock.FOLDER / lock.HOLDER
    with lock.acquire(tmp_path):
        data = json.loads(file.read_text())
        file.write_text(json.dumps({**data, key: f"\x1b[31m\n{'a' * 9999}"}))
        with pytest.raises(lock.RunHeldError) as caught:
            lock.acquire(tmp_path)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 1000


def contend(run: str, turns: int) -> None:
    """Take the lock again and again; inside, two processes at once would lose an increment."""
    counter = Path(run, "counter")
    for _ in range(turns):
        while True:
            try:
                held = lock.acquire(run)
                break
            except lock.RunHeldError:
                continue
        value = int(counter.read_text())
        time.sleep(0.0005)
        counter.write_text(str(value + 1))
        held.release()


@pytest.mark.slow
def test_contenders_never_share_it(tmp_path: Path) -> None:
    (tmp_path / "counter").write_text("0")
    context = multiprocessing.get_context("spawn")
    contenders = [context.Process(target=contend, args=(str(tmp_path), 25)) for _ in range(4)]
    for process in contenders:
        process.start()
    for process in contenders:
        process.join()
        assert process.exitcode == 0
    assert (tmp_path / "counter").read_text() == "100"


def take_over(run: str, together: Any, all_tried: Any, answers: Any) -> None:
    together.wait()
    try:
        held = lock.acquire(run)
    except lock.RunHeldError:
        held = None
    answers.put("took" if held else "left")
    all_tried.wait()


@pytest.mark.slow
def test_of_many_heirs_of_a_dead_holder_one_takes_over(tmp_path: Path) -> None:
    dead = hold_elsewhere(tmp_path)
    dead.kill()
    dead.wait()
    context = multiprocessing.get_context("spawn")
    answers, together, all_tried = context.Queue(), context.Barrier(5), context.Barrier(5)
    heirs = [
        context.Process(target=take_over, args=(str(tmp_path), together, all_tried, answers))
        for _ in range(5)
    ]
    for heir in heirs:
        heir.start()
    for heir in heirs:
        heir.join()
        assert heir.exitcode == 0
    assert sorted(answers.get() for _ in heirs) == ["left"] * 4 + ["took"]


@pytest.mark.slow
def test_a_look_at_a_dead_holder_costs_no_heir_the_run(tmp_path: Path) -> None:
    dead = hold_elsewhere(tmp_path)
    dead.kill()
    dead.wait()
    file = tmp_path / lock.FOLDER / lock.HOLDER
    text = file.read_text()
    ends = threading.Event()

    def look() -> None:
        while not ends.is_set():
            lock.living_holder(tmp_path)

    lookers = [threading.Thread(target=look) for _ in range(3)]
    for looker in lookers:
        looker.start()
    try:
        for _ in range(50):
            file.write_text(text)
            lock.acquire(tmp_path).release()
    finally:
        ends.set()
        for looker in lookers:
            looker.join()
