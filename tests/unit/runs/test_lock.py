"""Locks: one holder, clear words for the second, take-over from the dead only, whatever the clocks do."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from auvbench.errors import RunError
from auvbench.runs import lock, lock_files, processes

QUICK = {"stale_after": 60.0, "watch": 0.3, "heartbeat": 0.05}


def leave_foreign_lock(run: Path, age: float, *, job: str | None = None) -> lock_files.Holder:
    """As a process on another machine would have left it, last touched `age` seconds ago."""
    with lock.acquire(run) as held:
        holder = replace(held.holder, host="node7", machine="another boot", pid=1, job=job)
        generation = held.generation
    file = run / lock_files.FOLDER / f"{generation + 1:06d}"
    file.write_text(json.dumps(asdict(holder)))
    touched = time.time() - age
    os.utime(file, (touched, touched))
    return holder


def hold_elsewhere(run: Path) -> subprocess.Popen[str]:
    """Another process of this machine that holds the run until it is killed."""
    code = f"from auvbench.runs import lock; lock.acquire({str(run)!r}); print('held', flush=True); import time; time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def test_release_frees_and_can_be_repeated(tmp_path: Path) -> None:
    for _ in range(3):
        held = lock.acquire(tmp_path)
        assert lock.current(tmp_path) == held.holder
        held.release()
        held.release()
        assert lock.current(tmp_path) is None
    assert len(list((tmp_path / lock_files.FOLDER).iterdir())) == 1  # nothing piles up


def test_the_second_says_who_holds_it(tmp_path: Path) -> None:
    process = hold_elsewhere(tmp_path)
    try:
        with pytest.raises(lock.RunHeldError) as caught:
            lock.acquire(tmp_path)
        for word in (str(tmp_path), processes.host(), f"pid {process.pid}", "since 20"):
            assert word in str(caught.value)
        assert lock.living_holder(tmp_path) is not None
    finally:
        process.kill()
        process.wait()


def test_a_killed_holder_is_replaced_at_once(tmp_path: Path) -> None:
    process = hold_elsewhere(tmp_path)
    process.send_signal(signal.SIGKILL)
    # Not collected yet: a zombie holds nothing either.
    deadline = time.monotonic() + 10
    while processes.start_mark(process.pid) is not None:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert lock.living_holder(tmp_path) is None
    with lock.acquire(tmp_path):
        pass
    process.wait()


def test_a_recycled_pid_is_another_process(tmp_path: Path) -> None:
    with lock.acquire(tmp_path) as held:
        file = held.path
        text = json.dumps(asdict(replace(held.holder, started="1")))
    file.write_text(text)  # our own pid, started at another time
    assert lock.living_holder(tmp_path) is None
    lock.acquire(tmp_path).release()


def test_a_fresh_foreign_lock_is_left_alone(tmp_path: Path) -> None:
    holder = leave_foreign_lock(tmp_path, age=20)
    assert lock.living_holder(tmp_path) == holder
    with pytest.raises(lock.RunHeldError, match="node7"):
        lock.acquire(tmp_path, **QUICK)


def test_a_silent_foreign_lock_is_taken_over(tmp_path: Path) -> None:
    leave_foreign_lock(tmp_path, age=120)
    assert lock.living_holder(tmp_path, stale_after=60) is None
    with lock.acquire(tmp_path, **QUICK) as held:
        assert lock.current(tmp_path) == held.holder


def test_an_old_touch_of_a_holder_that_still_stirs_is_no_death(tmp_path: Path) -> None:
    """The file server's clock jumped forwards: the lock looks old until its holder touches it again."""
    leave_foreign_lock(tmp_path, age=3600)
    file = max((tmp_path / lock_files.FOLDER).iterdir())
    context = multiprocessing.get_context("spawn")
    toucher = context.Process(target=touch_for, args=(file, 3.0))
    toucher.start()
    try:
        while file.stat().st_mtime < time.time() - 60:
            time.sleep(0.01)
        os.utime(file, (1.0, 1.0))
        with pytest.raises(lock.RunHeldError):
            lock.acquire(tmp_path, stale_after=60.0, watch=2.0)
    finally:
        toucher.kill()
        toucher.join()


def touch_for(file: Path, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        os.utime(file)
        time.sleep(0.1)


def test_a_touch_in_the_future_is_watched_not_believed(tmp_path: Path) -> None:
    """The clock jumped backwards after the holder died: its lock must not live until the clock catches up."""
    leave_foreign_lock(tmp_path, age=-7200)
    with lock.acquire(tmp_path, **QUICK):
        pass


def test_a_clock_that_jumps_back_costs_a_local_holder_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = hold_elsewhere(tmp_path)
    try:
        monkeypatch.setattr(time, "time", lambda: 1.0)
        os.utime(max((tmp_path / lock_files.FOLDER).iterdir()), (1.0, 1.0))
        with pytest.raises(lock.RunHeldError):
            lock.acquire(tmp_path, **QUICK)
    finally:
        process.kill()
        process.wait()


def test_a_requeued_job_does_not_wait_for_its_own_ghost(tmp_path: Path) -> None:
    leave_foreign_lock(tmp_path, age=5, job="slurm:17")
    with pytest.raises(lock.RunHeldError, match="slurm job 17"):
        lock.acquire(tmp_path, job="slurm:18", **QUICK)
    lock.acquire(tmp_path, job="slurm:17", **QUICK).release()


def test_a_job_that_the_cluster_calls_gone_holds_nothing(tmp_path: Path) -> None:
    leave_foreign_lock(tmp_path, age=0, job="slurm:17")
    lock.acquire(tmp_path, gone="slurm:17").release()


def test_a_holder_that_stood_still_learns_that_it_lost(tmp_path: Path) -> None:
    held = lock.acquire(tmp_path, heartbeat=0.02)
    held.verify()
    text = json.dumps(asdict(replace(held.holder, host="node7", token="other")))
    (tmp_path / lock_files.FOLDER / f"{held.generation + 1:06d}").write_text(text)
    with pytest.raises(lock.LockLostError, match="node7"):
        held.verify()
    held.release()
    assert lock.current(tmp_path) is not None  # it did not free what is not its own


def test_a_damaged_lock_is_judged_by_its_touches(tmp_path: Path) -> None:
    (tmp_path / lock_files.FOLDER).mkdir()
    file = tmp_path / lock_files.FOLDER / "000004"
    file.write_text("{")
    with pytest.raises(lock.RunHeldError, match=r"its lock file is damaged.*rm .*000004 releases it"):
        lock.acquire(tmp_path, **QUICK)
    os.utime(file, (1.0, 1.0))
    lock.acquire(tmp_path, **QUICK).release()


def test_removing_a_damaged_lock_releases_the_run(tmp_path: Path) -> None:
    (tmp_path / lock_files.FOLDER).mkdir()
    file = tmp_path / lock_files.FOLDER / "000004"
    file.write_bytes(b"\x00" * 200)
    with pytest.raises(lock.RunHeldError, match=r"rm (\S+) releases it") as caught:
        lock.acquire(tmp_path, **QUICK)
    assert str(file) in str(caught.value)
    file.unlink()
    lock.acquire(tmp_path, **QUICK).release()


def test_the_heartbeat_touches_the_file(tmp_path: Path) -> None:
    with lock.acquire(tmp_path, heartbeat=0.02) as held:
        os.utime(held.path, (1.0, 1.0))
        deadline = time.monotonic() + 10
        while held.path.stat().st_mtime == 1.0:
            assert time.monotonic() < deadline
            time.sleep(0.01)


def test_a_directory_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    file = tmp_path / "no-directory"
    file.touch()
    with pytest.raises(RunError, match="cannot be locked"):
        lock.acquire(file)


def contend(run: str, turns: int, answers: multiprocessing.Queue) -> None:  # type: ignore[type-arg]
    """Takes the lock again and again; inside, two processes at once would lose an increment."""
    counter = Path(run, "counter")
    for _ in range(turns):
        while True:
            try:
                held = lock.acquire(run)
                break
            except lock.RunHeldError:
                time.sleep(0.001)
        value = int(counter.read_text())
        time.sleep(0.0005)
        counter.write_text(str(value + 1))
        held.release()
    answers.put(os.getpid())


def test_contenders_never_share_it(tmp_path: Path) -> None:
    (tmp_path / "counter").write_text("0")
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    contenders = [context.Process(target=contend, args=(str(tmp_path), 25, answers)) for _ in range(4)]
    for process in contenders:
        process.start()
    for process in contenders:
        process.join(60)
        assert process.exitcode == 0
    assert (tmp_path / "counter").read_text() == "100"


def take_over(run: str, start: float, answers: multiprocessing.Queue) -> None:  # type: ignore[type-arg]
    time.sleep(max(0.0, start - time.time()))
    try:
        lock.acquire(run, stale_after=60.0, watch=0.1)
        answers.put("took")
        time.sleep(1.5)
    except lock.RunHeldError:
        answers.put("left")


def test_of_many_heirs_of_a_dead_holder_one_takes_over(tmp_path: Path) -> None:
    leave_foreign_lock(tmp_path, age=120)
    context = multiprocessing.get_context("spawn")
    answers = context.Queue()
    start = time.time() + 1.5
    heirs = [context.Process(target=take_over, args=(str(tmp_path), start, answers)) for _ in range(5)]
    for heir in heirs:
        heir.start()
    said = sorted(answers.get(timeout=60) for _ in heirs)
    for heir in heirs:
        heir.join()
    assert said == ["left"] * 4 + ["took"]
