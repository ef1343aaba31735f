"""A record: one row per episode, the same in training and in tests. docs/protocol.md defines the columns."""

from __future__ import annotations

from functools import cache

from auvbench.metrics import METRICS, Totals

OUTCOMES = ("success", "collision", "timeout", "out_of_bounds")
"""How an episode ends, in the order of the codes 0 to 3 in tasks/kernels.py. A task lists those of its own."""

PRIMARY = "primary"
"""name of the measure that ranks agents of a task, whatever it is"""

Record = dict[str, float | int | str]

_COLUMNS = {metric.name: metric for metric in METRICS if metric.value is not None}
ALL_COLUMNS = tuple(_COLUMNS)
"""of all tasks"""
SCENARIO_COLUMNS = tuple(name for name, metric in _COLUMNS.items() if metric.kind == "scenario")
"""Columns of the scenario alone, the same for every agent that meets it."""
MEASURED = tuple(name for name, metric in _COLUMNS.items() if metric.kind != "key")
"""Columns that hold a finite number in every row that has them."""


@cache
def record_columns(task: str) -> tuple[str, ...]:
    """Return the columns of the records of a task."""
    return tuple(name for name, metric in _COLUMNS.items() if metric.is_of(task))


def record_of(totals: Totals, task: str) -> Record:
    """Return the record of an episode of a task."""
    found: Record = {}
    for name in record_columns(task):
        value = _COLUMNS[name].value
        assert value is not None
        found[name] = value(totals)
    return found


def measure_names() -> tuple[str, ...]:
    """Return the names of everything that agents can be compared by; `analysis.measures` computes them."""
    compared = ("rate", "penalised", "episode", "derived")
    return tuple(metric.measure for metric in METRICS if metric.kind in compared)
