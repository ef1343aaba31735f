"""Define a table as data: every format renders the same columns and cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from auvbench import metrics
from auvbench.analysis.formatting import NOTHING, rounded
from auvbench.statistics.intervals import Estimate

DAGGER = "†"


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading of one column."""

    title: str
    unit: str = ""
    tex: str = ""
    """title in LaTeX, if it has a symbol"""
    words: bool = False
    """whether the column has words, aligned left; numbers are aligned right"""
    metric: str = ""
    """key in `Row.estimates`, if the column is a metric"""
    scale: float = 1.0
    """factor from the metric's unit to the column's"""
    hint: str = ""
    """explanation of the column"""
    weight: int = 0
    """weight; in a narrow table, columns of greater weight are left out first, and 0 always stays"""

    @property
    def text(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True, slots=True)
class Cell:
    """One entry: a value, with its interval or remark below or behind it."""

    value: str
    more: str = ""
    sort: float | None = None

    @property
    def text(self) -> str:
        return f"{self.value} {self.more}" if self.more else self.value


@dataclass(frozen=True, slots=True)
class Line:
    """One row."""

    cells: tuple[Cell, ...]
    verdict: str = ""
    """verdict on the agent against the baseline; '' without one"""
    colour: str = ""
    """colour of the agent on the page"""
    href: str = ""
    """link to the source of the row's numbers, on the page"""
    anchor: str = ""
    """id of the row, on the page"""


SHOWN_NOTES = 3
"""number of notes that are visible below a table; a click opens the others"""


@dataclass(frozen=True, slots=True)
class Table:
    """Headings, rows and notes; the first `lead` columns identify a row."""

    headings: tuple[Heading, ...]
    lines: tuple[Line, ...]
    title: str = ""
    """caption in LaTeX"""
    notes: tuple[str, ...] = ()
    """notes below the table, without markup: the first `SHOWN_NOTES` are visible, a click opens the others"""
    lead: int = 1


def column_of(measure: str, weight: int = 0) -> Heading:
    """Return the column of a metric; an unknown metric is named after its key.

    >>> column_of("mean_path_length_m").text, column_of("success_rate").text
    ('path length (m)', 'success (%)')
    """
    for m in metrics.registered():
        if m.measure == measure:
            return Heading(m.title, m.table_unit, m.latex, False, measure, m.scale, m.definition, weight)
    return Heading(measure.removeprefix("mean_").replace("_", " "), metric=measure, weight=weight)


def in_order(measures: Iterable[str]) -> list[str]:
    """Return metrics in the order of the registry, unknown ones last."""
    order = {metric.measure: place for place, metric in enumerate(metrics.registered())}
    return sorted(measures, key=lambda name: (order.get(name, len(order)), name))


def estimate_cell(estimate: Estimate | None, scale: float = 1.0, *, signed: bool = False) -> Cell:
    """Return an estimate as a cell: value and interval; a dash (never zero) if there is no estimate.

    >>> estimate_cell(Estimate(0.98, 0.964, 0.989), 100.0).text
    '98.0 [96.4, 98.9]'
    """
    if estimate is None:
        return Cell(NOTHING)
    value, low, high = rounded(estimate, scale)
    sign = "+" if signed and estimate.value > 0 and value != NOTHING else ""
    sort = estimate.value if value != NOTHING else None
    return Cell(f"{sign}{value}", f"[{low}, {high}]" if low else "", sort)
