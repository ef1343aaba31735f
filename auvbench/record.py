"""A record: one row per episode, the same in training and in tests. docs/protocol.md defines the columns."""

from __future__ import annotations

from auvbench.metrics import METRICS, Totals

OUTCOMES = ("success", "collision", "timeout")
"""How an episode ends, in the order of the codes 0, 1, 2 (`SUCCESS`, `COLLISION`, `TIMEOUT` in tasks/kernels.py)."""

Record = dict[str, float | int | str]

_COLUMNS = {metric.name: metric for metric in METRICS if metric.value is not None}
RECORD_COLUMNS = tuple(_COLUMNS)
SCENARIO_COLUMNS = tuple(name for name, metric in _COLUMNS.items() if metric.kind == "scenario")
"""Columns of the scenario alone, the same for every agent that meets it."""
MEASURED = tuple(name for name, metric in _COLUMNS.items() if metric.kind != "key")
"""Columns that hold a finite number in every row."""


def record_of(totals: Totals) -> Record:
    """Return the record of an episode, columns RECORD_COLUMNS."""
    return {name: metric.value(totals) for name, metric in _COLUMNS.items() if metric.value is not None}


def measure_names() -> tuple[str, ...]:
    """Return the names of everything that agents can be compared by; `analysis.measures` computes them."""
    compared = ("rate", "penalised", "episode", "derived")
    return tuple(metric.measure for metric in METRICS if metric.kind in compared)
