"""Success under each condition of a protocol: agents down, conditions across, in the order of the main table."""

from __future__ import annotations

from auvbench.analysis.conditions import in_words, split
from auvbench.analysis.records import Ranking
from auvbench.reporting.tables.columns import DAGGER
from auvbench.reporting.tables.main import label_of
from auvbench.reporting.tables.table import Cell, Heading, Line, Table, estimate_cell


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
