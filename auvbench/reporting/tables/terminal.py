"""The table on a terminal: as many columns as fit, the most telling first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from auvbench.analysis.model import Comparison, Finding, Ranking, Row
from auvbench.analysis.rounding import rounded
from auvbench.reporting.tables import columns as c
from auvbench.reporting.tables.blocks import blocks
from auvbench.reporting.tables.conditions import LEAD, by_condition, factor, note
from auvbench.reporting.tables.notes import grouped, notes

MOST_PROBLEMS = 6
"""per kind on screen; the files list all"""
NEEDLESS = ("seeds", "group")
"""columns before the metrics that a terminal too narrow for all does without, in this order"""
LABEL = 26
"""characters of a label beside each other"""
MOST_ROWS = 20
"""of success by condition, which takes several tables on a narrow screen"""


class RankingTable:
    """A rich renderable that chooses its columns when it knows how wide the terminal is."""

    def __init__(self, ranking: Ranking) -> None:
        self.ranking = ranking

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        lead, chosen, left_out = self._fitting(console, options.max_width)
        for line in self.ranking.notices:
            yield Text(line, style="yellow")
        yield _table(self.ranking, lead, chosen)
        for line in notes(self.ranking):
            yield Text(line, style="dim")
        if left_out:
            yield Text(f"Not shown for want of width: {', '.join(left_out)}.", style="dim")
        yield from _problems(self.ranking)

    def _fitting(self, console: Console, width: int) -> tuple[list[str], list[c.Column], list[str]]:
        """Headings of the first columns, the metrics that fit, what it is ranked by first, and what does not fit."""
        usual = c.present(c.COLUMNS, self.ranking)
        asked = [column for column in c.extra(self.ranking) if column.metric in self.ranking.columns]
        by_weight = [c.COLUMNS[i] for i in c.BY_WEIGHT if c.COLUMNS[i] in usual]
        order = [*c.extra(self.ranking), *by_weight]
        order.sort(key=lambda column: column.metric != self.ranking.rank_by)
        lead = list(c.lead(self.ranking))
        for heading in NEEDLESS:  # before what it is ranked by would be cut
            if (
                heading in lead
                and _fixed(console, self.ranking, lead) + _width(self.ranking, order[0]) > width
            ):
                lead.remove(heading)
        room = width - _fixed(console, self.ranking, lead)
        kept: list[c.Column] = []
        for column in order:
            room -= _width(self.ranking, column)
            if room < 0 and kept:
                break
            kept.append(column)
        shown = [column for column in (order[0], *usual, *order) if column in kept]
        left_out = [heading for heading in c.lead(self.ranking) if heading not in lead]
        left_out += [
            column.title for column in dict.fromkeys((*order[:1], *asked, *usual)) if column not in shown
        ]
        return lead, list(dict.fromkeys(shown)), left_out


class ConditionsTable:
    """Success by condition: one table after the other where the terminal is narrower than all conditions."""

    def __init__(self, ranking: Ranking) -> None:
        self.ranking = ranking
        rows, self.columns = by_condition(ranking)
        self.rows = replace(rows, rows=rows.rows[:MOST_ROWS])

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        room = options.max_width - _fixed(console, self.rows, LEAD)
        for shown in blocks(self.columns, lambda column: _width(self.rows, column), room, factor):
            yield _table(self.rows, LEAD, shown)
            yield Text()
        yield Text(note(self.ranking), style="dim")
        if len(self.ranking.rows) > MOST_ROWS:
            yield Text(f"The best {MOST_ROWS} agents; the written report has all.", style="dim")


def _fixed(console: Console, ranking: Ranking, lead: Sequence[str]) -> int:
    """Width of the table without any metric."""
    wide = console.options.update(max_width=10_000)
    return console.measure(_table(ranking, lead, ()), options=wide).maximum


def _width(ranking: Ranking, column: c.Column) -> int:
    """Of a column on screen, with its padding: measured here, since rich measures all columns anew each time."""
    texts = [text for row in ranking.rows for text in c.cell(row, column)]
    return max(map(cell_len, (column.title, column.unit, *texts))) + 2


def _table(ranking: Ranking, lead: Sequence[str], shown: Sequence[c.Column]) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 1, 0, 1))
    widest = max((len(word) for row in ranking.rows for word in row.label.split()), default=5)
    for heading in lead:
        if heading == "agent":
            # Of two lines, as the numbers are: a long label leaves room for them.
            table.add_column(heading, overflow="fold", min_width=max(widest, 5), max_width=max(widest, LABEL))
        else:
            table.add_column(heading, justify="right" if heading == "seeds" else "left", no_wrap=True)
    for column in shown:
        table.add_column(
            Text.assemble(f"{column.title}\n", (column.unit, "dim")), justify="right", no_wrap=True
        )
    marked = c.policies(ranking)
    for row in ranking.rows:
        styles = {"group": "cyan", "agent": "bold" if row.rank == 1 else ""}
        cells = [
            Text(text, style=styles.get(heading, ""))
            for heading, text in zip(lead, c.lead_cells(row, lead, marked), strict=True)
        ]
        table.add_row(*cells, *(_stacked(row, column) for column in shown))
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


def conditions_terminal(ranking: Ranking) -> RenderableType:
    """Success under each condition of the protocol, for `Console.print`; nothing where it has only one."""
    return ConditionsTable(ranking) if ranking.conditions else Group()


def comparisons_terminal(comparisons: Sequence[Comparison]) -> RenderableType:
    """Paired differences, Holm-corrected, for `Console.print`; nothing where there are none."""
    if not comparisons:
        return Group()
    table = Table(box=None, header_style="bold", pad_edge=False, title_justify="left")
    others, metrics = ({getattr(c, name) for c in comparisons} for name in ("second", "metric"))
    title = "paired differences"
    title += f" in {next(iter(metrics))}" if len(metrics) == 1 else ""
    title += f" from {next(iter(others))}" if len(others) == 1 else ""
    table.title = Text(title, style="bold")
    # What is the same in all rows stands in the title: a narrow terminal has no room to say it again.
    named = [("agent", "first")] + [("against", "second")] * (len(others) > 1)
    named += [("metric", "metric")] * (len(metrics) > 1)
    for heading, _ in named:
        table.add_column(heading, overflow="fold")
    for heading in ("difference", "p (Holm)", "verdict", "does better"):
        table.add_column(heading, justify="right", no_wrap=True)
    for comparison in comparisons:
        # As Text: a label with brackets is no markup.
        names = (Text(getattr(comparison, field)) for _, field in named)
        table.add_row(*names, *difference(comparison))
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


def difference(comparison: Comparison) -> tuple[str, str, str, str]:
    """Difference with interval, corrected p value, verdict, and probability of improvement in percent, as text."""
    percent = comparison.metric.endswith("_rate")
    value, low, high = rounded(comparison.difference, 100.0 if percent else 1.0)
    sign = "+" if comparison.difference.value > 0 else ""
    p = comparison.p_adjusted
    better = rounded(comparison.probability_of_improvement, 100.0)[0]
    shown = f"{sign}{value}{' points' if percent else ''}" + (f" [{low}, {high}]" if low else "")
    return shown, "< 0.001" if p < 0.001 else f"{p:.3f}", comparison.verdict, f"{better} %"
