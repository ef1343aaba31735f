"""When a sweep will end, and how to say it."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
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


def speed(shown: Sequence[tuple[float, float]]) -> float:
    """How fast this machine is, compared with the one on which paces were measured.

    Args:
        shown: of each run that has shown its pace, that pace and the one expected of it, in the same unit.

    Returns:
        their mean ratio (geometric); 1 where nothing was shown.

    >>> speed([(50.0, 100.0), (200.0, 400.0)]), speed([])
    (0.5, 1.0)
    """
    ratios = [math.log(pace / expected) for pace, expected in shown if pace > 0 and expected > 0]
    return math.exp(fmean(ratios)) if ratios else 1.0


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


def rough(seconds: float) -> float:
    """To what an estimate from elsewhere is good for.

    >>> [duration(rough(seconds)) for seconds in (59.4, 700.0, 5000.0, 29176.0, 900000.0)]
    ['59 s', '12 min', '1 h 20 min', '8 h', '10 d']
    """
    units = ((10 * 86400, 86400), (3 * 3600, 3600), (3600, 600), (600, 60), (0, 1))
    unit = next(unit for least, unit in units if seconds >= least)
    return round(seconds / unit) * unit


def clock_after(seconds: float) -> str:
    """The time of day in so many seconds, with the day where it is not today."""
    now = datetime.now().astimezone()
    until = now + timedelta(seconds=seconds)
    days = (until.date() - now.date()).days
    return f"{until:%H:%M}" if days == 0 else f"{until:%a %H:%M}" if days < 7 else f"{until:%d %b}"
