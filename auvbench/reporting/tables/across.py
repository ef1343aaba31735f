"""Agents over all conditions and vehicles of a report: the one table that is not of one section."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from auvbench.analysis.aggregate import Across, Over
from auvbench.analysis.rounding import NOTHING, rounded
from auvbench.reporting.tables.comma import lines
from auvbench.reporting.tables.latex import HEAD
from auvbench.reporting.tables.latex import escape as in_latex
from auvbench.reporting.tables.markdown import escape as in_markdown
from auvbench.reporting.tables.markdown import pipes
from auvbench.statistics.estimate import Estimate

HEADINGS = ("agent", "seeds", "tasks", "IQM of success (%)", "optimality gap (%)")


def cells(row: Over) -> tuple[str, ...]:
    """The texts of a row, under `HEADINGS`."""
    return (row.label, _seeds(row), str(row.tasks), *(_text(e) for e in (row.iqm, row.gap)))


def _seeds(row: Over) -> str:
    """Training seeds: '5', or '5, 3' where they differ from section to section."""
    if not row.trained:
        return NOTHING
    there = [n for n in row.trainings if n]
    return str(there[0]) if len(set(there)) == 1 else ", ".join(map(str, there))


def _text(estimate: Estimate) -> str:
    value, low, high = rounded(estimate, 100.0)
    return f"{value} [{low}, {high}]" if low else value


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
    """For `rich.console.Console.print`."""
    shown = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 1, 0, 1))
    for i, heading in enumerate(HEADINGS):
        title, bracket, unit = heading.partition(" (")
        text = Text.assemble(title, (f"\n({unit}" if bracket else "", "dim"))
        shown.add_column(text, justify="right" if i else "left", overflow="fold", no_wrap=bool(i))
    for row in table.rows:
        shown.add_row(*(Text(text) for text in cells(row)))
    return Group(
        Text("over all tasks", style="bold"), shown, *(Text(line, style="dim") for line in notes(table))
    )


def across_markdown(table: Across) -> str:
    """A pipe table and its notes."""
    rows = [[in_markdown(text) for text in cells(row)[:1]] + list(cells(row)[1:]) for row in table.rows]
    return pipes(HEADINGS, rows, 1) + "\n\n" + "\n".join(in_markdown(line) for line in notes(table)) + "\n"


def across_latex(table: Across) -> str:
    r"""A table to `\input`."""
    rows = [" & ".join(map(in_latex, cells(row))) + r" \\" for row in table.rows]
    return (
        "\n".join(
            [
                HEAD,
                r"\begin{table}[htbp]",
                r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
                rf"\caption{{{in_latex(' '.join(notes(table)))}}}\label{{tab:auvbench-across}}",
                r"\begin{tabular}{@{}lrrrr@{}}",
                r"\toprule",
                " & ".join(map(in_latex, HEADINGS)) + r" \\",
                r"\midrule",
                *rows,
                r"\bottomrule",
                r"\end{tabular}",
                r"\end{table}",
            ]
        )
        + "\n"
    )


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
