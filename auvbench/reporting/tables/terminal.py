"""The table on a terminal: as many columns as fit, the most telling first."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from auvbench.reporting.model import Comparison, Finding, Ranking, Row
from auvbench.reporting.rounding import rounded
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.notes import grouped, notes

MOST_PROBLEMS = 6
"""per kind on screen; the files list all"""


class RankingTable:
    """A rich renderable that chooses its columns when it knows how wide the terminal is."""

    def __init__(self, ranking: Ranking) -> None:
        self.ranking = ranking

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        chosen, left_out = self._fitting(console, options.max_width)
        yield self._table(chosen)
        for line in notes(self.ranking):
            yield Text(line, style="dim")
        if left_out:
            names = ", ".join(column.title for column in left_out)
            yield Text(f"Not shown for want of width: {names}.", style="dim")
        yield from _problems(self.ranking)

    def _fitting(self, console: Console, width: int) -> tuple[list[c.Column], list[c.Column]]:
        usual = c.present(c.COLUMNS, self.ranking)
        by_weight = [c.COLUMNS[i] for i in c.BY_WEIGHT if c.COLUMNS[i] in usual]
        order = [*c.extra(self.ranking), *by_weight]
        fixed = console.measure(self._table(()), options=console.options.update(max_width=10_000)).maximum
        room = width - fixed
        kept: list[c.Column] = []
        for column in order:
            room -= self._width(column)
            if room < 0 and kept:
                break
            kept.append(column)
        shown = [column for column in (*c.extra(self.ranking), *usual) if column in kept]
        return shown, [column for column in usual if column not in shown]

    def _width(self, column: c.Column) -> int:
        """Of a column on screen, with its padding: measured here, since rich measures all columns anew each time."""
        texts = [text for row in self.ranking.rows for text in c.cell(row, column)]
        return max(map(cell_len, (column.title, column.unit, *texts))) + 2

    def _table(self, shown: Sequence[c.Column]) -> Table:
        table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 1, 0, 1))
        table.add_column("rank", justify="left", no_wrap=True)
        letters = c.letters(self.ranking)
        if letters:
            table.add_column("group", no_wrap=True)
        widest = max((len(word) for row in self.ranking.rows for word in row.label.split()), default=5)
        table.add_column("agent", overflow="fold", min_width=max(widest, 5))
        table.add_column("seeds", justify="right", no_wrap=True)
        for column in shown:
            table.add_column(
                Text.from_markup(f"{column.title}\n[dim]{column.unit}[/dim]"), justify="right", no_wrap=True
            )
        marked = c.one_seed_among_many(self.ranking)
        for row in self.ranking.rows:
            label = Text(row.label + (f" {c.DAGGER}" if row.label in marked else ""))
            if row.rank == 1:
                label.stylize("bold")
            group = [Text(row.group, style="cyan")] if letters else []
            table.add_row(
                c.rank(row), *group, label, c.seeds(row), *(_stacked(row, column) for column in shown)
            )
        return table


def _stacked(row: Row, column: c.Column) -> Text:
    value, interval = c.cell(row, column)
    text = Text(value)
    if interval:
        text.append(f"\n{interval}", style="dim")
    return text


def _problems(ranking: Ranking) -> RenderResult:
    for title, problems in grouped(ranking.problems):
        yield Text(f"\n{title} ({len(problems)})", style="bold yellow")
        for problem in problems[:MOST_PROBLEMS]:
            yield Padding(
                Text.assemble((problem.where, "bold"), f": {problem.message}"), (0, 0, 0, 2), expand=False
            )
        if len(problems) > MOST_PROBLEMS:
            yield Padding(
                Text(f"and {len(problems) - MOST_PROBLEMS} more (the written report lists all)"), (0, 0, 0, 2)
            )


def terminal(ranking: Ranking) -> RenderableType:
    """The ranked table, its note and the list of what is not in it, for `rich.console.Console.print`."""
    return RankingTable(ranking)


def comparisons_terminal(comparisons: Sequence[Comparison]) -> RenderableType:
    """Paired differences, Holm-corrected, for `Console.print`; nothing where there are none."""
    if not comparisons:
        return Group()
    table = Table(box=None, header_style="bold", pad_edge=False, title_justify="left")
    table.title = Text("paired differences", style="bold")
    for heading in ("agent", "against", "metric"):
        table.add_column(heading)
    for heading in ("difference", "p (Holm)", "does better"):
        table.add_column(heading, justify="right", no_wrap=True)
    for comparison in comparisons:
        table.add_row(comparison.first, comparison.second, comparison.metric, *difference(comparison))
    return table


def findings_terminal(findings: Sequence[Finding]) -> RenderableType:
    """Sentences, or numbered claims with their verdicts, with what stands behind them."""
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right", no_wrap=True)
    table.add_column()
    for i, finding in enumerate(findings, 1):
        text = Text(finding.text)
        if finding.verdict:
            text.append(f" {finding.verdict[0].upper()}{finding.verdict[1:]}.", style="bold")
        for more in (finding.statistic, finding.missing and f"Missing: {finding.missing}"):
            text.append(f" {more}" if more else "", style="dim")
        table.add_row(f"{i}." if finding.verdict else "•", text)
    return table


def difference(comparison: Comparison) -> tuple[str, str, str]:
    """Difference with interval, corrected p value, and probability of improvement in percent, as text."""
    percent = comparison.metric.endswith("_rate")
    value, low, high = rounded(comparison.difference, 100.0 if percent else 1.0)
    sign = "+" if comparison.difference.value > 0 else ""
    p = comparison.p_adjusted
    better = rounded(comparison.probability_of_improvement, 100.0)[0]
    shown = f"{sign}{value}{' points' if percent else ''}" + (f" [{low}, {high}]" if low else "")
    return shown, "< 0.001" if p < 0.001 else f"{p:.3f}", f"{better} %"
