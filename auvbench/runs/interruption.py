"""Ctrl-C and SIGTERM as a request to save and leave, instead of a death in mid-step.

    with interruption.deferred() as request:
        while training:
            step()
            if request.signal:          # at a place where the run can be saved
                save()
                raise Interrupted(request.signal)

The first signal only sets `request.signal`; the second one raises `Interrupted` at once, for those who cannot
wait. Outside `deferred`, `immediate` makes the first raise already.
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


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(KeyboardInterrupt):
    """Asked to leave; what was saved before is the place to go on from. Exit code 128 + signal (130, 143).

    A KeyboardInterrupt, so that no `except Exception` on the way, ours or a library's, takes it for an error.
    """

    def __init__(self, number: int, message: str = "") -> None:
        self.signal = signal.Signals(number)
        self.exit_code = 128 + number
        super().__init__(message or f"interrupted by {self.signal.name}")


@dataclass(slots=True)
class Request:
    """Whether this process was asked to stop."""

    signal: signal.Signals | None = None


@contextlib.contextmanager
def deferred() -> Iterator[Request]:
    """Signals set the request; a second one raises `Interrupted`. Without effect outside the main thread."""
    request = Request()

    def note(number: int, _frame: FrameType | None) -> None:
        if request.signal is not None:
            raise Interrupted(number)
        request.signal = signal.Signals(number)

    with handlers(note):
        yield request


@contextlib.contextmanager
def immediate() -> Iterator[Request]:
    """Signals raise `Interrupted` where the process happens to be, and set the request.

    What is raised in the middle of a library may come out of it as another error, or not at all: the caller that has to say
    what ended the process looks at the request.
    """
    request = Request()

    def leave(number: int, _frame: FrameType | None) -> None:
        request.signal = signal.Signals(number)
        raise Interrupted(number)

    with handlers(leave):
        yield request


def behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interruption that an error came from: a library may have caught it on the way and raised its own."""
    seen: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in seen:
        if isinstance(link, KeyboardInterrupt):
            return link
        seen.append(link)
        link = link.__cause__ or link.__context__
    return None


@contextlib.contextmanager
def handlers(handler: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Handle `SIGNALS` inside. Without effect outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
