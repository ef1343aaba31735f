"""Write the formats of a report into a folder.

With several sections, each section has its own folder, and the folder of the report has an overview.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from auvbench.analysis.by_condition import Subject
from auvbench.analysis.options import Options
from auvbench.analysis.records import Ranking, Report
from auvbench.analysis.score import Scores
from auvbench.errors import UserError
from auvbench.reporting import page, tables
from auvbench.reporting import write as files
from auvbench.reporting.figures import Figure, draw_all
from auvbench.reporting.page.writer import write_overview
from auvbench.reporting.tables.table import Table
from auvbench.runs.atomic_io import make_folder
from auvbench.untrusted import path_safety


def write(
    report: Report,
    options: Options,
    command: str,
    out: Path,
    several: bool = False,
    subjects: Sequence[Subject] = (),
) -> tuple[Report, list[Path]]:
    """Write the requested formats of one section.

    Args:
        report: report of the section.
        options: options, including the formats to write.
        command: command line, for the page.
        out: folder of the report.
        several: whether the report has several sections.
        subjects: comparisons by condition; empty if the report has several sections.

    Returns:
        Report, and the paths of the written files. The report's problems include damage found while drawing figures.
    """
    shown = tables.by_condition_tables(subjects)
    try:
        make_folder(out)
    except OSError as error:
        raise UserError(f"cannot write into {out}: {error.strerror}") from error
    ranking = report.ranking
    written = []
    figures: Sequence[Figure] = ()
    if options.figures and {"md", "html"} & set(options.format):
        figures, problems = draw_all(report.agents, ranking, out)
        ranking = replace(ranking, problems=(*ranking.problems, *problems))
        report = replace(report, ranking=ranking)
    if "html" in options.format:
        written.append(
            page.write(out / "index.html", report, figures, shown, command=command, several=several)
        )
    if "md" in options.format:
        written.append(files.text(out / "report.md", files.markdown(report, figures, out, shown)))
    if "tex" in options.format:
        written.append(files.text(out / "table.tex", tables.latex(ranking)))
        printed = [
            tables.in_print(table, label)
            for table, label in zip(
                tables.conditions_tables(ranking), ("conditions", "measured"), strict=False
            )
        ]
        written += files.if_any(out / "conditions.tex", "\n".join(printed))
    if "csv" in options.format:
        written.append(files.text(out / "table.csv", tables.csv(ranking)))
        written += files.if_any(out / "comparisons.csv", tables.comparisons_csv(ranking.comparisons))
        written += files.if_any(out / "conditions.csv", tables.conditions_csv(ranking))
        written += files.if_any(out / "verdicts.json", files.verdicts([report]))
    return report, written + _by_condition(subjects, shown, options, out)


def _by_condition(
    subjects: Sequence[Subject], shown: Sequence[Table], options: Options, out: Path
) -> list[Path]:
    """Write the comparisons by condition as by_condition.csv and by_condition.tex, if the options name these formats.

    Without comparisons, remove these two files if an earlier report wrote them.
    """
    written = []
    if "tex" in options.format:
        printed = [tables.in_print(table, f"by-condition-{i}") for i, table in enumerate(shown, 1)]
        written += files.if_any(out / "by_condition.tex", "\n".join(printed))
    if "csv" in options.format:
        written += files.if_any(out / "by_condition.csv", tables.by_condition_csv(subjects))
    return written


def write_sections(
    reports: Sequence[Report],
    options: Options,
    command: str,
    out: Path,
    score: Scores | None,
    subjects: Sequence[Subject] = (),
) -> tuple[list[Report], list[Path]]:
    """Write each section into its own folder below `out`, and an overview: `index.html`, `report.md` and
    `table.csv`.

    Returns:
        Reports, and the paths of the overview's files; for a format without an overview, the paths of the sections'
            files. The reports' problems include damage found while drawing figures.
    """
    sections, below = [], []
    shown = tables.by_condition_tables(subjects)
    for report in reports:
        folder = out / report.section.folder
        path_safety.check_output(folder, ("figures",))
        section, written = write(report, options, command, folder, several=True)
        sections.append(section)
        below += written
    above = []
    if "html" in options.format:
        above.append(write_overview(out / "index.html", sections, command, score, shown))
    if "md" in options.format:
        above.append(files.text(out / "report.md", files.sections_markdown(sections, score, shown)))
    if "csv" in options.format:
        above.append(files.text(out / "table.csv", rows(sections, tables.csv)))
    files.clear(out)
    if "tex" in options.format:
        above += files.if_any(
            out / "score.tex", tables.in_print(tables.score_table(score) if score else None, "score")
        )
    if "csv" in options.format:
        above += files.if_any(out / "score.csv", tables.score_csv(score) if score else "")
    above += _by_condition(subjects, shown, options, out)
    return sections, above + [path for path in below if path.suffix not in {p.suffix for p in above}]


def rows(reports: Sequence[Report], draw: Callable[[Ranking], str]) -> str:
    """Return a CSV table of all sections; with several sections, one column names the section."""
    if len(reports) == 1:
        return draw(reports[0].ranking)
    return tables.joined("vehicle", [(r.section.vehicle, draw(r.ranking)) for r in reports])
