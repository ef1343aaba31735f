"""Columns of metrics: names, units and scales as every format prints them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from auvbench.metrics import METRICS

DAGGER = "†"


@dataclass(frozen=True, slots=True)
class Column:
    """One metric as it stands in a table."""

    metric: str
    """key of `Row.estimates`"""
    title: str
    unit: str = ""
    tex: str = ""
    """the title in LaTeX where it has a symbol"""
    scale: float = 1.0

    @property
    def heading(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


_METRICS = {metric.measure: metric for metric in METRICS}


def column_of(metric: str) -> Column:
    """Return the column of a metric; one that auvbench does not know is named after its key.

    >>> column_of("mean_path_length_m").heading, column_of("success_rate").heading
    ('path length (m)', 'success (%)')
    """
    if known := _METRICS.get(metric):
        return Column(metric, known.title, known.table_unit, known.latex, known.scale)
    return Column(metric, metric.removeprefix("mean_").replace("_", " "))


def definition_of(metric: str) -> str:
    """Return what a metric is; empty where auvbench does not know it."""
    return _METRICS[metric].definition if metric in _METRICS else ""


def in_order(metrics: Iterable[str]) -> list[str]:
    """Return metrics in the order of the registry, unknown ones last."""
    order = {metric: place for place, metric in enumerate(_METRICS)}
    return sorted(metrics, key=lambda metric: (order.get(metric, len(order)), metric))
