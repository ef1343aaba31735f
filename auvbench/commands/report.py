"""`auvbench report`: ranks runs and writes tables, figures and a page."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.report_options import Options, parse
from auvbench.errors import UserError

if TYPE_CHECKING:
    from auvbench.analysis.model import Agent, Finding, Ranking, RunRecord
    from auvbench.analysis.study import Beside
    from auvbench.reporting.figures import Figure


def main(argv: Sequence[str]) -> int:
    """Exit code 0 when there is a report, whatever had to be left out of it: the report names that."""
    paths, options = parse(argv)
    from auvbench.analysis.processes import uncollected

    with uncollected():
        _report(paths, options, shlex.join(["auvbench", "report", *argv]))
    return 0


def _report(paths: Sequence[Path], options: Options, command: str) -> None:
    from auvbench.analysis.conditions import default
    from auvbench.analysis.findings import sentences
    from auvbench.analysis.load import agents, load, require
    from auvbench.analysis.measures import measure
    from auvbench.analysis.ranking import rank

    measure(options.rank_by)  # a wrong name is said before anything is read
    measure(options.then, "--then")
    runs, problems = load(paths, options.protocol)
    require(runs, problems, options.protocol)
    condition = options.condition or default(runs, options.protocol)
    grouped, more = agents(runs, options.group_by, options.protocol, condition)
    ranking = rank(
        grouped,
        rank_by=options.rank_by,
        then=options.then,
        baseline=options.baseline,
        confidence=options.confidence,
        seed=options.seed,
        protocol=options.protocol,
        condition=condition,
        problems=(*problems, *more),
    )
    by_label = {agent.label: agent for agent in grouped}
    ordered = [by_label[row.label] for row in ranking.rows]  # so that the best get the most distinct colours
    claims, numbers = _study(runs, ordered, options)
    report = Report(runs, ordered, ranking, sentences(ranking, ordered), claims, numbers)
    report, written = write(report, options, command)
    _show(report, options, written)


@dataclass(frozen=True, slots=True)
class Report:
    """Everything that the formats show."""

    runs: Sequence[RunRecord]
    agents: Sequence[Agent]
    """in the order of the ranking"""
    ranking: Ranking
    findings: Sequence[Finding]
    claims: Sequence[Finding]
    beside: Sequence[Beside]
    """the study's own numbers next to ours"""


def _study(
    runs: Sequence[RunRecord], agents: Sequence[Agent], options: Options
) -> tuple[Sequence[Finding], Sequence[Beside]]:
    if options.study is None:
        return (), ()
    from auvbench.analysis import study

    claims = study.answer(runs, agents, options.study, confidence=options.confidence, seed=options.seed)
    return claims, study.beside(agents, options.confidence)


def write(report: Report, options: Options, command: str) -> tuple[Report, list[Path]]:
    """Writes the formats asked for; returns the report, with what drawing found damaged, and the files."""
    from auvbench.reporting import tables
    from auvbench.reporting import write as files

    out = options.out or beside(report.runs)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot write into {out}: {error.strerror}") from error
    ranking = report.ranking
    written = []
    figures: Sequence[Figure] = ()
    if options.figures and {"md", "html"} & set(options.format):
        from auvbench.reporting.figures import draw_all

        figures, problems = draw_all(report.runs, report.agents, ranking, out)
        ranking = replace(ranking, problems=(*ranking.problems, *problems))
        report = replace(report, ranking=ranking)
    if "html" in options.format:
        written.append(_page(out / "index.html", report, figures, command))
    if "md" in options.format:
        text = files.markdown(ranking, report.findings, report.claims, report.beside, figures, out)
        written.append(files.text(out / "report.md", text))
    if "tex" in options.format:
        written.append(files.text(out / "table.tex", tables.latex(ranking)))
        written += files.if_any(out / "conditions.tex", tables.conditions_latex(ranking))
    if "csv" in options.format:
        written.append(files.text(out / "table.csv", tables.csv(ranking)))
        written += files.if_any(out / "comparisons.csv", tables.comparisons_csv(ranking.comparisons))
        written += files.if_any(out / "conditions.csv", tables.conditions_csv(ranking))
    return report, written


def _page(path: Path, report: Report, figures: Sequence[Figure], command: str) -> Path:
    from auvbench.reporting import page
    from auvbench.reporting.figures import colour_of

    return page.write(
        path,
        ranking=report.ranking,
        agents=report.agents,
        runs=report.runs,
        figures=figures,
        findings=report.findings,
        claims=report.claims,
        beside=report.beside,
        colours=colour_of(report.agents),
        command=command,
    )


def _show(report: Report, options: Options, written: Sequence[Path]) -> None:
    from rich.console import Console
    from rich.text import Text

    from auvbench.reporting import tables
    from auvbench.reporting.write import against_baseline

    console = Console(highlight=False)
    if "terminal" in options.format:
        console.print(tables.terminal(report.ranking))
        if report.ranking.conditions:
            console.print()
            console.print(tables.conditions_terminal(report.ranking))
        if comparisons := against_baseline(report.ranking):
            console.print()
            console.print(tables.comparisons_terminal(comparisons))
        for title, findings in (("findings", report.findings), ("claims of the study", report.claims)):
            if findings:
                console.print(Text(f"\n{title}", style="bold"))
                console.print(tables.findings_terminal(findings))
        if report.beside:
            console.print()
            console.print(tables.beside_terminal(report.beside, console.width))
    if written:
        console.print()
    for path in written:
        console.print(Text.assemble(("wrote ", "dim"), os.path.relpath(path)), soft_wrap=True)


def beside(runs: Sequence[RunRecord]) -> Path:
    """<experiment>/report, where the experiment is the folder that all the runs have in common."""
    parents = {str(run.directory.absolute().parent) for run in runs}
    return Path(os.path.commonpath(sorted(parents))) / "report"
