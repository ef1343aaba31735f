"""Show a report on a terminal; write several sections into a folder each, with an overview above them."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report import write
from auvbench.commands.report_options import Options
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.analysis.records import Agent, Ranking, Report
    from auvbench.analysis.score import Scores


def across_tasks(reports: Sequence[Report], options: Options) -> Scores | None:
    """Return the score across tasks; None for one task.

    Of several sections with the same task, the largest counts.
    """
    from auvbench.analysis import score
    from auvbench.analysis.measures import to_rank_by
    from auvbench.registry import TASKS

    parts: dict[str, Report] = {}
    for report in reports:
        parts.setdefault(report.section.vehicle, report)
    if len({_task(report) for report in parts.values()}) < 2:
        return None
    place_of = {name: place for place, name in enumerate(TASKS)}
    parts = dict(sorted(parts.items(), key=lambda part: place_of.get(_task(part[1]), len(place_of))))
    one_vehicle = len({report.runs[0].config.get("vehicle.name") for report in parts.values()}) == 1
    tested = [
        score.OneTask(
            _task(report).replace("_", " ") if one_vehicle else subject,
            to_rank_by(report.ranking.rank_by),
            _by_condition(report, options),
            {name: _adding(report, name, options.protocol) for name in (score.ZERO, score.ONE)},
        )
        for subject, report in parts.items()
    ]
    return score.scores(tested, options.protocol, options.confidence)


def _task(report: Report) -> str:
    from auvbench.analysis.records import task_of

    return task_of(report.runs[0])


def _by_condition(report: Report, options: Options) -> dict[str, Sequence[Agent]]:
    """Return the agents of a section by condition of the protocol."""
    from auvbench.analysis.load import agents
    from auvbench.analysis.ranking import one_run_of_a_controller

    names = [condition.name for condition in report.ranking.conditions]
    if not names:
        return {report.ranking.condition: report.agents}
    by_name: dict[str, Sequence[Agent]] = {}
    for name in names:
        met, _ = agents(report.runs, options.protocol, name)
        by_name[name] = [one_run_of_a_controller(agent) for agent in met]
    return by_name


def _adding(report: Report, algorithm: str, protocol: str) -> str:
    """Return the commands that add an algorithm to a section."""
    run = report.runs[0]
    config = run.config
    words = [f"{key}={config.get(f'{key}.name')}" for key in ("task", "vehicle")]
    folder = run.directory.parent
    output = os.path.relpath(folder.resolve().parent)
    words += [f"algo={algorithm}", *([] if output == "outputs" else [f"output={output}"])]
    train = ["auvbench", "train", *words, f"name={folder.resolve().name}"]
    test = ["auvbench", "evaluate", str(folder)]
    test += [] if protocol == "test" else [f"protocol={protocol}"]
    return f"{shlex.join(train)} && {shlex.join(test)} adds them."


def write_sections(
    reports: Sequence[Report], options: Options, command: str, out: Path, score: Scores | None
) -> tuple[list[Report], list[Path]]:
    """Write each section into its own folder below `out`, and an overview: `index.html`, `report.md` and
    `table.csv`.

    Returns:
        Reports, with damage found while drawing, and the files of the overview. If the formats have no
            overview: the files of the sections.
        none, of the sections.
    """
    from auvbench.reporting import tables
    from auvbench.reporting import write as files
    from auvbench.reporting.page.writer import write_overview

    sections, below = [], []
    for report in reports:
        folder = out / report.section.folder
        path_safety.check_output(folder, ("figures",))
        section, written = write(report, options, command, folder, several=True)
        sections.append(section)
        below += written
    above = []
    if "html" in options.format:
        above.append(write_overview(out / "index.html", sections, command, score))
    if "md" in options.format:
        above.append(files.text(out / "report.md", files.sections_markdown(sections, score)))
    if "csv" in options.format:
        above.append(files.text(out / "table.csv", rows(sections, tables.csv)))
    files.clear(out)
    if "tex" in options.format:
        above += files.if_any(
            out / "score.tex", tables.in_print(tables.score_table(score) if score else None, "score")
        )
    if "csv" in options.format:
        above += files.if_any(out / "score.csv", tables.score_csv(score) if score else "")
    return sections, above + [path for path in below if path.suffix not in {p.suffix for p in above}]


def rows(reports: Sequence[Report], draw: Callable[[Ranking], str]) -> str:
    """Return a CSV table of all sections; with several sections, one column names the section."""
    from auvbench.reporting import tables

    if len(reports) == 1:
        return draw(reports[0].ranking)
    return tables.joined("vehicle", [(r.section.vehicle, draw(r.ranking)) for r in reports])


def show(report: Report, options: Options) -> None:
    """Print the tables, findings and claims of one section."""
    from rich.console import Console
    from rich.markdown import Markdown
    from rich.text import Text

    from auvbench.reporting import tables
    from auvbench.reporting.write import claims_in_markdown

    if "terminal" not in options.format:
        return
    console = Console(highlight=False)
    console.print(tables.terminal(report.ranking))
    for conditions in tables.conditions_tables(report.ranking):
        console.print(Text(f"\n{conditions.title}", style="bold"))
        console.print(tables.TableView(conditions))
    if report.findings:
        console.print(Text("\nfindings", style="bold"))
        console.print(tables.findings_terminal(report.findings))
    if report.claims:
        console.print(Text("\nclaims of the study", style="bold"))
        console.print(Markdown(claims_in_markdown(report.claims)))
    if comparison := tables.comparison_table(report.comparison):
        console.print(Text(f"\n{comparison.title}", style="bold"))
        console.print(tables.TableView(comparison))


def show_score(score: Scores | None, options: Options) -> None:
    """Print the table across tasks, if there are several tasks."""
    from rich.console import Console

    from auvbench.reporting import tables

    if score is not None and "terminal" in options.format:
        heading("score across tasks")
        Console(highlight=False).print(tables.TableView(tables.score_table(score)))


def heading(title: str) -> None:
    """Print a heading between the sections of a report on a terminal."""
    from rich.console import Console
    from rich.rule import Rule
    from rich.text import Text

    console = Console(highlight=False)
    console.print()
    console.print(Rule(Text(title, style="bold"), align="left"))


def say_written(written: Sequence[Path]) -> None:
    """Print the files, one per line."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    if written:
        console.print()
    for path in written:
        console.print(Text.assemble(("wrote ", "dim"), os.path.relpath(path)), soft_wrap=True)
