"""The exploratory tables: ranks with their intervals, group letters, and pairs of agents."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis.formatting import unit
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Comparison, Ranking, Row
from auvbench.analysis.rounding import NOTHING
from auvbench.reporting.tables.columns import column_of
from auvbench.reporting.tables.main import label_of
from auvbench.reporting.tables.table import Cell, Heading, Line, Table, estimate_cell, heading_of

MOST_LETTERS = 8
"""of an agent's group; longer ones cannot be read, and the rank intervals say the same"""


def ranks_table(ranking: Ranking) -> Table:
    """Return rank, the ranks that agree with the data, group letters, and the measure ranked by."""
    column = column_of(ranking.rank_by)
    letters = readable_letters(ranking)
    headings = [Heading("agent", words=True), Heading("rank"), Heading("ranks")]
    headings += [Heading("group", words=True)] * letters
    lines = [
        Line(
            (
                Cell(label_of(row)),
                Cell(str(row.rank), sort=float(row.rank)),
                Cell(ranks_of(row), sort=row.rank + sum(row.rank_interval) / 1e6),
                *[Cell(row.group or NOTHING)] * letters,
                estimate_cell(row.estimates.get(column.metric), column.scale),
            )
        )
        for row in ranking.rows
    ]
    return Table((*headings, heading_of(column)), tuple(lines))


def ranks_of(row: Row) -> str:
    """Return the ranks that agree with the data: '3', '1 to 11'."""
    first, last = row.rank_interval
    return f"{first}" if first == last else f"{first} to {last}"


def readable_letters(ranking: Ranking) -> bool:
    """Return whether the group letters are short enough to read. The CSV has them always."""
    return all(len(row.group) <= MOST_LETTERS for row in ranking.rows)


def pairs_table(comparisons: Sequence[Comparison]) -> Table:
    """Return pairs of agents with their differences, corrected over all pairs."""
    m = measure(comparisons[0].metric)
    points = "points" if m.rate else unit(m).strip()
    headings = (
        Heading("agent", words=True),
        Heading("against", words=True),
        Heading("difference", points),
        Heading("p", "Holm"),
        Heading("verdict", words=True),
        Heading("does better", "%"),
    )
    lines = [
        Line(
            (
                Cell(c.first),
                Cell(c.second),
                estimate_cell(c.difference, 100.0 if m.rate else 1.0, signed=True),
                Cell("< 0.001" if c.p_adjusted < 0.001 else f"{c.p_adjusted:.3f}", sort=c.p_adjusted),
                Cell(c.verdict),
                estimate_cell(c.probability_of_improvement, 100.0),
            )
        )
        for c in comparisons
    ]
    return Table(headings, tuple(lines), lead=2)
