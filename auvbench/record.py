"""A record: one row per episode, the same in training and in tests. docs/protocol.md defines the columns."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from auvbench.metrics import METRICS, Kind, Totals

OUTCOMES = ("success", "collision", "timeout", "out_of_bounds")
"""How an episode ends, in the order of the codes 0 to 3 in tasks/kernels.py. A task lists those of its own."""
ABORTED = "aborted"
"""Outcome of a pilot's mission that was ended from outside; mission.json has the reason."""

PRIMARY = "primary"
"""stands for the measure that ranks agents of a task (`primary_of`)"""

Record = dict[str, float | int | str]


def columns(*kinds: Kind) -> tuple[str, ...]:
    """Return the columns of all tasks, or those of some kinds: `scenario`, the same for every agent that meets it."""
    return tuple(m.name for m in METRICS if m.value is not None and (not kinds or m.kind in kinds))


def measured() -> tuple[str, ...]:
    """Return the columns that hold a finite number in every row that has them."""
    return columns("scenario", "episode")


@cache
def _of(task: str) -> dict[str, Callable[[Totals], float | int | str]]:
    return {m.name: m.value for m in METRICS if m.value is not None and m.is_of(task)}


def record_columns(task: str) -> tuple[str, ...]:
    """Return the columns of the records of a task."""
    return tuple(_of(task))


def record_of(totals: Totals, task: str) -> Record:
    """Return the record of an episode of a task."""
    return {name: value(totals) for name, value in _of(task).items()}


def forget() -> None:
    """Clear what is cached: the metrics have changed."""
    _of.cache_clear()


def measure_names() -> tuple[str, ...]:
    """Return the names of everything that agents can be compared by; `analysis.measures` computes them."""
    compared = ("rate", "penalised", "episode", "derived")
    return tuple(metric.measure for metric in METRICS if metric.kind in compared)
