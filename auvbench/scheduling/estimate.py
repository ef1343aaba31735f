"""When a sweep will end, and how to say it."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from statistics import fmean


def makespan(running: Sequence[float], waiting: Sequence[float], slots: int | None) -> float:
    """Seconds until all is done when each free slot takes the next waiting run.

    Args:
        running: seconds that each running run has to go.
        waiting: seconds that each waiting run will take, in the order in which they start.
        slots: how many run at once; None: all of them.

    >>> makespan([10.0, 4.0], [5.0, 5.0], 2)
    14.0
    >>> makespan([10.0], [5.0, 20.0], None)
    20.0
    """
    if slots is None:
        return max([*running, *waiting], default=0.0)
    free = list(running) + [0.0] * max(0, slots - len(running))
    heapq.heapify(free)
    for seconds in waiting:
        heapq.heappush(free, heapq.heappop(free) + seconds)
    return max(free, default=0.0)


def pace(kind: str, paces: Mapping[str, Sequence[float]]) -> float | None:
    """Steps per second to expect of a run: the mean of its kind in this sweep, else of all, else unknown.

    >>> pace("ppo", {"ppo": [100.0, 300.0], "sac": [10.0]})
    200.0
    >>> pace("td3", {"sac": [10.0]})
    10.0
    """
    own = [value for value in paces.get(kind, ()) if value > 0]
    if own:
        return fmean(own)
    every = [value for values in paces.values() for value in values if value > 0]
    return fmean(every) if every else None


def duration(seconds: float) -> str:
    """A time in its two largest units.

    >>> duration(59.4), duration(130), duration(11400), duration(200000)
    ('59 s', '2 min 10 s', '3 h 10 min', '2 d 7 h')
    """
    whole = max(0, round(seconds))
    for unit, size, below, part in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= size:
            rest = whole % size // part
            return f"{whole // size} {unit}" + (f" {rest} {below}" if rest else "")
    return f"{whole} s"
