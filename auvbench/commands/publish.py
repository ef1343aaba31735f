"""`auvbench publish`: a study as a folder that can be shipped: rows, tables, figures and a README."""

from __future__ import annotations

import os
import shlex
import shutil
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
    from auvbench.commands.grammar import Parser
    from auvbench.commands.report import Report

PICTURES = "success_over_grid,training_success,failures"
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
    """Copies the runs; returns how many were left out.

    Raises:
        ReportError: not one can be shipped.
    """
    from auvbench.analysis.load import load, require
    from auvbench.reporting import shipped

    protocols = (options.protocol, *also)
    runs, problems = load(paths, protocols, options.where)
    require(runs, problems, options.protocol)
    chosen = [run for run in runs if run.evaluations]
    for name in also:
        if not any(name in run.evaluations for run in chosen):
            raise ReportError(f"--also {name}: none of the {len(runs)} runs was evaluated by it")
    kept = {shipped.ship(run, folder, options.protocol).name for run in chosen}
    for path in sorted((folder / shipped.RUNS).iterdir()):
        if path.is_dir() and not path.is_symlink() and path.name not in kept:
            print(f"removed {path}: it is not among the runs that were named")
            shutil.rmtree(path)
    left = [run for run in runs if not run.evaluations]
    for problem in problems:
        print(f"not published: {problem.where}: {problem.message}")
    return len(left)


def _say(
    folder: Path,
    options: Options,
    also: Sequence[str],
    pictures: Sequence[str],
    own: Mapping[str, Any],
    command: str,
) -> int:
    """Computes the report from what was shipped, and writes it; returns how many runs it has."""
    from auvbench.reporting import readme, shipped
    from auvbench.reporting import write as files

    chosen = replace(options, format=("csv",), where=(), out=folder)
    source = [folder / shipped.RUNS]
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
