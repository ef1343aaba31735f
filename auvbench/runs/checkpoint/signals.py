"""Ctrl-C and SIGTERM ask the run to stop; it stops where it can be continued with the same bits."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from auvbench.errors import AuvbenchError

GRACE_SECONDS = 20.0  # SLURM waits 30 s between SIGTERM and SIGKILL by default


class RunInterruptedError(AuvbenchError):
    """The run was asked to stop and has stopped; the same command goes on from where it was.

    Args:
        signum: the signal; the exit code is 128 + signum, as a shell reports it (130, 143).
        message: what is saved and how to go on.
    """

    def __init__(self, signum: int, message: str) -> None:
        super().__init__(message)
        self.signum = signum
        self.exit_code = 128 + signum


class StopRequest:
    """Remembers that a signal came.

    Attributes:
        signum: the first signal that came, None as long as none came.
    """

    def __init__(self, grace: float = GRACE_SECONDS) -> None:
        self.signum: int | None = None
        self.grace = grace  # s
        self._since = 0.0
        self._insists = False

    def __bool__(self) -> bool:
        return self.signum is not None

    @property
    def urgent(self) -> bool:
        """True when there is no time to reach the next boundary: a second signal, or the grace is over."""
        return self.signum is not None and (self._insists or time.monotonic() - self._since > self.grace)

    def ask(self, signum: int, frame: FrameType | None = None) -> None:
        """A signal handler. The third signal is no longer asked politely."""
        if self.signum is None:
            self.signum, self._since = signum, time.monotonic()
        elif not self._insists:
            self._insists = True
        else:
            raise KeyboardInterrupt


@contextmanager
def stop_on_signals(request: StopRequest | None = None) -> Iterator[StopRequest]:
    """Within it, SIGINT and SIGTERM set a `StopRequest`. Outside the main thread nothing is installed."""
    request = request or StopRequest()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    before = {number: signal.signal(number, request.ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
