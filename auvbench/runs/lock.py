"""One process per run directory, also on network file systems and after any kind of death.

How the lock lies on disk, and why only one can take it: lock_files.py.

When is a holder dead?

* On this machine: when no process with its pid and its start mark lives.
* Elsewhere: when it has not touched its file for `STALE_AFTER` seconds, both times read from the file
  server's clock (we touch a file too and compare), and then does not touch it either while we watch, timed by
  our monotonic clock. So a clock that jumps, here or on the server, never costs a living holder its run.
* The same cluster job in an earlier life (a requeue): the same, without waiting for `STALE_AFTER`.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from types import TracebackType

from auvbench.errors import RunError, TrainingError
from auvbench.runs import lock_files, processes
from auvbench.runs.lock_files import Holder
from auvbench.untrusted import path_safety

HEARTBEAT = 10.0  # s between two touches of a held lock
STALE_AFTER = 300.0  # s without a touch after which a holder on another machine is suspected dead
WATCH = 3 * HEARTBEAT  # s that a suspect is watched before its lock is taken over


class RunHeldError(RunError):
    """Somebody else works on the run; it is left alone."""

    def __init__(self, run: Path, holder: Holder) -> None:
        super().__init__(f"{run} is held by {holder}; left alone")
        self.run = run
        self.holder = holder


class LockLostError(TrainingError):
    """The run was taken over while this process stood still (a suspended machine, an unreachable server)."""


@dataclass(slots=True)
class RunLock:
    """A held lock. Use `with lock.acquire(run) as held:`; a thread of it touches the file meanwhile."""

    run: Path
    generation: int
    holder: Holder
    heartbeat: float = HEARTBEAT
    _released: threading.Event = field(default_factory=threading.Event)
    _lost: str | None = None

    @property
    def path(self) -> Path:
        return lock_files.file_of(self.run, self.generation)

    def verify(self, *, look: bool = True) -> None:
        """Raises `LockLostError` when the run belongs to somebody else by now.

        Args:
            look: at the file server, before something important is written; without it, the last heartbeat's
                look has to do, which costs nothing.
        """
        if look:
            self._look()
        if self._lost is not None:
            raise LockLostError(self._lost)

    def release(self) -> None:
        """Frees the lock; does nothing the second time, or when it was lost."""
        if self._released.is_set():
            return
        self._released.set()
        _mine.pop(self.run.absolute(), None)
        with contextlib.suppress(OSError):
            if lock_files.highest(self.run) == self.generation:
                lock_files.release(self.run, self.generation, self.holder)

    def __enter__(self) -> RunLock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def _look(self) -> None:
        highest = lock_files.highest(self.run)
        if highest == self.generation:
            return
        other = lock_files.read(self.run, highest) if highest else None
        taker = f"{other[0]} has taken it over" if other and other[0] else "its lock was removed"
        self._lost = f"{self.run}: {taker} while this process stood still; it stops without writing more"

    def _beat(self) -> None:
        while not self._released.wait(self.heartbeat):
            # A server that does not answer for a while is no reason to stop: the next touch may succeed.
            with contextlib.suppress(OSError):
                os.utime(self.path)  # "now" is the file server's, not ours
            with contextlib.suppress(OSError):
                self._look()


def acquire(
    run: str | Path,
    *,
    job: str | None = None,
    gone: str | None = None,
    heartbeat: float = HEARTBEAT,
    stale_after: float = STALE_AFTER,
    watch: float = WATCH,
) -> RunLock:
    """Takes the run's lock, over from a dead holder if need be.

    Args:
        run: the run directory.
        job: the cluster job that this process is, if any; an earlier life of the same job is suspected at once.
        gone: a cluster job that the cluster says has ended; its lock is taken over without more ado.
        heartbeat: seconds between two touches.
        stale_after: seconds without a touch after which a holder on another machine is suspected dead.
        watch: seconds that a suspect is watched.

    Raises:
        RunHeldError: a living process holds it.
        RunError: the directory cannot be written, or a link in it leads out of it.
    """
    run = Path(run)
    path_safety.check(run)  # whoever holds a run's lock writes into it
    mine = Holder(
        host=processes.host(),
        pid=os.getpid(),
        started=processes.start_mark(os.getpid()) or "",
        machine=processes.machine(),
        since=datetime.now(UTC).isoformat(timespec="seconds"),
        token=uuid.uuid4().hex,
        job=job,
    )
    try:
        while True:
            last = lock_files.highest(run)
            if last and not _may_take(run, last, job, gone, stale_after, watch):
                holder = current(run)
                if holder is None:  # released while we looked
                    continue
                raise RunHeldError(run, holder)
            if lock_files.create(run, last + 1, mine):
                break
    except OSError as error:
        raise RunError(f"{run} cannot be locked: {error.strerror or error}") from error
    held = RunLock(run, last + 1, mine, heartbeat)
    for generation in lock_files.generations(run):
        if generation < held.generation:
            lock_files.file_of(run, generation).unlink(missing_ok=True)
    _mine[run.absolute()] = held
    threading.Thread(target=held._beat, name="run-lock", daemon=True).start()
    return held


_mine: dict[Path, RunLock] = {}
"""The locks that this process holds, for those who write into a run without having been handed its lock."""


def verify(run: str | Path, *, look: bool = True) -> None:
    """As `RunLock.verify`, for the lock that this process took; does nothing when it took none."""
    held = _mine.get(Path(run).absolute())
    if held is not None:
        held.verify(look=look)


def current(run: str | Path) -> Holder | None:
    """Who the lock file names at present, alive or not; None when the run is free."""
    run = Path(run)
    last = lock_files.highest(run)
    found = lock_files.read(run, last) if last else None
    return None if found is None or found[0].free else found[0]


def living_holder(
    run: str | Path, *, clock: Callable[[Path], float] | None = None, stale_after: float = STALE_AFTER
) -> Holder | None:
    """Who holds the run, as far as one look can tell; None when it is free or its holder is dead.

    Args:
        run: the run directory.
        clock: tells the file server's time for a run; `shared_clock` asks it once for many runs.
        stale_after: as in `acquire`.
    """
    run = Path(run)
    last = lock_files.highest(run)
    found = lock_files.read(run, last) if last else None
    if found is None or found[0].free:
        return None
    holder, touched = found
    if holder.here:
        return holder if processes.start_mark(holder.pid) == holder.started else None
    age = (clock or server_time)(run) - touched
    return holder if abs(age) <= stale_after else None


def server_time(folder: Path) -> float:
    """The clock of the file server that `folder` lies on, in seconds of its epoch."""
    probe = folder / f".clock-{uuid.uuid4().hex}"
    try:
        probe.touch()
        return probe.stat().st_mtime
    except OSError:  # read-only: a look is all we can have then, and the local clock has to do
        return time.time()
    finally:
        with contextlib.suppress(OSError):
            probe.unlink()


def shared_clock() -> Callable[[Path], float]:
    """`server_time` that asks once for all runs of a folder."""
    ask = cache(server_time)
    return lambda run: ask(run.parent)


def _may_take(
    run: Path, generation: int, job: str | None, gone: str | None, stale_after: float, watch: float
) -> bool:
    """Whether the lock of this generation is free or its holder dead."""
    found = lock_files.read(run, generation)
    if found is None:  # somebody newer cleaned it away: look again
        return lock_files.highest(run) == generation
    holder, touched = found
    if holder.free or (gone is not None and holder.job == gone):
        return True
    if holder.here:
        return processes.start_mark(holder.pid) != holder.started
    # A touch "in the future" means that a clock jumped back: age says nothing then, only watching does.
    suspect = abs(server_time(run) - touched) > stale_after or (job is not None and holder.job == job)
    return suspect and not _stirs(run, generation, touched, watch)


def _stirs(run: Path, generation: int, touched: float, watch: float) -> bool:
    deadline = time.monotonic() + watch
    while time.monotonic() < deadline:
        time.sleep(min(1.0, watch / 10))
        found = lock_files.read(run, generation)
        if found is None or found[0].free:
            return False
        if found[1] != touched:
            return True
    return False
