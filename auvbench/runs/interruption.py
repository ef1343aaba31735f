"""Turn Ctrl-C and SIGTERM into a request to save and exit, so that no signal ends the process in the middle of a step.

    with interruption.deferred() as request:
        while training:
            step()
            if request.signal:          # at a place where the run can be saved
                save()
                raise Interrupted(request.signal)

Inside `deferred`, the first signal only sets `request.signal`; the second raises `Interrupted` at once.
Inside `immediate`, the first signal already raises.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

_PR_SET_PDEATHSIG = 1


def host() -> str:
    return socket.gethostname()


def die_with_parent(parent: int) -> None:
    """Ask the kernel to kill this process when the thread of `parent` that forked it ends (Linux only)."""
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # The parent ended before `prctl` was called, so the kernel sends no signal.
        os.kill(os.getpid(), signal.SIGKILL)


def prefer_in_memory_shortage() -> None:
    """Ask the kernel to kill this process rather than its parent when memory runs out (Linux only)."""
    try:
        Path("/proc/self/oom_score_adj").write_text("500", encoding="ascii")
    except OSError:  # On other systems, or without permission, the kernel's default choice remains.
        return


def cores() -> int:
    """Return the number of cores that this process may use; a cluster or container may grant fewer than the
    machine has.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(KeyboardInterrupt):
    """A signal asked the process to exit. Exit code 128 + signal (130, 143).

    Derived from KeyboardInterrupt, so that no `except Exception`, in auvbench or a library, mistakes it for
    an error.
    """

    def __init__(self, number: int, message: str = "") -> None:
        self.signal = signal.Signals(number)
        self.exit_code = 128 + number
        super().__init__(message or f"interrupted by {self.signal.name}")


@dataclass(slots=True)
class Request:
    """Request to stop this process."""

    signal: signal.Signals | None = None


@contextlib.contextmanager
def deferred() -> Iterator[Request]:
    """Let the first signal set the request and the second raise `Interrupted`. Has no effect outside the main thread."""
    request = Request()

    def note(number: int, _frame: FrameType | None) -> None:
        if request.signal is not None:
            raise Interrupted(number)
        request.signal = signal.Signals(number)

    with handlers(note):
        yield request


@contextlib.contextmanager
def immediate() -> Iterator[Request]:
    """Let signals raise `Interrupted` at once, and set the request.

    A library in which the signal arrives may replace or swallow the exception. A caller that reports why the
    process ended must therefore read the request.
    """
    request = Request()

    def leave(number: int, _frame: FrameType | None) -> None:
        request.signal = signal.Signals(number)
        raise Interrupted(number)

    with handlers(leave):
        yield request


def cause(error: BaseException) -> KeyboardInterrupt | None:
    """Return the interruption in an error's chain of causes; None if the chain has no interruption.

    A library may catch an interruption and raise its own error.
    """
    links: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in links:
        if isinstance(link, KeyboardInterrupt):
            return link
        links.append(link)
        link = link.__cause__ or link.__context__
    return None


@contextlib.contextmanager
def handlers(handler: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Handle `SIGNALS` with `handler` inside the `with` block. Has no effect outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
