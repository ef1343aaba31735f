"""A report of several sections: a folder with all files for each, and above them what shows all at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report import Report, write, write_over
from auvbench.commands.report_options import Options

if TYPE_CHECKING:
    from auvbench.analysis.aggregate import Across


def write_sections(
    reports: Sequence[Report], options: Options, command: str, out: Path, over: Across | None = None
) -> tuple[list[Report], list[Path]]:
    """Writes each section into a folder of its own below `out`, and `index.html`, `report.md` and `table.csv` of all.

    Returns:
        the reports, with what drawing found damaged, and the files of the overview or, where the formats have
        none, of the sections.
    """
    from auvbench.reporting import tables
    from auvbench.reporting import write as files
    from auvbench.reporting.page.writer import write_overview
    from auvbench.reporting.write import Part, text

    whole, below = [], []
    for report in reports:
        folder = out / report.section.folder
        found, written = write(report, options, command, folder, report.section.title)
        whole.append(found)
        below += written
    parts = [Part(r.section.title, r.section.folder, r.ranking, r.agents, r.runs, r.findings) for r in whole]
    above = []
    if "html" in options.format:
        above.append(write_overview(out / "index.html", parts, command, over))
    if "md" in options.format:
        above.append(files.sections_markdown(out / "report.md", parts, over))
    if "csv" in options.format:
        rows = tables.joined("vehicle", [(r.section.vehicle, tables.csv(r.ranking)) for r in whole])
        above.append(text(out / "table.csv", rows))
    above += write_over(over, options, out)
    files.clear(out)
    return whole, above + [path for path in below if path.suffix not in {p.suffix for p in above}]
