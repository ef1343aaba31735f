"""Agents over all conditions and vehicles of a report: the one table that is not of one section."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from auvbench.analysis.aggregate import Across, Over
from auvbench.analysis.rounding import NOTHING
from auvbench.reporting.tables.csv import lines
from auvbench.reporting.tables.latex import HEAD, floats
from auvbench.reporting.tables.markdown import escape, pipes
from auvbench.reporting.tables.table import Cell, Heading, Line, Table, estimate_cell
from auvbench.reporting.tables.terminal import TableView


def across_table(table: Across) -> Table:
    """Return the agents over all tasks."""
    headings = (
        Heading("agent", words=True),
        Heading("seeds"),
        Heading("tasks"),
        Heading("IQM of success", "%"),
        Heading("optimality gap", "%"),
    )
    lines = [
        Line(
            (
                Cell(row.label),
                Cell(_seeds(row)),
                Cell(str(row.tasks)),
                *(estimate_cell(e, 100.0) for e in (row.iqm, row.gap)),
            )
        )
        for row in table.rows
    ]
    return Table(headings, tuple(lines))


def _seeds(row: Over) -> str:
    """Return the training seeds: '5', or '5, 3' where they differ from section to section."""
    if not row.trained:
        return NOTHING
    there = [n for n in row.trainings if n]
    return str(there[0]) if len(set(there)) == 1 else ", ".join(map(str, there))


def notes(table: Across) -> list[str]:
    """What the table shows, in sentences without markup."""
    over = (
        f"{len(table.sections)} sections ({', '.join(table.sections)})"
        if len(table.sections) > 1
        else "one section"
    )
    found = [
        f"Success over {table.tasks} task{'' if table.tasks == 1 else 's'}: every condition of protocol {table.protocol}, in "
        f"{over}. IQM: mean of the middle half of the scores of all trainings and tasks. Optimality gap: how far "
        "success stays below 100 % on average. In the order of the IQM, which is a description: agents are tested "
        "against each other within a section, never across.",
        f"Brackets: {100 * table.confidence:g} % stratified bootstrap intervals over training seeds, drawn section by section, for these tasks; "
        "with few seeds they hold less often than they say. Without brackets: nothing to train, or a section with one "
        "training seed.",
    ]
    if any(row.tasks < table.tasks for row in table.rows):
        found.append("Agents with fewer tasks stand last: their scores are not of the same tasks.")
    if table.uneven:
        found.append("Every training weighs alike, so that sections with more of them weigh more.")
    return found


def across_terminal(table: Across) -> RenderableType:
    """Return the table for `rich.console.Console.print`."""
    lines = [Text(line, style="dim") for line in notes(table)]
    return Group(Text("over all tasks", style="bold"), TableView(across_table(table)), *lines)


def across_markdown(table: Across) -> str:
    """Return a pipe table and its notes."""
    return pipes(across_table(table)) + "\n\n" + "\n".join(map(escape, notes(table))) + "\n"


def across_latex(table: Across) -> str:
    r"""Return a table to `\input`."""
    return "\n\n".join([HEAD, *floats(across_table(table), " ".join(notes(table)), "across")]) + "\n"


def across_csv(table: Across) -> str:
    """A row per agent in full precision, shares from 0 to 1; the seeds of each section in its own column."""
    keys = list(dict.fromkeys(key for row in table.rows for key in row.key))
    header = ["agent", *keys, "tasks", "confidence"]
    header += [f"{name}{end}" for name in ("iqm_success", "optimality_gap") for end in ("", "_low", "_high")]
    header += [f"seeds: {title}" for title in table.sections]
    return lines(header, [_line(row, keys, table.confidence) for row in table.rows])


def _line(row: Over, keys: Sequence[str], confidence: float) -> list[object]:
    ends = [number for e in (row.iqm, row.gap) for number in (e.value, e.low, e.high)]
    return [row.label, *(row.key.get(key) for key in keys), row.tasks, confidence, *ends, *row.trainings]
