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
    """title in LaTeX if it differs from `title`, for example to show a symbol; '' otherwise"""
    words: bool = False
    """whether the column has words, which are aligned left; columns of numbers are aligned right"""
    metric: str = ""
    """key in `Row.estimates`, if the column is a metric; '' otherwise"""
    scale: float = 1.0
    """factor from the metric's unit to the column's unit"""
    hint: str = ""
    """explanation of the column"""
    weight: int = 0
    """Weight: a table that is too wide drops the columns with the largest weights first, and never a column with weight 0"""

    @property
    def text(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True, slots=True)
class Cell:
    """Entry of a table: a value, and its interval or a remark (`more`)."""

    value: str
    more: str = ""
    sort: float | None = None

    @property
    def text(self) -> str:
        return f"{self.value} {self.more}" if self.more else self.value


@dataclass(frozen=True, slots=True)
class Line:
    """Row of a table."""

    cells: tuple[Cell, ...]
    verdict: str = ""
    """verdict on the row's agent against the baseline; '' without a verdict"""
    colour: str = ""
    """colour of the agent on the page"""
    href: str = ""
    """link to the source of the row's numbers, on the page"""
    anchor: str = ""
    """id of the row, on the page"""


SHOWN_NOTES = 3
"""largest number of visible notes below a table; a click opens the other notes"""


@dataclass(frozen=True, slots=True)
class Table:
    """Table with headings, rows and notes; the first `lead` columns identify a row."""

    headings: tuple[Heading, ...]
    lines: tuple[Line, ...]
    title: str = ""
    """Title: caption in LaTeX, heading in Markdown"""
    notes: tuple[str, ...] = ()
    """notes below the table, without markup; the first `SHOWN_NOTES` are visible"""
    lead: int = 1


def column_of(measure: str, weight: int = 0) -> Heading:
    """Return the heading of a metric's column; the title of an unregistered metric is its key.

    >>> column_of("mean_path_length_m").text, column_of("success_rate").text
    ('path length (m)', 'success (%)')
    """
    for m in metrics.registered():
        if m.measure == measure:
            return Heading(m.title, m.table_unit, m.latex, False, measure, m.scale, m.definition, weight)
    return Heading(measure.removeprefix("mean_").replace("_", " "), metric=measure, weight=weight)


def in_order(measures: Iterable[str]) -> list[str]:
    """Return metrics in the order of the registry, with unregistered metrics at the end."""
    order = {metric.measure: place for place, metric in enumerate(metrics.registered())}
    return sorted(measures, key=lambda name: (order.get(name, len(order)), name))


def estimate_cell(estimate: Estimate | None, scale: float = 1.0, *, signed: bool = False) -> Cell:
    """Return an estimate as a cell with value and interval; a dash without an estimate.

    >>> estimate_cell(Estimate(0.98, 0.964, 0.989), 100.0).text
    '98.0 [96.4, 98.9]'
    """
    if estimate is None:
        return Cell(NOTHING)
    value, low, high = rounded(estimate, scale)
    sign = "+" if signed and estimate.value > 0 and value != NOTHING else ""
    sort = estimate.value if value != NOTHING else None
    return Cell(f"{sign}{value}", f"[{low}, {high}]" if low else "", sort)
