"""Print tables and findings on a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.table import Table as RichTable
from rich.text import Text

from auvbench.analysis.findings import SHOWN
from auvbench.analysis.formatting import counted
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN, headline
from auvbench.analysis.records import Finding, Ranking
from auvbench.reporting.tables.main import grouped, main_table
from auvbench.reporting.tables.table import SHOWN_NOTES, Cell, Line, Table

MOST_PROBLEMS = 6
"""largest number of problems per kind on the terminal; the files list all problems"""
LABEL = 26
"""usual largest width of a label, characters; longer labels are wrapped"""
REMARK = 14
"""largest width of a remark below a value, characters; longer remarks are wrapped"""
NARROW = 8
"""smallest width of a label on a narrow terminal, characters"""
STYLES = {AHEAD: "green", EQUIVALENT: "blue", BEHIND: "red", OPEN: "yellow"}


class TableView:
    """View of a table and its notes for rich; columns that do not fit are left out, and a line below names them."""

    def __init__(self, table: Table) -> None:
        self.table = table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        headings = self.table.headings
        columns, room = set[int](), options.max_width
        always = [i for i, heading in enumerate(headings) if not heading.weight]
        gap = 2 if sum(self._width(i) + 2 for i in always) <= room else 1
        for i in sorted(range(len(headings)), key=lambda i: headings[i].weight):
            room -= self._width(i) + gap
            if room < 0 and headings[i].weight:
                break
            columns.add(i)
        if self.table.lines:
            other_width = sum(self._width(i) + gap for i in columns if i >= self.table.lead)
            yield _rendered(
                self.table, sorted(columns), max(options.max_width - other_width - gap, NARROW), gap
            )
        if hidden := [heading.text for i, heading in enumerate(headings) if i not in columns]:
            yield Text(f"Not shown, because the terminal is too narrow: {', '.join(hidden)}.", style="dim")
        for note in self.table.notes[:SHOWN_NOTES]:
            yield Text(note, style="dim")
        if (more := len(self.table.notes) - SHOWN_NOTES) > 0:
            yield Text(f"{counted(more, 'more note')} in report.md and on the page.", style="dim")

    def _width(self, i: int) -> int:
        """Return the width of a column on the terminal, without its padding."""
        heading = self.table.headings[i]
        texts = [text for line in self.table.lines for text in (line.cells[i].value, *_below(line.cells[i]))]
        widest = max(map(cell_len, (heading.title, heading.unit, *texts)))
        if i < self.table.lead:
            words = max((len(word) for text in texts for word in text.split()), default=0)
            widest = min(widest, max(words, LABEL))
        return widest


def _rendered(table: Table, columns: Sequence[int], room: int, gap: int) -> RichTable:
    """Return the given columns of a table as a table for rich.

    Args:
        table: table to show.
        columns: indices of the shown columns.
        room: largest width in characters of a column that identifies the row; longer texts are wrapped.
        gap: number of spaces between columns.
    """
    shown = RichTable(box=None, header_style="bold", pad_edge=False, padding=(0, 1, 0, gap - 1))
    for i in columns:
        heading = table.headings[i]
        title = Text.assemble(heading.title, (f"\n{heading.unit}" if heading.unit else "", "dim"))
        if i < table.lead:
            words = [len(word) for line in table.lines for word in line.cells[i].value.split()]
            widest = min(max(LABEL, *words, 5), room)
            shown.add_column(
                title, overflow="fold", min_width=min(max(words, default=5), room), max_width=widest
            )
        else:
            shown.add_column(title, justify="left" if heading.words else "right", no_wrap=True)
    for line in table.lines:
        shown.add_row(*(_stacked(line.cells[i], line) for i in columns))
    return shown


def _stacked(cell: Cell, line: Line) -> Text:
    # A verdict's cell has a symbol and a word, so that the verdict is clear without colours.
    text = Text(
        cell.value,
        style=STYLES.get(line.verdict, "")
        if line.verdict and cell.value.rstrip("*").endswith(line.verdict)
        else "",
    )
    for below in _below(cell):
        text.append(f"\n{below}", style="dim")
    return text


def _below(cell: Cell) -> list[str]:
    """Return the lines below a cell's value: an interval in one line, or a remark in wrapped lines."""
    return [cell.more] if cell.more.startswith("[") else textwrap.wrap(cell.more, REMARK)


def terminal(ranking: Ranking) -> RenderableType:
    """Return the headline, notices, the main table with its notes, and the problems, for `rich.console.Console.print`."""
    parts: list[RenderableType] = [Text(headline(ranking), style="bold"), Text()]
    parts += [Text(line, style="yellow") for line in ranking.notices]
    return Group(*parts, TableView(main_table(ranking)), *_problems(ranking))


def findings_terminal(findings: Sequence[Finding]) -> RenderableType:
    """Return the first findings as a list for rich, and the number of the other findings."""
    shown = findings[:SHOWN]
    table = RichTable.grid(padding=(0, 1))
    for finding in shown:
        basis = f" ({finding.basis})" if finding.basis else ""
        table.add_row("•", Text.assemble(finding.text, (basis, "dim")))
    if len(shown) < len(findings):
        table.add_row("", Text(f"{len(findings) - len(shown)} more in the written report", style="dim"))
    return table


def _problems(ranking: Ranking) -> list[RenderableType]:
    parts: list[RenderableType] = []
    for title, problems in grouped(ranking.problems):
        parts.append(Text(f"\n{title} ({len(problems)})", style="bold yellow"))
        lines = [Text.assemble((p.where, "bold"), f": {p.message}") for p in problems[:MOST_PROBLEMS]]
        if len(problems) > MOST_PROBLEMS:
            lines.append(Text(f"and {len(problems) - MOST_PROBLEMS} more (the written report lists all)"))
        parts += [Padding(line, (0, 0, 0, 2), expand=False) for line in lines]
    return parts
