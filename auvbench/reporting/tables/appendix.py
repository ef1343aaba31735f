"""The tables next to the main one: ranks, pairs, conditions, and the original study's numbers."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis import thesis
from auvbench.analysis.conditions import in_words
from auvbench.analysis.formatting import NOTHING, unit
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Comparison, Ranking, Row
from auvbench.analysis.thesis import ComparisonRow
from auvbench.reporting.tables.main import label_of
from auvbench.reporting.tables.table import (
    DAGGER,
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
)

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
    return Table((*headings, column), tuple(lines))


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
    )
    lines = [
        Line(
            (
                Cell(c.first),
                Cell(c.second),
                estimate_cell(c.difference, 100.0 if m.rate else 1.0, signed=True),
                Cell("< 0.001" if c.p_adjusted < 0.001 else f"{c.p_adjusted:.3f}", sort=c.p_adjusted),
                Cell(c.verdict),
            )
        )
        for c in comparisons
    ]
    return Table(headings, tuple(lines), lead=2)


def conditions_table(ranking: Ranking) -> Table:
    """Return success in percent by condition; a dash where an agent did not meet one."""
    headings = [Heading("agent", words=True)]
    for condition in ranking.conditions:
        title, level = in_words(condition.name)
        headings.append(Heading(title, level, weight=1))
    lines = [
        Line(
            (
                Cell(label_of(row)),
                *(estimate_cell(c.success.get(row.label), 100.0) for c in ranking.conditions),
            )
        )
        for row in ranking.rows
    ]
    return Table(tuple(headings), tuple(lines))


def conditions_note(ranking: Ranking) -> str:
    """Return what the table shows, in a sentence without markup."""
    text = (
        f"Success (%) under each condition of protocol {ranking.protocol}, {100 * ranking.confidence:g} % intervals, each "
        f"by itself; agents in the order of condition {ranking.condition}."
    )
    if all(row.compared for row in ranking.rows):
        return text
    return f"{text} {DAGGER} one training seed: the interval covers test episodes only."


def comparison_table(rows: Sequence[ComparisonRow]) -> Table:
    """Return the original study's numbers and ours: an agent per line, "theirs / ours [interval]" per measure."""
    measures = [name for name in thesis.TITLES if any(row.measure == name for row in rows)]
    titles = [Heading(thesis.TITLES[name], weight=1) for name in measures]
    lines = []
    for agent in thesis.AGENTS:
        mine = {row.measure: row for row in rows if row.agent == agent}
        k, frequency = thesis.CELLS[agent[3:]]
        label = next((row.label for row in mine.values()), "") or f"K={k:g} {frequency:g} Hz, not run"
        cells = [_theirs_and_ours(mine.get(name)) for name in measures]
        lines.append(Line((Cell(f"{agent} ({label})"), *cells)))
    return Table((Heading("agent", words=True), *titles), tuple(lines))


COMPARISON_NOTE = "The original study (200 episodes, one training seed) / ours with its interval. r: restored from the row's sums."


def _theirs_and_ours(row: ComparisonRow | None) -> Cell:
    if row is None:
        return Cell(NOTHING)
    theirs = f"{row.theirs.value:g} {row.theirs.mark}".rstrip()
    if row.ours is None:
        return Cell(f"{theirs} / {NOTHING}")
    ours = estimate_cell(row.ours)
    return Cell(f"{theirs} / {ours.value}", ours.more)
