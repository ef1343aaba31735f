"""`auvbench publish`: write a study as a folder of Parquet files, table, figures and README."""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands import export
from auvbench.commands.report_options import parser as report_parser
from auvbench.commands.report_options import read
from auvbench.errors import UserError, closest
from auvbench.runs import declared
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.grammar import Parser

PICTURES = "success_over_grid,success_over_conditions,training_success"
"""default figures in addition to the main figure, which every README has"""


def parser() -> Parser:
    parser = report_parser()
    parser.prog = "auvbench publish"
    parser.description = (
        "Copies the rows of runs (configurations and episodes, no checkpoints) as Parquet files into a folder, "
        "with the report's table, figures and a README. Each call writes the parts of the README between markers "
        "again. To keep "
        "the runs that a folder already has, name this folder as PATH too. Also accepts the flags of auvbench report."
    )
    parser.epilog = "example: auvbench publish outputs/thesis --to results/thesis --study thesis --policies"
    add = parser.add_argument
    add("--to", metavar="DIR", required=True, help="folder of the study: results/thesis")
    add(
        "--pictures",
        metavar="NAME,...",
        default=PICTURES,
        help=f"figures in addition to the differences from the baseline; '' for none; default {PICTURES}",
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
    """Publish the study, and print a line for each item that had to be left out; return 1 if an item was left out, else 0."""
    from auvbench.reporting.study import Study, publish
    from auvbench.runs.atomic_io import storage

    for flag in ("--out", "--format"):
        if any(word.partition("=")[0] == flag for word in argv):
            raise UserError(f"{flag}: is not an option of publish; --to DIR names the folder")
    paths, options, own = read(parser(), argv)
    study = Study(
        folder=Path(own["to"]),
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
            " all runs, copy that file to the other folders"
        )
    if study.policies:
        export.require()
    with storage(f"cannot write {study.folder}"):
        published = publish(paths, study, options)
    for line in published.lines:
        print(line)
    print(f"{published.runs} run{'s' if published.runs != 1 else ''} in {os.path.relpath(study.folder)}")
    return 0 if published.complete else 1


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
    """Shorten an absolute path in a word of the command: to a relative path, or outside the working directory to the path's last part."""
    flag, equals, value = word.partition("=")
    if flag.startswith("--") and equals:
        return f"{flag}={_placeless(value)}"
    path = Path(word)
    if not path.is_absolute():
        return word
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else path.name
