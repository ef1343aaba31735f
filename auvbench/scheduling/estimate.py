"""The end of a sweep, and times in words."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path

from auvbench.runs.progress import Progress
from auvbench.untrusted import typed_json


def read(run: Path) -> Progress | None:
    """Return the last progress that a run wrote; None where it cannot be read."""
    try:
        return typed_json.read(run / "progress.json", Progress)
    except (OSError, ValueError):
        return None


def fraction(at: Progress) -> float:
    """Share of the budget that is done, in [0, 1]."""
    return min(1.0, at.steps / at.total_steps) if at.total_steps > 0 else 0.0


def remaining(at: Progress) -> float | None:
    """Seconds to go at the present pace; None while there is no pace."""
    return max(0, at.total_steps - at.steps) / at.steps_per_s if at.steps_per_s > 0 else None


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


def clock_after(seconds: float) -> str:
    """The time of day in so many seconds, with the day where it is not today."""
    now = datetime.now().astimezone()
    until = now + timedelta(seconds=seconds)
    days = (until.date() - now.date()).days
    return f"{until:%H:%M}" if days == 0 else f"{until:%a %H:%M}" if days < 7 else f"{until:%d %b}"
