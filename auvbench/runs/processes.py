"""Identify a process by its pid and start time, and end processes together with another one."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
from pathlib import Path

_PR_SET_PDEATHSIG = 1
_STARTTIME = 19  # field 22 of /proc/PID/stat, counted from the state (field 3), see proc(5)


def host() -> str:
    return socket.gethostname()


def start_mark(pid: int) -> str | None:
    """A mark that no other process with the same pid has; None when there is no such living process.

    A zombie counts as dead: it holds nothing any more, and in a container without an init no process may ever
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
    """Ask the kernel to kill this process when the thread of `parent` that forked it ends (Linux only)."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before we asked
        os.kill(os.getpid(), signal.SIGKILL)


def prefer_in_memory_shortage() -> None:
    """Ask the kernel to kill this process first when memory runs out, and spare the one that started it."""
    try:
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")
    except OSError:  # not Linux, or not allowed: then the kernel's own choice stands
        return


def cores() -> int:
    """Return the number of cores that this process may use; a cluster or container may grant fewer than exist."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
