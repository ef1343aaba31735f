"""`auvbench publish`: write a study as a folder of Parquet files, table, figures and README."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands import export, publish_readme
from auvbench.commands.publish_readme import Study
from auvbench.commands.report_options import Options, read
from auvbench.commands.report_options import parser as report_parser
from auvbench.errors import ReportError, UserError, closest
from auvbench.runs import declared
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.analysis.records import RunRecord
    from auvbench.commands.grammar import Parser

PICTURES = "success_over_grid,success_over_conditions,training_success"
"""figures in addition to the main figure, which every README has"""
NAMED = 3
"""largest number of runs to name; further runs are only counted"""


def parser() -> Parser:
    parser = report_parser()
    parser.prog = "auvbench publish"
    parser.description = (
        "Copies the rows of runs (configurations and episodes, no checkpoints) as Parquet files into a folder, "
        "with the report's table, figures and a README. The parts of the README between markers are "
        "renewed each time. To keep "
        "the runs of an existing folder, name the folder itself as well. Accepts the flags of report."
    )
    parser.epilog = "example: auvbench publish outputs/thesis --to results/thesis --study thesis --policies"
    add = parser.add_argument
    add("--to", metavar="DIR", required=True, help="folder of the study: results/thesis")
    add("--also", metavar="NAME,...", default="", help="further protocols, each with its own tables")
    add(
        "--pictures",
        metavar="NAME,...",
        default=PICTURES,
        help=f"figures besides the differences from the baseline; '' for no figures; default {PICTURES}",
    )
    add(
        "--paths",
        dest="trajectories",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="include the trajectories of the recorded test episodes, for the page's 3-D view",
    )
    add(
        "--compact",
        action="store_true",
        help="write about a tenth of the size: only outcome, steps, primary measure and energy of each test "
        "episode, with three digits; no training episodes",
    )
    add("--policies", action="store_true", help="write each agent's best run as an ONNX file with its card")
    return parser


def main(argv: Sequence[str]) -> int:
    """Return 1 if anything had to be left out; a line names each item."""
    for flag in ("--out", "--format"):
        if any(word.partition("=")[0] == flag for word in argv):
            raise UserError(f"{flag}: is not an option of publish; --to DIR names the folder")
    paths, options, own = read(parser(), argv)
    study = Study(
        folder=Path(own["to"]),
        also=_names(own["also"]),
        pictures=_pictures(own["pictures"]),
        paths=own["trajectories"],
        compact=own["compact"],
        policies=own["policies"],
        command=shlex.join(["auvbench", "publish", *map(_placeless, argv)]),
    )
    path_safety.check_output(study.folder)
    if study.folder.exists() and not study.folder.is_dir():
        raise UserError(f"--to {study.folder}: is a file; name a folder")
    if options.undecided and (study.folder / declared.FILE).is_file():
        raise UserError(
            f"--to {study.folder}: its declared analysis would be lost: {options.undecided}. If its {declared.FILE} declares"
            " all runs, cp it to the other folders"
        )
    if study.policies:
        export.require()
    from auvbench.runs.atomic_io import storage

    publish_readme.check(study, options)
    publish_readme.rehearse(paths, study, options)
    with storage(f"cannot write {study.folder}"):
        runs, left_out = _ship(paths, options, study)
        count, without = publish_readme.write(study, options, {run.id: run for run in runs})
    print(f"{count} run{'s' if count != 1 else ''} in {os.path.relpath(study.folder)}")
    return 1 if left_out or without else 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _pictures(text: str) -> tuple[str, ...]:
    from auvbench.reporting.figures import FIGURES, MAIN

    further = [name for name in FIGURES if name != MAIN]
    names = _names(text)
    for name in names:
        if name == MAIN:
            raise UserError(f"--pictures {name}: is in every README already; leave it out")
        if name not in further:
            raise UserError(f"--pictures {name}: unknown figure; {closest(name, further)}")
    return names


def _placeless(word: str) -> str:
    """Return a word of the command without paths of this machine."""
    flag, equals, value = word.partition("=")
    if flag.startswith("--") and equals:
        return f"{flag}={_placeless(value)}"
    path = Path(word)
    if not path.is_absolute():
        return word
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else path.name


def _ship(paths: Sequence[Path], options: Options, study: Study) -> tuple[list[RunRecord], int]:
    """Write the runs; return them as loaded, and the number of items left out, each named in a line.

    Raises:
        ReportError: no run can be published, or the study's folder contains runs.
    """
    from auvbench.analysis.formatting import listed
    from auvbench.analysis.grouping import failed_training
    from auvbench.analysis.load import load, require
    from auvbench.reporting import archive

    folder = study.folder
    protocols = (options.protocol, *study.also)
    runs, problems = load(paths, protocols, options.where)
    require(runs, problems, options.protocol)
    for run in runs:
        if run.archive is None and folder.resolve() in run.directory.resolve().parents:
            raise ReportError(f"--to {folder}: contains the run {run.directory}; name a folder without runs")
    chosen = [run for run in runs if run.evaluations or failed_training(run)]
    ids = {run.id for run in chosen}
    _refuse_loss(folder, ids)
    omitted = archive.write(chosen, folder, protocols, trajectories=study.paths, compact=study.compact)
    omitted += archive.write_history(runs, folder)
    untested = [p for p in problems if p.kind == "missing"]
    omitted += [
        f"{p.where}: {p.message}"
        for p in problems
        if p.kind not in ("missing", "duplicate") and not (p.kind == "failed" and p.where in ids)
    ]
    if untested:
        omitted.append(f"{listed([p.where for p in untested], NAMED)}: {untested[0].message}")
    for line in omitted:
        print(f"not published: {line}")
    for problem in [p for p in problems if p.kind == "duplicate"]:
        print(f"{problem.where}: {problem.message}")
    return chosen, len(omitted)


def _refuse_loss(folder: Path, chosen: Collection[str]) -> None:
    """Raise ReportError if the existing study has runs that would be lost."""
    from auvbench.analysis.archive import RUNS, Archive, is_archive
    from auvbench.analysis.evaluations import Damage
    from auvbench.analysis.formatting import counted

    if not is_archive(folder):
        return
    try:
        lost = [name for name in Archive(folder).ids() if name not in chosen]
    except Damage as damage:
        raise ReportError(f"{folder}: {damage}; remove {RUNS} to publish again") from damage
    if lost:
        raise ReportError(
            f"{folder} has {counted(len(lost), 'run')} that would be lost, first {lost[0]}; name {folder} "
            "as well to keep "
            f"them, publish into another folder, or remove {folder / RUNS}"
        )
