"""A study's own table next to ours, on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from auvbench.analysis.rounding import NOTHING, rounded
from auvbench.analysis.study import ComparisonRow

ON_SCREEN = ("success_rate", "mean_steps", "mean_deviation_mean_m")
"""the measures that fit; report.md has all"""


def comparison_terminal(rows: Sequence[ComparisonRow], width: int = 80) -> RenderableType:
    """A line per agent of the study: its number, ours, and the interval of ours; more measures on wider terminals."""
    table = Table(box=None, header_style="bold", pad_edge=False, title_justify="left")
    table.title = Text("the study's numbers and ours", style="bold")
    table.add_column("agent")
    table.add_column("ours")
    titles = {row.measure: row.title for row in rows}
    shown = [measure for measure in ON_SCREEN if measure in titles][: max(1, width // 40 - 1)]
    for measure in shown:
        table.add_column(titles[measure], justify="right", no_wrap=True)
        table.add_column("", justify="right", no_wrap=True)
        table.add_column("", style="dim", no_wrap=True)
    for agent in dict.fromkeys(row.agent for row in rows):
        mine = {row.measure: row for row in rows if row.agent == agent}
        label = next(iter(mine.values())).label
        cells = [cell for measure in shown for cell in _cells(mine.get(measure))]
        table.add_row(agent, label or Text("not run", style="dim"), *cells)
    note = "First the study's number (r: restored from its row's sums), then ours with its interval."
    return Group(table, Text(f"{note} report.md has all measures.", style="dim"))


def _cells(row: ComparisonRow | None) -> tuple[str, str, str]:
    if row is None:
        return NOTHING, "", ""
    theirs = f"{row.thesis:g}" + (f" {row.mark}" if row.mark else "")
    if row.ours is None:
        return theirs, NOTHING, ""
    value, low, high = rounded(row.ours)
    return theirs, value, f"[{low}, {high}]" if low else ""
