"""Let only one process work on a run, by a kernel lock and a file that names the process that holds the lock.

The lock is a `flock` on `RUN/lock/held`; on NFS, the file server keeps it. The kernel or the file server frees the
lock when the process that holds it ends, for any reason. Which process may work on a run therefore never depends on
clocks, host names or process ids.

`RUN/lock/holder.json` names the holder. On a file system without `flock`, locking a run raises an error.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shlex
import sys
import time
import uuid
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.errors import RunError, TrainingError

try:
    import fcntl
except ModuleNotFoundError as _error:
    raise RunError("runs need file locks of POSIX (fcntl), which Windows does not have; use WSL") from _error

from auvbench.runs import interruption
from auvbench.runs.atomic_io import FAULTS, as_json, storage_error, write_atomic
from auvbench.untrusted import path_safety, typed_json
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    from filelock import BaseFileLock


def state_folder() -> Path:
    """Return the user's folder for files that auvbench keeps between commands."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.join(os.path.expanduser("~"), ".local", "state")
    return Path(state, "auvbench")


FOLDER, LOCK, HOLDER = "lock", "held", "holder.json"

LEASE = 120.0  # s, longest time that a file server keeps the lock of a dead node (NFSv4: 90 s by default)
LOOK = 10.0  # s to wait for the lock while another process only checks it (`living_holder`), which takes an instant

_NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP)


@dataclass(frozen=True, slots=True)
class Holder:
    """Process that holds the lock of a run."""

    host: str
    pid: int
    since: str  # ISO 8601 with a time zone
    command: str
    token: str  # unique for each acquisition; empty if holder.json is damaged
    job: str | None = None  # job of the cluster, for example "slurm:17"
    path: str = field(default="", compare=False)  # path of holder.json, if it was read

    def __str__(self) -> str:
        if not self.token:
            file = shlex.quote(self.path)
            return f"an unknown process (holder unknown, see {file}; remove that file if no process works on the run)"
        job = f", {short(self.job).replace(':', ' job ')}" if self.job else ""
        return f"{short(self.host)}, pid {self.pid}{job}, since {self.since} ({short(self.command, 80)})"


class RunHeldError(RunError):
    """Another process works on the run. Exit code 1: the command line is correct."""

    exit_code = 1

    def __init__(self, run: Path, holder: Holder, message: str = "") -> None:
        super().__init__(message or f"{run} is locked by {holder}; skipped")
        self.run = run
        self.holder = holder


class LockLostError(TrainingError):
    """This process has lost its lock: the run's folder was replaced, or the file server gave the lock to another process."""


class RunLock:
    """A lock that this process holds. Use `with lock.acquire(run) as held:`."""

    def __init__(self, run: Path, holder: Holder, kernel_lock: BaseFileLock) -> None:
        self.run = run
        self.holder = holder
        self._kernel_lock = kernel_lock
        self._verified = time.monotonic()
        _mine[run.absolute()] = self

    def verify(self, every: float = 0.0) -> None:
        """Raise `LockLostError` if this process no longer holds the lock.

        Args:
            every: seconds between checks; do nothing if the last check was more recent.
        """
        now = time.monotonic()
        if now - self._verified < every:
            return
        self._verified = now
        holder = current(self.run)
        # The token is '' if holder.json cannot be read at the moment.
        if holder is None or holder.token not in ("", self.holder.token):
            why = f"{holder} has taken it over" if holder else "its lock was removed"
            raise LockLostError(f"{self.run}: {why}; this process stops without writing more")

    def release(self) -> None:
        """Free the lock. A second call does nothing."""
        if _mine.get(self.run.absolute()) is self:
            del _mine[self.run.absolute()]
        with contextlib.suppress(OSError):
            holder = current(self.run)
            if holder is not None and holder.token == self.holder.token:
                _holder_path(self.run).unlink(missing_ok=True)
        self._kernel_lock.release()

    def __enter__(self) -> RunLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


_mine: dict[Path, RunLock] = {}
"""Locks of this process by run, for code that writes into a run but has no reference to the run's lock."""


def acquire(run: str | Path, *, job: str | None = None) -> RunLock:
    """Lock the run for this process.

    Args:
        run: the run directory.
        job: cluster job of this process. If holder.json names the same job, an earlier attempt of the job has probably
            died with its node. Then wait up to `LEASE` for the file server to free the lock of that attempt.

    Raises:
        RunHeldError: another process holds the lock.
        RunError: the directory cannot be written, contains a link, or is on a file system without locks.
        TrainingError: the disk is full or failing.
    """
    run = Path(run)
    path_safety.refuse_links(run)
    before = current(run)
    requeued = job is not None and before is not None and before.job == job
    try:
        (run / FOLDER).mkdir(exist_ok=True)
        kernel_lock = _kernel_lock(run, LEASE if requeued else 0.0)
        holder = _myself(job)
        named = as_json({key: value for key, value in asdict(holder).items() if key != "path"})
        try:
            write_atomic(_holder_path(run), named, sync_folder=False)
        except BaseException:
            kernel_lock.release()
            raise
    except OSError as error:
        if error.errno in FAULTS:
            raise storage_error(error, f"cannot lock {run}") from error
        hint = "; use an output folder on a file system with flock" if error.errno in _NO_LOCKS else ""
        raise RunError(f"{run} cannot be locked: {error.strerror or error}{hint}") from error
    return RunLock(run, holder, kernel_lock)


def verify(run: str | Path, every: float = 0.0) -> None:
    """Call `RunLock.verify` for the lock of this process on a run; do nothing if this process has no lock on it."""
    if (own := _mine.get(Path(run).absolute())) is not None:
        own.verify(every)


def current(run: str | Path) -> Holder | None:
    """Return the holder that holder.json names, even if the holder has ended; None if the file does not exist.

    If the file is damaged, the holder is unknown and has the token ''.
    """
    path = _holder_path(Path(run))
    try:
        holder = typed_json.read(path, Holder, 1 << 16)
        if datetime.fromisoformat(holder.since).tzinfo is None:
            raise ValueError("a time without a zone")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError):
        return _unknown(Path(run))
    return replace(holder, path=str(path))


def living_holder(run: str | Path) -> Holder | None:
    """Return the process that holds the lock of a run; None if no process holds it."""
    run = Path(run)
    holder = current(run)
    if holder is None or _is_locked(run / FOLDER / LOCK):
        return holder
    return None


def _is_locked(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:  # Locked, or the file system has no locks: then trust holder.json.
        return True
    finally:
        os.close(descriptor)
    return False


class _MovedError(Exception):
    """The run's folder was renamed between opening its lock file and locking it."""


def _kernel_lock(run: Path, patience: float) -> BaseFileLock:
    """Take the kernel's lock.

    Args:
        run: the run directory.
        patience: seconds to wait while another process holds the lock.

    Raises:
        RunHeldError: another process holds the lock.
        OSError: the file system has no locks.
    """
    import filelock

    path = run / FOLDER / LOCK

    def check(descriptor: int) -> None:
        if not os.path.samestat(os.fstat(descriptor), os.stat(path)):
            raise _MovedError

    lock = filelock.FileLock(path, timeout=0, thread_local=False, fallback_to_soft=False, on_acquired=check)
    began = time.monotonic()
    while True:
        try:
            lock.acquire()
            return lock
        except _MovedError:
            continue
        except filelock.Timeout as error:
            limit = patience if _is_locked(path) else max(patience, LOOK)
            if time.monotonic() - began >= limit:
                raise RunHeldError(run, current(run) or _unknown(run)) from error
            time.sleep(0.02)


def _myself(job: str | None) -> Holder:
    return Holder(
        host=interruption.host(),
        pid=os.getpid(),
        since=datetime.now(UTC).isoformat(timespec="seconds"),
        command=short(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])),
        token=uuid.uuid4().hex,
        job=job,
    )


def _unknown(run: Path) -> Holder:
    return Holder("", 0, "", "", "", path=str(_holder_path(run)))


def _holder_path(run: Path) -> Path:
    return run / FOLDER / HOLDER
