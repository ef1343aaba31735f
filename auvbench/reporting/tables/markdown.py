"""Tables as Markdown (GitHub's pipes)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from auvbench.analysis.aggregate import Across
from auvbench.analysis.headline import headline
from auvbench.analysis.records import Ranking
from auvbench.analysis.study import ComparisonRow
from auvbench.reporting.tables.appendix import (
    COMPARISON_NOTE,
    across_notes,
    across_table,
    comparison_table,
    conditions_note,
    conditions_table,
    ranks_table,
)
from auvbench.reporting.tables.main import main_table
from auvbench.reporting.tables.notes import grouped, notes
from auvbench.reporting.tables.table import Table


def escape(text: str) -> str:
    r"""Text that Markdown takes literally inside a cell.

    >>> print(escape("a|b_c<d>"))
    a\|b\_c&lt;d&gt;
    """
    for character in "\\`*_|[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("<", "&lt;").replace(">", "&gt;")


def pipes(table: Table) -> str:
    """Return a pipe table; intervals stand behind their values."""
    rules = ["---" if heading.words else "---:" for heading in table.headings]
    headings = [escape(heading.text) for heading in table.headings]
    return rows([headings, rules, *([escape(cell.text) for cell in line.cells] for line in table.lines)])


def rows(cells: Iterable[Iterable[str]]) -> str:
    """Return rows of Markdown between pipes: headings, rules, entries."""
    return "\n".join("| " + " | ".join(row) + " |" for row in cells)


def markdown(ranking: Ranking, figure: str = "") -> str:
    """Return the headline, the main figure, the main table, its notes and the list of what is not in it.

    Args:
        ranking: the table.
        figure: the main figure as Markdown.
    """
    parts = [f"**{escape(headline(ranking))}**", *filter(None, [figure]), *map(escape, ranking.notices)]
    parts.append(pipes(main_table(ranking)))
    parts.append("\n".join(f"* {escape(line)}" for line in notes(ranking)))
    for title, problems in grouped(ranking.problems):
        lines = [f"- {escape(p.where)}: {escape(p.message)}" for p in problems]
        parts.append("\n".join([f"**{title[0].upper()}{title[1:]} ({len(problems)})**", "", *lines]))
    return "\n\n".join(parts) + "\n"


def conditions_markdown(ranking: Ranking) -> str:
    """Return success under each condition of the protocol; an empty string where it has only one."""
    if not ranking.conditions:
        return ""
    return f"{pipes(conditions_table(ranking))}\n\n{escape(conditions_note(ranking))}\n"


def ranks_markdown(ranking: Ranking) -> str:
    """Return the ranks with their intervals and group letters: the exploratory part."""
    return pipes(ranks_table(ranking)) + "\n"


def across_markdown(table: Across) -> str:
    """Return the agents over all tasks, and their notes."""
    return pipes(across_table(table)) + "\n\n" + "\n".join(map(escape, across_notes(table))) + "\n"


def comparison_markdown(rows: Sequence[ComparisonRow]) -> str:
    """Return the original study's numbers and ours."""
    return f"{pipes(comparison_table(rows))}\n\n{COMPARISON_NOTE}\n"
