"""A table as data: every format renders the same columns and cells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from auvbench.analysis.rounding import NOTHING, rounded
from auvbench.metrics import METRICS, Metric
from auvbench.statistics.intervals import Estimate

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


def _metric(measure: str) -> Metric | None:
    return next((metric for metric in METRICS if metric.measure == measure), None)


def column_of(metric: str) -> Column:
    """Return the column of a metric; one that auvbench does not know is named after its key.

    >>> column_of("mean_path_length_m").heading, column_of("success_rate").heading
    ('path length (m)', 'success (%)')
    """
    if known := _metric(metric):
        return Column(metric, known.title, known.table_unit, known.latex, known.scale)
    return Column(metric, metric.removeprefix("mean_").replace("_", " "))


def definition_of(metric: str) -> str:
    """Return what a metric is; empty where auvbench does not know it."""
    known = _metric(metric)
    return known.definition if known else ""


def in_order(metrics: Iterable[str]) -> list[str]:
    """Return metrics in the order of the registry, unknown ones last."""
    order = {metric: place for place, metric in enumerate(m.measure for m in METRICS)}
    return sorted(metrics, key=lambda metric: (order.get(metric, len(order)), metric))


@dataclass(frozen=True, slots=True)
class Heading:
    """The head of one column."""

    title: str
    unit: str = ""
    tex: str = ""
    """the title in LaTeX where it is not the text"""
    words: bool = False
    """set to the left, as words are; numbers are set to the right"""
    group: str = ""
    """columns of one group stay together where a table is split"""
    metric: str = ""
    """key of `Row.estimates`, where the column is one"""
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


@dataclass(frozen=True, slots=True)
class Table:
    """Headings and rows; the first `lead` columns say what a row is and stand in every part of a split table."""

    headings: tuple[Heading, ...]
    lines: tuple[Line, ...]
    lead: int = 1

    def part(self, columns: Sequence[int]) -> Table:
        """Return the table with some of its columns."""
        return replace(
            self,
            headings=tuple(self.headings[i] for i in columns),
            lines=tuple(replace(line, cells=tuple(line.cells[i] for i in columns)) for line in self.lines),
        )


def heading_of(column: Column, weight: int = 0) -> Heading:
    """Return the heading of a metric."""
    return Heading(column.title, column.unit, column.tex, metric=column.metric, weight=weight)


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


def split(table: Table, width: Callable[[int], float], room: float) -> list[list[int]]:
    """Return the columns of each part of a table, as indices; every part begins with the lead columns.

    Args:
        table: the columns in their order; neighbours of one `Heading.group` stay together where they can.
        width: of a column.
        room: that all columns of a part have together.
    """
    lead = list(range(table.lead))
    whole = room - sum(map(width, lead))
    parts: list[list[int]] = [list(lead)]
    left = whole
    columns = range(table.lead, len(table.headings))
    for _, members in groupby(columns, key=lambda i: table.headings[i].group or i):
        found = list(members)
        needed = sum(map(width, found))
        for i in found:
            full = width(i) > left or (i == found[0] and left < needed <= whole)
            if full and len(parts[-1]) > table.lead:
                parts.append(list(lead))
                left = whole
            parts[-1].append(i)
            left -= width(i)
    return parts
