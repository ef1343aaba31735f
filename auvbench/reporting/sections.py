"""The files that show all sections of a report at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from auvbench.analysis.aggregate import Across
from auvbench.reporting import tables
from auvbench.reporting.figures import FIGURES
from auvbench.reporting.page.overview import Part
from auvbench.reporting.tables.markdown import escape
from auvbench.reporting.write import findings_in_markdown, text

OF_ONE_SECTION = ("table.tex", "conditions.tex", "conditions.csv", "comparisons.csv", "verdicts.json")
"""files that a report of one section writes and the overview of several does not"""


def markdown(path: Path, parts: Sequence[Part], over: Across | None = None) -> Path:
    """Write report.md with the table and the findings of each section, and a link to its own report."""
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


def clear(out: Path) -> None:
    """Remove the files of an earlier report of one section from the folder."""
    stale = [out / name for name in OF_ONE_SECTION]
    stale += [out / "figures" / f"{name}{suffix}" for name in FIGURES for suffix in (".png", ".svg")]
    for path in stale:
        path.unlink(missing_ok=True)
