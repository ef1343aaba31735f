"""The files that show all sections of a report at once."""

from __future__ import annotations

import csv as csv_module
import io
from collections.abc import Sequence
from pathlib import Path

from auvbench.analysis.aggregate import Across
from auvbench.analysis.records import Ranking
from auvbench.reporting import tables
from auvbench.reporting.figures import FIGURES
from auvbench.reporting.page.overview import Part
from auvbench.reporting.tables.markdown import escape
from auvbench.reporting.write import findings_in_markdown, text
from auvbench.untrusted.text import cell

OF_ONE_SECTION = ("table.tex", "conditions.tex", "conditions.csv", "comparisons.csv", "verdicts.json")
"""files that a report of one section writes and the overview of several does not"""


def markdown(path: Path, parts: Sequence[Part], over: Across | None = None) -> Path:
    """report.md: the table and the findings of each section, and where the rest of it is."""
    pieces = [
        "# Report",
        f"{len(parts)} sections: agents are compared on one vehicle and the same scenarios, never across.",
    ]
    if over is not None:
        pieces += ["## Over all tasks", tables.across_markdown(over).rstrip()]
    for part in parts:
        pieces += [
            f"## {escape(part.title[:1].upper() + part.title[1:])}",
            tables.markdown(part.ranking).rstrip(),
            findings_in_markdown(part.findings),
            f"[All of {escape(part.title)}](<{part.folder}/report.md>)",
        ]
    return text(path, "\n\n".join(filter(None, pieces)) + "\n")


def csv(path: Path, sections: Sequence[tuple[str, Ranking]]) -> Path:
    """table.csv: the rows of all sections, the vehicle before them; a column that a section lacks is empty there."""
    rows = [
        {"vehicle": cell(vehicle), **row}
        for vehicle, ranking in sections
        for row in csv_module.DictReader(io.StringIO(tables.csv(ranking)))
    ]
    columns = list(dict.fromkeys(column for row in rows for column in row))
    buffer = io.StringIO()
    writer = csv_module.DictWriter(buffer, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text(path, buffer.getvalue())


def clear(out: Path) -> None:
    """Removes what an earlier report of one section left in the folder: it would be taken for this one's."""
    stale = [out / name for name in OF_ONE_SECTION]
    stale += [out / "figures" / f"{name}{suffix}" for name in FIGURES for suffix in (".png", ".svg")]
    for path in stale:
        path.unlink(missing_ok=True)
