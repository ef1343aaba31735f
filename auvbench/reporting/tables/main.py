"""The main table: each agent's difference from the baseline, with what a reader needs to judge it."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from auvbench.analysis.formatting import NOTHING, name, unit
from auvbench.analysis.labels import in_short
from auvbench.analysis.measures import measure
from auvbench.analysis.planning import MOST_EPISODES
from auvbench.analysis.primary import AHEAD, BEHIND, EQUIVALENT, OPEN
from auvbench.analysis.records import Needed, Ranking, Row
from auvbench.reporting.tables.notes import notes
from auvbench.reporting.tables.table import (
    DAGGER,
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
)
from auvbench.statistics.intervals import wilson
from auvbench.statistics.power import MOST_SEEDS

SYMBOLS = {AHEAD: "▲", EQUIVALENT: "■", BEHIND: "▼", OPEN: "○"}
"""a verdict is told by its shape as well as by its colour"""
BASELINE = "baseline"
USUAL = {"success_rate": 1, "mean_energy_J": 3, "action_ms": 4}
"""metrics behind the primary one, with their weight where there is no room for all"""

LONGEST = 16
"""characters of a baseline that a heading names"""

_Column = tuple[Heading, Callable[[Row], Cell]]


def main_table(ranking: Ranking) -> Table:
    """Return the main table; a column that no agent has a number for is left out."""
    columns = [*_lead(ranking), *_metric(ranking, ranking.rank_by), *_against(ranking)]
    for metric, weight in (USUAL | dict.fromkeys(ranking.columns, 1)).items():
        if metric != ranking.rank_by:
            columns += _metric(ranking, metric, weight)
    lines = tuple(
        Line(tuple(cell(row) for _, cell in columns), verdict_of(ranking, row.label)) for row in ranking.rows
    )
    by = name(measure(ranking.rank_by))
    against = f" against {ranking.primary.baseline}" if ranking.primary else ""
    title = f"Agents{against} in {by} on protocol {ranking.protocol}."
    return Table(tuple(heading for heading, _ in columns), lines, title, tuple(notes(ranking)))


def verdict_of(ranking: Ranking, label: str) -> str:
    """Return an agent's verdict, 'baseline' for the baseline, '' where nothing is compared."""
    if ranking.primary is None:
        return ""
    against = ranking.primary.of(label)
    return against.verdict if against else BASELINE


def label_of(row: Row) -> str:
    """Return the label, with a dagger for one training seed."""
    return row.label if row.compared else f"{row.label} {DAGGER}"


def needed_text(needed: Needed | None) -> str:
    """Return what would decide an open comparison: '(9 seeds)', '(> 128 seeds)'; '' where that is not known."""
    if needed is None:
        return ""
    most = MOST_SEEDS if needed.unit == "seeds" else MOST_EPISODES
    return f"(> {most} {needed.unit})" if needed.count is None else f"({needed.count} {needed.unit})"


def _lead(ranking: Ranking) -> list[_Column]:
    columns: list[_Column] = [(Heading("agent", words=True), lambda row: Cell(label_of(row)))]
    if any(row.trained for row in ranking.rows):
        columns.append((Heading("budget", "steps", weight=1), _budget))
        heading = Heading("trainings that succeeded", weight=2)
        columns.append((heading, lambda row: _trainings(row, ranking.confidence)))
    return columns


def _budget(row: Row) -> Cell:
    if not row.budget or not any(row.budget):
        return Cell(NOTHING)
    ends = dict.fromkeys(in_short(steps) for steps in (row.budget[0], row.budget[-1]))
    return Cell(" to ".join(ends), sort=float(row.budget[-1]))


def _trainings(row: Row, confidence: float) -> Cell:
    """Return "5 of 5 [57, 100]": Wilson's interval of the share of trainings that succeed."""
    if not row.trained:
        return Cell(NOTHING)
    n = len(row.seeds)
    low, high = (f"{100 * float(end):.0f}" for end in wilson(row.succeeded, n, confidence))
    return Cell(f"{row.succeeded} of {n}", f"[{low}, {high}]", row.succeeded / n)


def _metric(ranking: Ranking, metric: str, weight: int = 0) -> list[_Column]:
    if not any(metric in row.estimates for row in ranking.rows):
        return []
    column = column_of(metric, weight)
    return [(column, lambda row: estimate_cell(row.estimates.get(metric), column.scale))]


def _against(ranking: Ranking) -> list[_Column]:
    primary = ranking.primary
    if primary is None:
        return []
    m = measure(ranking.rank_by)

    def difference(row: Row) -> Cell:
        against = primary.of(row.label)
        if against is None or not isfinite(against.difference.low):  # one training: not compared
            return Cell(NOTHING)
        return estimate_cell(against.difference, 100.0 if m.rate else 1.0, signed=True)

    def verdict(row: Row) -> Cell:
        against = primary.of(row.label)
        if against is None:
            return Cell(BASELINE)
        order = float((AHEAD, EQUIVALENT, OPEN, BEHIND).index(against.verdict))
        return Cell(f"{SYMBOLS[against.verdict]} {against.verdict}", needed_text(against.needed), order)

    points = "points" if m.rate else unit(m).strip()
    title = f"from {primary.baseline}" if len(primary.baseline) <= LONGEST else "difference"
    return [
        (Heading(title, points), difference),
        (Heading("result", words=True), verdict),
    ]
