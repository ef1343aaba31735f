"""Define the record of an episode: one row, with the same columns in training and in tests (docs/protocol.md)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from auvbench.metrics import OPEN, TRUTH, Kind, Totals, registered

OUTCOMES = ("success", "collision", "timeout", "out_of_bounds")
"""Outcomes of an episode, in the order of the codes 0 to 3 in tasks/rows.py. Each task lists its own subset."""
ABORTED = "aborted"
"""Outcome of a pilot's mission that a person or a failsafe stopped; mission.json contains the reason."""

PRIMARY = "primary"
"""Value of configuration keys and flags; it selects the measure that ranks the agents of a task (`primary_of`)"""

Record = dict[str, float | int | str]


def columns(*kinds: Kind) -> tuple[str, ...]:
    """Return the names of the columns that the records of any task may have; `kinds` restricts them to these kinds of metrics."""
    return tuple(m.name for m in registered() if m.value is not None and (not kinds or m.kind in kinds))


def measured() -> tuple[str, ...]:
    """Return the columns of the kinds `scenario` and `episode`. Each row has a finite number or no value in such a column."""
    return columns("scenario", "episode")


@cache
def _of(
    task: str, world: str, navigation: str, filtered: bool
) -> dict[str, Callable[[Totals], float | int | str]]:
    context = task, world, navigation, filtered
    return {m.name: m.value for m in registered() if m.value is not None and m.is_of(*context)}


def record_columns(
    task: str, world: str = OPEN, navigation: str = TRUTH, filtered: bool = False
) -> tuple[str, ...]:
    """Return the columns of an episode's record, given the task, `world.name`, `navigation.name` and whether commands are filtered."""
    return tuple(_of(task, world, navigation, filtered))


def record_of(
    totals: Totals, task: str, world: str = OPEN, navigation: str = TRUTH, filtered: bool = False
) -> Record:
    """Return the record of an episode; the arguments are the same as for `record_columns`."""
    return {name: value(totals) for name, value in _of(task, world, navigation, filtered).items()}


def forget() -> None:
    """Clear the caches, which are invalid after the registered metrics have changed."""
    registered.cache_clear()
    _of.cache_clear()


def measure_names() -> tuple[str, ...]:
    """Return the names of all measures by which `analysis.measures` can compare agents."""
    compared = ("rate", "penalised", "episode", "derived")
    return tuple(metric.measure for metric in registered() if metric.kind in compared)
