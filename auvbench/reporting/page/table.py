"""Tables as the page shows them: cells typeset, aligned and linked to the runs behind them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING

from auvbench.analysis import rounding
from auvbench.analysis.records import Ranking
from auvbench.reporting.page.links import Links
from auvbench.reporting.tables.main import label_of, main_table
from auvbench.reporting.tables.table import (
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    definition_of,
    estimate_cell,
    heading_of,
    in_order,
    split,
)
from auvbench.statistics.intervals import Estimate

if TYPE_CHECKING:
    pass

NOTHING = rounding.NOTHING
MINUS = "−"
_THIN = "\u202f"
"""narrow no-break space: parts thousands and stands before a unit"""


def fixed(value: float | None, places: int) -> str:
    """Return the value with so many decimals; a dash for a missing one.

    >>> fixed(-1234.56, 1), fixed(None, 1)
    ('−1234.6', '–')
    """
    return NOTHING if value is None else typeset(rounding.fixed(value, places))


def estimate(of: Estimate, scale: float = 1.0) -> tuple[str, str]:
    """Return value and interval; the interval may be ''.

    >>> estimate(Estimate(0.98, 0.964, 0.989), 100.0)
    ('98.0', '96.4 – 98.9')
    """
    value, low, high = (typeset(text) for text in rounding.rounded(of, scale))
    between = " to " if low.startswith(MINUS) else " – "  # a dash next to a minus sign is hard to read
    return value, f"{low}{between}{high}" if low else ""


def typeset(number: str) -> str:
    """Return the number with a real minus sign; a narrow space parts thousands from five digits on."""
    sign = MINUS if number.startswith("-") else ""
    whole, point, rest = number.removeprefix("-").partition(".")
    if whole.isdecimal() and len(whole) > 4:
        whole = f"{int(whole):,}".replace(",", _THIN)
    return sign + whole + point + rest


def minus(sentence: str) -> str:
    """Return the sentence with real minus signs; dates, names and ranges keep their hyphens.

    >>> minus("-4.1 points [-6.7, -1.5] of run sac-1, 10-20 m")
    '−4.1 points [−6.7, −1.5] of run sac-1, 10-20 m'
    """
    return re.sub(r"(?<![\w.)\]-])-(?=\.?\d)", MINUS, sentence)


PAGE = 1200.0
"""px that the page is wide at most, without its margins"""


@dataclass(frozen=True, slots=True)
class ShownCell:
    """One printed entry."""

    value: str
    more: str
    sort: float | None
    pad: str = ""
    """digits set invisibly behind the value, so that the decimal points of a column stand in line"""


@dataclass(frozen=True, slots=True)
class ShownLine:
    """One printed row."""

    cells: tuple[ShownCell, ...]
    verdict: str
    colour: str = ""
    href: str = ""
    """where the agent's numbers come from"""


@dataclass(frozen=True, slots=True)
class ShownTable:
    """A table as the template draws it."""

    headings: tuple[Heading, ...]
    lines: tuple[ShownLine, ...]
    lead: int

    def definition(self, heading: Heading) -> str:
        """Return what a column is, for its tooltip."""
        return definition_of(heading.metric)


def printed(table: Table) -> ShownTable:
    """Return a table without links: of pairs of agents, or over several sections."""
    columns = [_aligned([line.cells[i] for line in table.lines]) for i in range(len(table.headings))]
    lines = tuple(
        ShownLine(cells, line.verdict)
        for line, cells in zip_longest(table.lines, zip(*columns, strict=True), fillvalue=())
        if isinstance(line, Line)
    )
    return ShownTable(table.headings, lines, table.lead)


def of_agents(table: Table, ranking: Ranking, colours: Mapping[str, str], links: Links) -> ShownTable:
    """Return a table with a row per agent of the ranking, linked to the runs behind it."""
    shown = printed(table)
    lines = tuple(
        replace(
            line,
            colour=colours.get(row.label, ""),
            href=links.of_runs(row.label, row.run_ids),
        )
        for line, row in zip(shown.lines, ranking.rows, strict=True)
    )
    return replace(shown, lines=lines)


def parts(
    table: Table | None, ranking: Ranking, colours: Mapping[str, str], links: Links
) -> list[ShownTable]:
    """Return a table of agents in as many parts as the page's width asks for."""
    if table is None or not ranking.rows:
        return []
    return [
        of_agents(table.part(part), ranking, colours, links)
        for part in split(table, lambda i: _width(table, i), PAGE)
    ]


def metrics_table(ranking: Ranking) -> Table | None:
    """Return every metric that the main table leaves out; None without any."""
    there = {heading.metric for heading in main_table(ranking).headings}
    held = dict.fromkeys(metric for row in ranking.rows for metric in row.estimates)
    columns = [column_of(metric) for metric in in_order(m for m in held if m not in there)]
    if not columns:
        return None
    lines = [
        Line((Cell(label_of(row)), *(estimate_cell(row.estimates.get(c.metric), c.scale) for c in columns)))
        for row in ranking.rows
    ]
    return Table((Heading("agent", words=True), *map(heading_of, columns)), tuple(lines))


def _width(table: Table, i: int) -> float:
    """Return the px that a column takes, about: its heading in bold or its longest entry, and the padding."""
    heading, cells = table.headings[i], [line.cells[i] for line in table.lines]
    title = 8.2 * len(heading.title) + (7.4 * (len(heading.unit) + 1) if heading.unit else 0)
    return 20 + max([title, *(max(8.6 * len(c.value), 6.7 * len(c.more)) for c in cells)])


def _aligned(column: Sequence[Cell]) -> list[ShownCell]:
    """Return the cells of a column with their numbers padded to its most decimals."""
    most = max((len(_decimals(cell.value)) for cell in column), default=0)
    return [
        ShownCell(
            typeset(cell.value),
            minus(cell.more),
            cell.sort,
            ("." + "0" * (most - 1))[len(_decimals(cell.value)) :]
            if most and cell.sort is not None and cell.value[-1:].isdigit()
            else "",
        )
        for cell in column
    ]


def _decimals(text: str) -> str:
    """Return '.50' of '12.50'."""
    _, point, rest = text.partition(".")
    return point + rest if rest.isdigit() else ""
