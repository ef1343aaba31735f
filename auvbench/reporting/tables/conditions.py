"""Success under each condition of a protocol: agents down, conditions across, in the order of the ranking.

The rows are those of the ranking with the conditions in the place of the metrics, so that each format draws them as
it draws the ranking.
"""

from __future__ import annotations

from dataclasses import replace

from auvbench.analysis.conditions import in_words, split
from auvbench.analysis.model import Ranking
from auvbench.reporting.tables.blocks import blocks
from auvbench.reporting.tables.columns import DAGGER, Column, policies
from auvbench.reporting.tables.latex import HEAD, escape, floats

LEAD = ("rank", "agent")
IN_PRINT = 60
"""characters of all headings beside each other in a table for a paper"""


def by_condition(ranking: Ranking) -> tuple[Ranking, tuple[Column, ...]]:
    """The ranking with success by condition as its estimates, and the columns that show them."""
    rows = tuple(
        replace(
            row,
            estimates={c.name: c.success[row.label] for c in ranking.conditions if row.label in c.success},
        )
        for row in ranking.rows
    )
    return replace(ranking, rows=rows), tuple(_column(c.name) for c in ranking.conditions)


def _column(name: str) -> Column:
    factor, level = in_words(name)
    tex = escape(f"{factor} ({level})" if level else factor)
    return Column(name, factor, level, tex, 100.0)


def factor(column: Column) -> str:
    """What the condition of a column is a level of."""
    return split(column.metric)[0]


def note(ranking: Ranking) -> str:
    """What the table shows, in a sentence without markup."""
    percent = f"{100 * ranking.confidence:g} %"
    text = (
        f"Success (%) under each condition of protocol {ranking.protocol}, {percent} intervals; agents in the order "
        f"of the ranking, which is that of condition {ranking.condition}."
    )
    single = f" {DAGGER} one training seed: the interval covers test episodes only."
    return text + single if policies(ranking) else text


def _heading(column: Column) -> int:
    """Characters of the heading, and no less than an interval takes."""
    return max(len(column.title), len(column.unit) + 2, 11)


def conditions_latex(ranking: Ranking) -> str:
    r"""Tables to `\input`, as many as the conditions need; an empty string where the protocol has only one."""
    if not ranking.conditions:
        return ""
    rows, columns = by_condition(ranking)
    tables = []
    for i, shown in enumerate(blocks(columns, _heading, IN_PRINT, factor)):
        caption = escape(note(ranking)) if i == 0 else "Success by condition (continued)."
        tables += floats(rows, LEAD, shown, caption, f"conditions{i + 1}")
    return "\n\n".join([HEAD, *tables]) + "\n"
