"""The tables next to the main one: ranks, pairs, conditions, all tasks, and the original study's numbers."""

from __future__ import annotations

from collections.abc import Sequence

from auvbench.analysis.aggregate import Across, Over
from auvbench.analysis.conditions import in_words, split
from auvbench.analysis.formatting import unit
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Comparison, Ranking, Row
from auvbench.analysis.rounding import NOTHING
from auvbench.analysis.study import ComparisonRow, thesis
from auvbench.reporting.tables.main import label_of
from auvbench.reporting.tables.table import (
    DAGGER,
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
    heading_of,
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


def conditions_table(ranking: Ranking) -> Table:
    """Return success in percent by condition; a dash where an agent did not meet one."""
    headings = [Heading("agent", words=True)]
    for condition in ranking.conditions:
        title, level = in_words(condition.name)
        headings.append(Heading(title, level, group=split(condition.name)[0]))
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


def across_table(table: Across) -> Table:
    """Return the agents over all tasks."""
    headings = (
        Heading("agent", words=True),
        Heading("seeds"),
        Heading("tasks"),
        Heading("IQM of success", "%"),
        Heading("optimality gap", "%"),
    )
    lines = [
        Line(
            (
                Cell(row.label),
                Cell(_seeds(row)),
                Cell(str(row.tasks)),
                *(estimate_cell(e, 100.0) for e in (row.iqm, row.gap)),
            )
        )
        for row in table.rows
    ]
    return Table(headings, tuple(lines))


def _seeds(row: Over) -> str:
    """Return the training seeds: '5', or '5, 3' where they differ from section to section."""
    if not row.trained:
        return NOTHING
    there = [n for n in row.trainings if n]
    return str(there[0]) if len(set(there)) == 1 else ", ".join(map(str, there))


def across_notes(table: Across) -> list[str]:
    """What the table shows, in sentences without markup."""
    over = (
        f"{len(table.sections)} sections ({', '.join(table.sections)})"
        if len(table.sections) > 1
        else "one section"
    )
    found = [
        f"Success over {table.tasks} task{'' if table.tasks == 1 else 's'}: every condition of protocol {table.protocol}, in "
        f"{over}. IQM: mean of the middle half of the scores of all trainings and tasks. Optimality gap: how far "
        "success stays below 100 % on average. In the order of the IQM, which is a description: agents are tested "
        "against each other within a section, never across.",
        f"Brackets: {100 * table.confidence:g} % stratified bootstrap intervals over training seeds, drawn section by section, for these tasks; "
        "with few seeds they hold less often than they say. Without brackets: nothing to train, or a section with one "
        "training seed.",
    ]
    if any(row.tasks < table.tasks for row in table.rows):
        found.append("Agents with fewer tasks stand last: their scores are not of the same tasks.")
    if table.uneven:
        found.append("Every training weighs alike, so that sections with more of them weigh more.")
    return found


def comparison_table(rows: Sequence[ComparisonRow]) -> Table:
    """Return the original study's numbers and ours: an agent per line, "theirs / ours [interval]" per measure."""
    measures = [name for name in thesis.TITLES if any(row.measure == name for row in rows)]
    titles = [Heading(thesis.TITLES[name], weight=i) for i, name in enumerate(measures)]
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
    theirs = f"{row.thesis:g} {row.mark}".rstrip()
    if row.ours is None:
        return Cell(f"{theirs} / {NOTHING}")
    ours = estimate_cell(row.ours)
    return Cell(f"{theirs} / {ours.value}", ours.more)
