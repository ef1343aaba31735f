"""Build the tables other than the main table: ranks, conditions, the original study's numbers, scores across tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence

from auvbench.analysis import thesis
from auvbench.analysis.conditions import in_words
from auvbench.analysis.formatting import NOTHING, capitalized, fixed, name
from auvbench.analysis.records import Ranking, Row
from auvbench.analysis.score import Scored, Scores
from auvbench.analysis.thesis import ComparisonRow
from auvbench.reporting.tables.main import label_of, not_behind
from auvbench.reporting.tables.table import (
    DAGGER,
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
)
from auvbench.statistics.intervals import Estimate


def ranks_table(ranking: Ranking) -> Table:
    """Return the table of ranks: each agent's rank, its interval of ranks, and its value of the ranking measure."""
    column = column_of(ranking.rank_by)
    reliable = not_behind(ranking)
    lines = [
        Line(
            (
                Cell(label_of(row)),
                Cell(str(row.rank), sort=float(row.rank)),
                Cell(ranks_of(row), sort=row.rank + sum(row.rank_interval) / 1e6),
                estimate_cell(row.estimates.get(column.metric), column.scale),
                *(cell(row) for _, cell in reliable),
            )
        )
        for row in ranking.rows
    ]
    note = (
        "Ranks of typical trainings, with Holm's correction over all pairs of agents (comparisons.csv). Agents whose ranks do "
        "not overlap differ significantly."
    )
    headings = (
        Heading("agent", words=True),
        Heading("rank"),
        Heading("ranks"),
        column,
        *(heading for heading, _ in reliable),
    )
    return Table(headings, tuple(lines), "Ranks", (note,))


def ranks_of(row: Row) -> str:
    """Return an agent's interval of ranks as text: '3', '1 to 11'."""
    first, last = row.rank_interval
    return f"{first}" if first == last else f"{first} to {last}"


def conditions_tables(ranking: Ranking) -> list[Table]:
    """Return a table of success by condition and a table of the ranking measure; no tables for a single condition.

    If the ranking measure is a rate or a penalised time, its table is left out. A dash means that the agent was not
    tested under the condition.
    """
    if not ranking.conditions:
        return []
    measured = column_of(ranking.rank_by)
    unit = f" ({measured.unit})" if measured.unit else ""
    columns = [("Success (%)", 100.0, [c.success for c in ranking.conditions])]
    if any(c.measured for c in ranking.conditions):
        title = f"{capitalized(measured.title)}{unit}"
        columns.append((title, measured.scale, [c.measured for c in ranking.conditions]))
    headings = [Heading("agent", words=True)]
    for condition in ranking.conditions:
        title, level = in_words(condition.name)
        headings.append(Heading(title, level, weight=1))
    notes = [
        f"{100 * ranking.confidence:g} % intervals, each by itself; agents in the order of condition {ranking.condition}."
    ]
    if not all(row.compared for row in ranking.rows):
        notes.append(f"{DAGGER} one training seed: the interval covers test episodes only.")
    tables = []
    for title, scale, estimates in columns:
        lines = [
            Line(
                (Cell(label_of(row)), *(estimate_cell(values.get(row.label), scale) for values in estimates))
            )
            for row in ranking.rows
        ]
        caption = f"{title} under each condition of protocol {ranking.protocol}"
        tables.append(Table(tuple(headings), tuple(lines), caption, tuple(notes)))
    return tables


def comparison_table(rows: Sequence[ComparisonRow]) -> Table | None:
    """Return a table of the original study's numbers and our estimates, one row per agent: "theirs / ours [interval]".

    Return None without rows.
    """
    if not rows:
        return None
    measures = [name for name in thesis.TITLES if any(row.measure == name for row in rows)]
    titles = [Heading(thesis.TITLES[name], weight=1) for name in measures]
    lines = []
    for agent in thesis.AGENTS:
        row_of = {row.measure: row for row in rows if row.agent == agent}
        k, frequency = thesis.CELLS[agent[3:]]
        label = next((row.label for row in row_of.values()), "") or f"K={k:g} {frequency:g} Hz, not run"
        cells = [_theirs_and_ours(row_of.get(name)) for name in measures]
        lines.append(Line((Cell(f"{agent} ({label})"), *cells)))
    note = (
        "The original study (200 episodes, one training seed) / ours with its interval. r: restored from the row's sums; text: "
        "from the study's text. The study has no numbers for the other cells."
    )
    return Table((Heading("agent", words=True), *titles), tuple(lines), "The study's table and ours", (note,))


def _theirs_and_ours(row: ComparisonRow | None) -> Cell:
    if row is None:
        return Cell(NOTHING)
    theirs = f"{row.theirs.value:g} {row.theirs.mark}".rstrip()
    if row.ours is None:
        return Cell(f"{theirs} / {NOTHING}")
    ours = estimate_cell(row.ours)
    return Cell(f"{theirs} / {ours.value}", ours.more)


def score_table(scores: Scores) -> Table:
    """Return the table of scores: each agent's score over all tasks, and its score in each task.

    If the table has no rows, its notes give the reason.
    """
    headings = [Heading("agent", words=True), Heading("seeds"), Heading("score")]
    headings += [Heading(title, weight=1) for title in scores.titles]
    lines = tuple(Line(_scores_of(row)) for row in scores.rows)
    return Table(tuple(headings), lines, "Score across tasks", tuple(_score_notes(scores)))


def _scores_of(row: Scored) -> tuple[Cell, ...]:
    one_seed = row.trained and 1 in row.trainings
    seeds = ", ".join(map(str, dict.fromkeys(n for n in row.trainings if n))) if row.trained else NOTHING
    return (
        Cell(f"{row.label} {DAGGER}" if one_seed else row.label),
        Cell(seeds),
        _score(row.score),
        *(_score(Estimate(x, math.nan, math.nan)) for x in row.tasks),
    )


def _score(score: Estimate) -> Cell:
    if math.isnan(score.value):
        return Cell(NOTHING)
    interval = "" if math.isnan(score.low) else f"[{fixed(score.low, 2)}, {fixed(score.high, 2)}]"
    return Cell(fixed(score.value, 2), interval, score.value)


def _score_notes(scores: Scores) -> list[str]:
    if not scores.rows:
        return list(scores.notes)
    by = "; ".join(f"{title}: {name(m)}" for title, m in zip(scores.titles, scores.measures, strict=True))
    several = scores.cells > len(scores.titles)
    over = "seeds, tasks and conditions" if several else "seeds and tasks"
    notes = [
        f"Score: random is 0, PID is 1, linear between them in the measure of each task ({by}), on protocol "
        f"{scores.protocol}. The first column is the mean of the middle half of the scores over {over} (interquartile mean): an "
        "agent that fails at one task of five may still score 1. The other columns are means of all scores. Scores describe, and "
        "their order is not a test: each agent is tested against PID in the section of its task.",
        f"Brackets: {100 * scores.confidence:g} % bootstrap intervals over training seeds and test scenarios, drawn task by task; "
        "with few seeds they hold less often than they say.",
    ]
    if any(row.trained and 1 in row.trainings for row in scores.rows):
        notes.append(f"{DAGGER} one training seed on a task: no interval.")
    return [*notes, *scores.notes]
