"""`auvbench report`: rank runs and write tables, figures and a page."""

from __future__ import annotations

import gc
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report_options import Options, parser, read
from auvbench.errors import ReportError, UserError, closest
from auvbench.record import PRIMARY
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.analysis.grouping import Section
    from auvbench.analysis.records import Agent, ClaimVerdict, Problem, Ranking, Report, RunRecord
    from auvbench.analysis.thesis import ComparisonRow
    from auvbench.reporting.figures import Figure


def main(argv: Sequence[str]) -> int:
    """Return 0 if there is a report; runs that it leaves out are named."""
    paths, options, _ = read(parser(), argv)
    # A report keeps nearly all of its millions of objects: the search for cycles would take a sixth of its time.
    gc.disable()
    try:
        _report(paths, options, shlex.join(["auvbench", "report", *argv]))
    finally:
        gc.enable()
    return 0


def _report(paths: Sequence[Path], options: Options, command: str) -> None:
    from auvbench.commands import report_sections as sections
    from auvbench.runs.atomic_io import storage

    reports = analysed(paths, options)
    runs = [run for report in reports for run in report.runs]
    experiment = os.path.commonpath([run.directory.absolute().parent for run in runs])
    out = options.out or Path(experiment, "report")
    # A folder that the user typed may be a link; an existing default folder may belong to another program.
    if options.out is None:
        path_safety.check_output(out)
    path_safety.check_output(out / "figures")
    if len(reports) == 1:
        with storage(f"cannot write the report into {out}"):
            report, written = write(reports[0], options, command, out)
            for name in ("score.tex", "score.csv"):  # files of an earlier report with several tasks
                (out / name).unlink(missing_ok=True)
        sections.show(report, options)
    else:
        score = sections.across_tasks(reports, options)
        with storage(f"cannot write the report into {out}"):
            reports, written = sections.write_sections(reports, options, command, out, score)
        for report in reports:
            sections.heading(report.section.title)
            sections.show(report, options)
        sections.show_score(score, options)
    sections.say_written(written)
    if options.log is not None:
        from auvbench import tracking
        from auvbench.reporting import tables

        rows = tables.joined("vehicle", [(r.section.vehicle, tables.csv(r.ranking)) for r in reports])
        tracking.table(options.log, command, rows, written)


def analysed(paths: Sequence[Path], options: Options) -> list[Report]:
    """Return the report of each section of the runs under some paths.

    If a section cannot be reported, the first report lists the reason.

    Raises:
        UserError: an option has an unknown name, or no section can be reported.
    """
    from auvbench.analysis.conditions import default
    from auvbench.analysis.grouping import sections, split_problems
    from auvbench.analysis.load import load, require
    from auvbench.analysis.measures import to_rank_by
    from auvbench.analysis.names import name_agents
    from auvbench.analysis.optional_columns import validate_columns as check_columns
    from auvbench.analysis.records import Problem

    if options.rank_by != PRIMARY:
        to_rank_by(options.rank_by)  # report a wrong name before anything is read
    for task, measure in options.primary.items():
        to_rank_by(measure, f"report: primary.{task}")
    check_columns(options.columns)
    runs, problems = load(paths, options.protocol, options.where)
    runs = name_agents(runs, options.names)
    require(runs, problems, options.protocol)
    parts = sections(runs, options.protocol)
    measures = dict.fromkeys(_measure(part, options) for part in parts)
    if options.margin is not None and len(measures) > 1:
        raise ReportError(
            f"--margin {options.margin:g}: the tasks are ranked by {', '.join(measures)}, which have "
            "different units; leave --margin "
            "out (null in a declared analysis), or name one task: --where task=NAME"
        )
    condition = options.condition or default(runs, options.protocol)
    rows = _declared_rows(paths, runs, options)
    reports: list[Report] = []
    refused: list[tuple[str, ReportError]] = []
    for part, own in zip(parts, split_problems(problems, parts), strict=True):
        try:
            reports.append(_analyse(part, own, condition, options, rows, several=len(parts) > 1))
        except ReportError as error:
            refused.append((part.title, error))
    if not reports:
        raise refused[0][1]
    if options.baseline is not None and all(report.without_baseline for report in reports):
        labels = sorted({agent.label for report in reports for agent in report.agents})
        raise ReportError(
            f"--baseline {options.baseline!r}: no such agent in any of the {len(reports)} sections; "
            f"{closest(options.baseline, labels)}"
        )
    named = [Problem(title, "missing", str(error)) for title, error in refused]
    first = reports[0].ranking
    reports[0] = replace(reports[0], ranking=replace(first, problems=(*first.problems, *named)))
    return reports


def _declared_rows(
    paths: Sequence[Path], runs: Sequence[RunRecord], options: Options
) -> Mapping[str, frozenset[str]] | None:
    """Return the ids of the declared runs by vehicle and task; None without a declared analysis."""
    from auvbench.analysis.declaration import declared_rows

    if options.declared is None or options.declared_in is None or options.usual is None:
        return None
    folder = options.declared_in
    uses_all_runs = not options.where and all(path.resolve() == folder for path in paths)
    return declared_rows(options.declared, folder, options.usual.protocol, runs if uses_all_runs else None)


def _declaration(
    part: Section,
    agents: Sequence[Agent],
    ranking: Ranking,
    condition: str,
    options: Options,
    rows: Mapping[str, frozenset[str]] | None,
) -> str:
    """Return the sentence on the declared analysis of a section."""
    from auvbench.analysis.conditions import default
    from auvbench.analysis.declaration import Analysed, Plan, sentence, undeclared

    if options.declared is None or options.usual is None or rows is None:
        return undeclared(options.undecided)

    def analysed(chosen: Options, condition: str) -> Analysed:
        measure = _measure(part, chosen)
        return Analysed(
            measure, chosen.baseline, chosen.margin, chosen.protocol, condition, chosen.confidence
        )

    usual = options.usual
    plan = Plan(
        options.declared,
        analysed(usual, usual.condition or default(part.runs, options.protocol)),
        rows.get(part.vehicle, frozenset()),
    )
    return sentence(plan, analysed(options, condition), part.runs, agents, ranking)


def _analyse(
    part: Section,
    problems: Sequence[Problem],
    condition: str,
    options: Options,
    rows: Mapping[str, frozenset[str]] | None,
    several: bool,
) -> Report:
    """Return the report of one section; with `several` sections, one may lack the baseline."""
    from auvbench.analysis.conditions import sealed_note
    from auvbench.analysis.effort import with_effort
    from auvbench.analysis.findings import find
    from auvbench.analysis.load import agents
    from auvbench.analysis.measures import in_unit
    from auvbench.analysis.optional_columns import add_optimality, with_columns
    from auvbench.analysis.primary import find_baseline
    from auvbench.analysis.ranking import one_run_of_a_controller, rank
    from auvbench.analysis.records import Problem, Report

    grouped, more = agents(part.runs, options.protocol, condition)
    grouped = [one_run_of_a_controller(agent) for agent in grouped]
    rank_by = _measure(part, options)
    baseline = options.baseline
    # With several sections, one may lack the baseline; a subset of the runs may lack the declared baseline.
    declared = options.declared is not None and baseline == options.declared.baseline
    if baseline is not None and (several or declared):
        try:
            find_baseline(grouped, baseline)
        except ReportError as error:
            baseline, more = None, [*more, Problem(part.title, "missing", str(error))]
    ranking = rank(
        grouped,
        rank_by=rank_by,
        baseline=baseline,
        confidence=options.confidence,
        margin=in_unit(options.margin, rank_by),
        protocol=options.protocol,
        condition=condition,
        problems=(*problems, *part.problems, *more),
    )
    note = _declaration(part, grouped, ranking, condition, options, rows)
    seal = sealed_note(part.runs, options.protocol)
    ranking = replace(add_optimality(ranking, grouped), declaration=note, sealed=seal)
    ranking = with_columns(ranking, grouped, options.columns)
    ranking = with_effort(ranking, grouped, options.trials)
    by_label = {agent.label: agent for agent in grouped}
    ordered = [by_label[row.label] for row in ranking.rows]  # The best agents get the most distinct colours.
    claims, numbers = _study(part.runs, ordered, options)
    missing = options.baseline is not None and baseline is None and not declared
    return Report(part, ordered, ranking, find(ranking, ordered), claims, numbers, missing)


def _measure(part: Section, options: Options) -> str:
    """Return the measure that ranks the agents of the section: the option, or the task's primary measure."""
    from auvbench.config.tasks import primary_of

    if options.rank_by != PRIMARY:
        return options.rank_by
    task = str(part.runs[0].config.get("task.name"))
    return options.primary.get(task) or primary_of(task)


def _study(
    runs: Sequence[RunRecord], agents: Sequence[Agent], options: Options
) -> tuple[Sequence[ClaimVerdict], Sequence[ComparisonRow]]:
    if options.study is None:
        return (), ()
    from auvbench.analysis import claims, thesis

    judged = claims.judge(runs, agents, confidence=options.confidence, seed=0)
    return judged, thesis.compare(agents, options.confidence)


def write(
    report: Report, options: Options, command: str, out: Path, several: bool = False
) -> tuple[Report, list[Path]]:
    """Write the requested formats; return the report, with damage found while drawing, and the files.

    Args:
        report: report of one section.
        options: name the formats to write.
        command: command line, for the page.
        out: folder of the report.
        several: whether there are further sections.
    """
    from auvbench.reporting import tables
    from auvbench.reporting import write as files
    from auvbench.runs.atomic_io import make_folder

    try:
        make_folder(out)
    except OSError as error:
        raise UserError(f"cannot write into {out}: {error.strerror}") from error
    ranking = report.ranking
    written = []
    figures: Sequence[Figure] = ()
    if options.figures and {"md", "html"} & set(options.format):
        from auvbench.reporting.figures import draw_all

        figures, problems = draw_all(report.agents, ranking, out)
        ranking = replace(ranking, problems=(*ranking.problems, *problems))
        report = replace(report, ranking=ranking)
    if "html" in options.format:
        from auvbench.reporting import page

        written.append(page.write(out / "index.html", report, figures, command=command, several=several))
    if "md" in options.format:
        written.append(files.text(out / "report.md", files.markdown(report, figures, out)))
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
    return report, written
