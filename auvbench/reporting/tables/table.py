"""A table as data: every format renders the same columns and cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from auvbench.analysis.formatting import NOTHING, rounded
from auvbench.metrics import METRICS
from auvbench.statistics.intervals import Estimate

DAGGER = "†"


@dataclass(frozen=True, slots=True)
class Heading:
    """The head of one column."""

    title: str
    unit: str = ""
    tex: str = ""
    """the title in LaTeX where it has a symbol"""
    words: bool = False
    """set to the left, as words are; numbers are set to the right"""
    metric: str = ""
    """key of `Row.estimates`, where the column is one"""
    scale: float = 1.0
    """from the unit of the metric to that of the column"""
    hint: str = ""
    """what the column is"""
    weight: int = 0
    """columns of greater weight are left out first where there is no room; 0 stays"""

    @property
    def text(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


@dataclass(frozen=True, slots=True)
class Cell:
    """One entry: a value and, below or behind it, its interval or remark."""

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
    """of the agent against the baseline; '' where it has none"""
    colour: str = ""
    """of the agent, on the page"""
    href: str = ""
    """where the row's numbers come from, on the page"""
    anchor: str = ""
    """id of the row, on the page"""


SHOWN_NOTES = 3
"""notes below a table; a reader opens the others"""


@dataclass(frozen=True, slots=True)
class Table:
    """Headings, rows, and what a reader needs to know of them; the first `lead` columns say what a row is."""

    headings: tuple[Heading, ...]
    lines: tuple[Line, ...]
    title: str = ""
    """caption in print"""
    notes: tuple[str, ...] = ()
    """sentences without markup, below the table: the first `SHOWN_NOTES` at once, the others on a click"""
    lead: int = 1


def column_of(measure: str, weight: int = 0) -> Heading:
    """Return the column of a metric; one that auvbench does not know is named after its key.

    >>> column_of("mean_path_length_m").text, column_of("success_rate").text
    ('path length (m)', 'success (%)')
    """
    for m in METRICS:
        if m.measure == measure:
            return Heading(m.title, m.table_unit, m.latex, False, measure, m.scale, m.definition, weight)
    return Heading(measure.removeprefix("mean_").replace("_", " "), metric=measure, weight=weight)


def in_order(measures: Iterable[str]) -> list[str]:
    """Return metrics in the order of the registry, unknown ones last."""
    order = {metric.measure: place for place, metric in enumerate(METRICS)}
    return sorted(measures, key=lambda name: (order.get(name, len(order)), name))


def estimate_cell(estimate: Estimate | None, scale: float = 1.0, *, signed: bool = False) -> Cell:
    """Return an estimate as a cell: value and interval; a dash where there is none, never zero.

    >>> estimate_cell(Estimate(0.98, 0.964, 0.989), 100.0).text
    '98.0 [96.4, 98.9]'
    """
    if estimate is None:
        return Cell(NOTHING)
    value, low, high = rounded(estimate, scale)
    sign = "+" if signed and estimate.value > 0 and value != NOTHING else ""
    sort = estimate.value if value != NOTHING else None
    return Cell(f"{sign}{value}", f"[{low}, {high}]" if low else "", sort)
