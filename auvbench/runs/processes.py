"""Identify a process by its pid and start time, and end processes together with another one."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

_PR_SET_PDEATHSIG = 1
_STARTTIME = 19  # field 22 of /proc/PID/stat, counted from the state (field 3), see proc(5)


def host() -> str:
    return socket.gethostname()


def start_mark(pid: int) -> str | None:
    """A mark that no other process with the same pid has; None when there is no such living process.

    A zombie counts as dead: it holds nothing any more, and in a container without an init nobody may ever
    collect it.
    """
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return _portable_start_mark(pid) if not sys.platform.startswith("linux") else None
    except OSError:  # ESRCH: it ended while we read
        return None
    fields = text.rpartition(")")[2].split()  # the command before it may hold blanks and brackets
    return None if fields[0] in "ZX" else fields[_STARTTIME]


def _portable_start_mark(pid: int) -> str | None:
    import psutil

    try:
        process = psutil.Process(pid)
        return None if process.status() == psutil.STATUS_ZOMBIE else repr(process.create_time())
    except psutil.Error:
        return None


def die_with_parent(parent: int) -> None:
    """Asks the kernel to kill this process when the thread of `parent` that forked it ends (Linux only)."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before we asked
        os.kill(os.getpid(), signal.SIGKILL)


def die_with(pid: int, mark: str) -> None:
    """Kills this process when another one ends, be it its parent or not, however that ends.

    For those whose parent is not the one they work for: the workers of a fork server outlive the process that
    asked for them, since they themselves hold open what the server waits for.

    Args:
        pid: the process to die with.
        mark: its `start_mark`, so that nobody who was given the same pid later is waited for.
    """
    threading.Thread(target=_outlive_not, args=(pid, mark), name="die-with", daemon=True).start()


def myself() -> tuple[int, str]:
    """This process as `die_with` asks for it."""
    return os.getpid(), start_mark(os.getpid()) or ""


@contextmanager
def killed(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes are killed at the end of the context, whatever they do then."""
    try:
        yield pool
    finally:
        for process in list((pool._processes or {}).values()):
            process.kill()
        pool.shutdown(wait=False, cancel_futures=True)


def _outlive_not(pid: int, mark: str) -> None:
    try:
        end = os.pidfd_open(pid)  # told at once by the kernel
    except (AttributeError, OSError):  # not Linux, or gone already
        end = None
    while start_mark(pid) == mark:
        if end is None:
            time.sleep(_LOOK)
        else:
            select.select([end], [], [])
    os.kill(os.getpid(), signal.SIGKILL)


_LOOK = 0.2  # s between two looks where the kernel does not tell


def prefer_in_memory_shortage() -> None:
    """Tells the kernel to kill this process before those that watch over it when memory runs out."""
    try:
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")
    except OSError:  # not Linux, or not allowed: then the kernel's own choice stands
        return
