"""How a report uses its process: a second one for work that can be cut in two, and no search for garbage.

Reading and drawing are all Python, so a second core helps only a second process. A fork starts at once and needs no
copy of what is in memory; what comes back is pickled.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")

MANY = 60
"""sources from which a second process gains more than its start and the way back cost"""

SHARE = 0.44
"""of the sources for the second process: less than half, since it has to send what it made of them"""


def can_fork() -> bool:
    """Not with other threads around, whose locks a fork may catch held, not off Linux, not for one core."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and threading.active_count() == 1


@contextmanager
def beside(work: Callable[[], T]) -> Iterator[Callable[[], T]]:
    """Does `work` in a child while the body of the `with` does its own; gives a function that waits for the result.

    Where there is no child, or it died, that function does the work here, so that an error is seen.

    >>> with beside(lambda: 1 + 1) as result:
    ...     result() + 1
    3
    """
    if not can_fork():
        yield work
        return
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)

    def send() -> None:
        with contextlib.suppress(BaseException):  # the parent meets the same error and says it once
            sender.send(work())

    child = context.Process(target=send, daemon=True)
    child.start()
    sender.close()

    def result() -> T:
        try:
            received: T = receiver.recv()
        except (EOFError, OSError):  # before or amid the message
            received = work()
        return received

    try:
        yield result
    finally:
        receiver.close()
        if child.is_alive():
            child.terminate()
        child.join()


def each(function: Callable[[S], T], sources: Sequence[S]) -> list[T]:
    """`function` of every source, in their order; a second process takes its share where they are many."""
    if len(sources) < MANY:
        return list(map(function, sources))
    first = round(len(sources) * (1 - SHARE))
    with beside(lambda: list(map(function, sources[first:]))) as rest:
        return [*map(function, sources[:first]), *rest()]


@contextmanager
def uncollected() -> Iterator[None]:
    """Without the collector of cycles, for a while that makes millions of objects and keeps nearly all of them.

    Going through them again and again took a fifth of the time of a large report and freed nothing worth it.
    """
    was = gc.isenabled()
    gc.disable()
    # Nor at the end of the process, when the system takes everything back at once.
    atexit.register(gc.freeze)
    try:
        yield
    finally:
        if was:
            gc.freeze()
            gc.unfreeze()  # makes all objects old, or the collector went through them right now
            gc.enable()
