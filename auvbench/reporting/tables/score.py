"""The table of scores across tasks."""

from __future__ import annotations

import math

from auvbench.analysis.formatting import NOTHING, fixed, name
from auvbench.analysis.score import Scored, Scores
from auvbench.reporting.tables.table import DAGGER, Cell, Heading, Line, Table
from auvbench.reporting.tables.text_formats import escape, lines, pipes
from auvbench.statistics.intervals import Estimate


def score_table(found: Scores) -> Table:
    """Return the score of each agent over all tasks, then that of each task."""
    headings = [Heading("agent", words=True), Heading("seeds"), Heading("score")]
    headings += [Heading(title) for title in found.titles]
    return Table(tuple(headings), tuple(Line(_cells(row)) for row in found.rows))


def _cells(row: Scored) -> tuple[Cell, ...]:
    one_seed = row.trained and 1 in row.trainings
    seeds = ", ".join(map(str, dict.fromkeys(n for n in row.trainings if n))) if row.trained else NOTHING
    return (
        Cell(f"{row.label} {DAGGER}" if one_seed else row.label),
        Cell(seeds),
        _cell(row.score),
        *(_cell(Estimate(x, math.nan, math.nan)) for x in row.tasks),
    )


def _cell(score: Estimate) -> Cell:
    if math.isnan(score.value):
        return Cell(NOTHING)
    interval = "" if math.isnan(score.low) else f"[{fixed(score.low, 2)}, {fixed(score.high, 2)}]"
    return Cell(fixed(score.value, 2), interval, score.value)


def score_notes(found: Scores) -> list[str]:
    """Return what the table shows, in sentences without markup."""
    if not found.rows:
        return list(found.notes)
    by = "; ".join(f"{title}: {name(m)}" for title, m in zip(found.titles, found.measures, strict=True))
    several = found.cells > len(found.titles)
    over = "seeds, tasks and conditions" if several else "seeds and tasks"
    notes = [
        f"Score: random is 0, PID is 1, linear between them in the measure of each task ({by}), on protocol "
        f"{found.protocol}. The first column is the interquartile mean over {over}, which leaves out the lowest and the highest "
        "quarter: an agent that fails at one task of five may still score 1. The others are means. It is a description: agents "
        "are tested against PID in the section of each task.",
        f"Brackets: {100 * found.confidence:g} % bootstrap intervals over training seeds, drawn task by task; with few seeds "
        "they hold less often than they say. Controllers have none: nothing is trained.",
    ]
    if any(row.trained and 1 in row.trainings for row in found.rows):
        notes.append(f"{DAGGER} one training seed on a task: no interval.")
    return [*notes, *found.notes]


def score_csv(found: Scores) -> str:
    """Return a row per agent in full precision; an empty string without a score."""
    if not found.rows:
        return ""
    keys = list(dict.fromkeys(key for row in found.rows for key in row.key))
    header = ["agent", *keys, "protocol", "confidence", "score", "score_low", "score_high"]
    header += [f"{what}: {title}" for what in ("score", "measure", "seeds") for title in found.titles]
    measures = [m.name for m in found.measures]
    rows = []
    for row in found.rows:
        line = [row.label, *(row.key.get(key) for key in keys), found.protocol, found.confidence]
        line += [row.score.value, row.score.low, row.score.high, *row.tasks, *measures, *row.trainings]
        rows.append(line)
    return lines(header, rows)


def score_markdown(found: Scores) -> str:
    """Return the table and its notes."""
    table = [pipes(score_table(found))] if found.rows else []
    return "\n\n".join([*table, "\n".join(f"* {escape(line)}" for line in score_notes(found))]) + "\n"
