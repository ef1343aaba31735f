"""The table as Markdown (GitHub's pipes)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from auvbench.analysis.model import Comparison, Ranking
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.conditions import LEAD, by_condition, note
from auvbench.reporting.tables.notes import grouped, notes
from auvbench.reporting.tables.terminal import difference


def escape(text: str) -> str:
    r"""Text that Markdown takes literally inside a cell.

    >>> print(escape("a|b_c<d>"))
    a\|b\_c&lt;d&gt;
    """
    for character in "\\`*_|[]":
        text = text.replace(character, f"\\{character}")
    return text.replace("<", "&lt;").replace(">", "&gt;")


def pipes(headings: Sequence[str], rows: Iterable[Sequence[str]], right_from: int) -> str:
    """A pipe table; columns from `right_from` on are aligned right."""
    rule = ["---" if i < right_from else "---:" for i in range(len(headings))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (headings, rule, *rows))


def markdown(ranking: Ranking) -> str:
    """The ranked table, its note and the list of what is not in it."""
    shown = (*c.extra(ranking), *c.present(c.COLUMNS, ranking))
    parts = [escape(line) for line in ranking.notices]
    parts += [_table(ranking, c.lead(ranking), shown), "\n".join(escape(line) for line in notes(ranking))]
    for title, problems in grouped(ranking.problems):
        lines = [f"- {escape(p.where)}: {escape(p.message)}" for p in problems]
        parts.append("\n".join([f"**{title[0].upper()}{title[1:]} ({len(problems)})**", "", *lines]))
    return "\n\n".join(parts) + "\n"


def _table(ranking: Ranking, lead: Sequence[str], shown: Sequence[c.Column]) -> str:
    marked = c.policies(ranking)
    rows = [
        [
            *map(escape, c.lead_cells(row, lead, marked)),
            *(" ".join(filter(None, c.cell(row, column))) for column in shown),
        ]
        for row in ranking.rows
    ]
    return pipes([*lead, *(x.heading for x in shown)], rows, lead.index("agent") + 1)


def conditions_markdown(ranking: Ranking) -> str:
    """Success under each condition of the protocol; an empty string where it has only one."""
    if not ranking.conditions:
        return ""
    rows, shown = by_condition(ranking)
    return f"{_table(rows, LEAD, shown)}\n\n{escape(note(ranking))}\n"


def comparisons_markdown(comparisons: Sequence[Comparison]) -> str:
    """Paired differences, Holm-corrected; an empty string where there are none."""
    if not comparisons:
        return ""
    rows = [[escape(x.first), escape(x.second), escape(x.metric), *difference(x)] for x in comparisons]
    return (
        pipes(["agent", "against", "metric", "difference", "p (Holm)", "verdict", "does better"], rows, 3)
        + "\n"
    )
