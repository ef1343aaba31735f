"""`auvbench publish`: a study as a folder that can be shipped: rows, tables, figures and a README."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.commands.report_options import Options, read
from auvbench.commands.report_options import parser as report_parser
from auvbench.errors import ReportError, UserError, closest
from auvbench.untrusted import inside

if TYPE_CHECKING:
    from auvbench.analysis.model import Problem, RunRecord
    from auvbench.commands.grammar import Parser
    from auvbench.commands.report import Report
    from auvbench.runs.lock_files import Holder

PICTURES = "success_over_grid,training_success,failures"
NAMED = 3
"""runs found twice of which the one that is taken is named; more alike are counted"""
LARGEST = 25 * 10**6
"""bytes of a study beyond which a repository is the wrong place for it"""


def parser() -> Parser:
    parser = report_parser()
    parser.prog = "auvbench publish"
    parser.description = (
        "Copies what a report reads of runs into a folder to be shipped (compressed rows, configurations, no "
        "checkpoints), computes the report from these files, and writes its tables, some figures and a README whose "
        "parts between markers are renewed each time. Takes report's flags, too."
    )
    parser.epilog = "example: auvbench publish outputs/thesis --to results/thesis --study thesis"
    add = parser.add_argument
    add("--to", metavar="DIR", required=True, help="folder of the study: results/thesis")
    add("--title", metavar="TEXT", help="first line of a new README")
    add("--also", metavar="NAME,...", default="", help="further protocols, each with tables of its own")
    add("--pictures", metavar="NAME,...", default=PICTURES, help=f"figures of the README; default {PICTURES}")
    return parser


def main(argv: Sequence[str]) -> int:
    """Exit code 1 where runs had to be left out: each is named."""
    for flag in ("--out", "--format"):
        if any(word.partition("=")[0] == flag for word in argv):
            raise UserError(f"{flag}: publish decides itself; --to DIR is the folder")
    paths, options, own = read(parser(), argv)
    also = _names(own["also"])
    pictures = _pictures(own["pictures"])
    folder = Path(own["to"])
    inside.check_output(folder)
    from auvbench.runs.durable import storage

    with storage(f"cannot write {folder}"):
        left_out = _ship(paths, options, also, folder)
        runs = _say(folder, options, also, pictures, own, shlex.join(["auvbench", "publish", *argv]))
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{runs} runs, {size / 1e6:.1f} MB in {os.path.relpath(folder)}")
    if size > LARGEST:
        print(f"auvbench: more than {LARGEST / 1e6:.0f} MB: much for a repository", file=sys.stderr)
    return 1 if left_out else 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _pictures(text: str) -> tuple[str, ...]:
    from auvbench.reporting.figures import FIGURES

    names = _names(text)
    for name in names:
        if name not in FIGURES:
            raise UserError(f"--pictures {name}: no such figure; {closest(name, FIGURES)}")
    return names


def _ship(paths: Sequence[Path], options: Options, also: Sequence[str], folder: Path) -> int:
    """Copies the runs; returns how many things were left out, each of which is named.

    Raises:
        ReportError: not one can be shipped, or the folder holds what publish did not write; nothing was changed then.
    """
    from auvbench.analysis.grouping import failed_training
    from auvbench.analysis.load import load, require
    from auvbench.reporting import copies, shipped

    copies.prepare(folder)
    runs, problems = load(paths, (options.protocol, *also), options.where)
    require(runs, problems, options.protocol)
    for name in also:
        if not any(name in run.evaluations for run in runs):
            raise ReportError(f"--also {name}: none of the {len(runs)} runs was evaluated by it")
    _refuse_own(runs, folder)
    held = {run.id: holder for run in runs if (holder := _holder(run)) is not None}
    chosen = [run for run in runs if (run.evaluations or failed_training(run)) and run.id not in held]
    if not any(options.protocol in run.evaluations for run in chosen):
        raise ReportError(f"all runs that could be published are at work; {_at_work(held)}")
    # Of a run that is there and cannot be shipped now, an earlier copy stays.
    found = {run.id for run in runs} | {Path(problem.where).name for problem in problems}
    gone = [name for name in copies.names(folder) if name not in found]
    _refuse_named(paths, folder, gone)
    left = [f"{run.id}: {said}" for run in chosen for said in shipped.ship(run, folder, options.protocol)]
    for name in gone:
        copies.remove(folder / copies.RUNS / name)
        print(f"removed {folder / copies.RUNS / name}: it is not among the runs that were named")
    ids = {run.id for run in chosen}
    left += [
        f"{p.where}: {p.message}"
        for p in problems
        if p.kind not in ("duplicate", "unverified") and not (p.kind == "failed" and p.where in ids)
    ]
    left += [_at_work({name: holder}) for name, holder in held.items()]
    for line in left:
        print(f"not published: {line}")
    _say_which([p for p in problems if p.kind == "duplicate"])
    return len(left)


def _holder(run: RunRecord) -> Holder | None:
    """Who works on a run at present; nobody works on a copy."""
    from auvbench.runs import lock
    from auvbench.runs.manifest_fields import SHIPPED

    return None if run.manifest.get(SHIPPED) is True else lock.living_holder(run.directory)


def _at_work(held: Mapping[str, Holder]) -> str:
    name, holder = next(iter(held.items()))
    return f"{name}: {holder} works on it at present; publish again when it is done"


def _refuse_own(runs: Sequence[RunRecord], folder: Path) -> None:
    """
    Raises:
        ReportError: the folder to publish into is one of runs, whose reports would hold each of them twice.
    """
    from auvbench.reporting import copies

    for run in runs:
        inner = run.directory.resolve()
        if folder.resolve() in inner.parents and inner.parent != (folder / copies.RUNS).resolve():
            raise ReportError(
                f"--to {folder}: {run.directory} lies there itself; name a folder apart from runs"
            )


def _refuse_named(paths: Sequence[Path], folder: Path, gone: Sequence[str]) -> None:
    """
    Raises:
        ReportError: a copy would go that lies in a folder that was named: it may be all there is of that run.
    """
    from auvbench.reporting import copies

    named = {path.resolve() for path in paths}
    for name in gone:
        copy = folder / copies.RUNS / name
        if named & {copy.resolve(), *copy.resolve().parents}:
            raise ReportError(
                f"{copy}: --where leaves it out, and it would be removed from the folder that was named; "
                "publish the choice into another folder"
            )


def _say_which(twice: Sequence[Problem]) -> None:
    for problem in twice[:NAMED]:
        print(f"{problem.where}: {problem.message}")
    if len(twice) > NAMED:
        print(
            f"{len(twice) - NAMED} more runs were found twice, and taken by the same rule (docs/publishing.md)"
        )


def _say(
    folder: Path,
    options: Options,
    also: Sequence[str],
    pictures: Sequence[str],
    own: Mapping[str, Any],
    command: str,
) -> int:
    """Computes the report from what was shipped, and writes it; returns how many runs it has."""
    from auvbench.reporting import copies, readme
    from auvbench.reporting import write as files

    chosen = replace(options, format=("csv",), where=(), out=folder)
    source = [folder / copies.RUNS]
    reports = _tables(source, chosen, folder)
    for name in also:
        _tables(source, replace(chosen, protocol=name, condition=None, study=None), folder / name)
    runs = [run for report in reports for run in report.runs]
    figures = _figures(reports, pictures, folder)
    blocks = {
        "table": _ranked(reports),
        "figures": "\n\n".join(figures) or "No figure.",
        **({"claims": _claims(reports)} if options.study else {}),
        "provenance": readme.provenance(runs, command),
    }
    files.text(folder / "README.md", readme.fill(folder / "README.md", own["title"] or folder.name, blocks))
    return len(runs)


def _tables(source: Sequence[Path], options: Options, folder: Path) -> list[Report]:
    """table.csv and its companions of one protocol, in folders of their own where there are several sections."""
    from auvbench.commands.report import analysed, over_all, write
    from auvbench.commands.report_sections import write_sections

    reports = analysed(source, options)
    over = over_all(reports, options)
    if len(reports) == 1:
        write(reports[0], options, "", folder, over=over)
    else:
        write_sections(reports, options, "", folder, over)
    return reports


def _ranked(reports: Sequence[Report]) -> str:
    from auvbench.reporting import tables

    parts = []
    for report in reports:
        if len(reports) > 1:
            parts.append(f"### {report.section.title[:1].upper()}{report.section.title[1:]}")
        parts.append(tables.markdown(report.ranking).rstrip())
    return "\n\n".join(parts)


def _claims(reports: Sequence[Report]) -> str:
    """The verdicts of a study and its numbers beside ours, of each section that has them."""
    from auvbench.analysis import study
    from auvbench.reporting.write import finding_in_markdown

    parts = []
    for report in reports:
        parts += [f"{i}. {finding_in_markdown(claim)}" for i, claim in enumerate(report.claims, 1)]
        if report.beside:
            parts.append("\n" + study.markdown(report.beside).rstrip())
    return "\n".join(parts) or "Nothing can be said of the study's claims."


def _figures(reports: Sequence[Report], pictures: Sequence[str], folder: Path) -> list[str]:
    """Markdown of the pictures of the first section that has them."""
    from auvbench.reporting.figures.draw import draw
    from auvbench.reporting.tables.markdown import escape

    first = reports[0]
    drawn = draw(pictures, first.agents, first.ranking, folder)
    for figure in drawn:
        figure.svg.unlink(missing_ok=True)
    return [f"![{escape(f.title)}](figures/{f.png.name})\n\n{escape(f.caption)}" for f in drawn]
