"""`auvbench publish`: a study as a folder that can be shipped: rows, tables, figures and a README."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands import export, publish_readme
from auvbench.commands.publish_readme import Study
from auvbench.commands.report_options import Options, read
from auvbench.commands.report_options import parser as report_parser
from auvbench.errors import ReportError, UserError, closest
from auvbench.untrusted import path_safety

if TYPE_CHECKING:
    from auvbench.analysis.model import Problem, RunRecord
    from auvbench.commands.grammar import Parser
    from auvbench.runs.lock import Holder

PICTURES = "success_over_grid,success_over_conditions,training_success,failures"
"""beside the main figure, which every README has"""
NAMED = 3
"""runs found twice, or not tested, that are named; more alike are counted"""
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
    parser.epilog = "example: auvbench publish outputs/thesis --to results/thesis --study thesis --policies"
    add = parser.add_argument
    add("--to", metavar="DIR", required=True, help="folder of the study: results/thesis")
    add("--title", metavar="TEXT", help="first line of a new README")
    add("--question", metavar="TEXT", help="what the study asks, in a new README")
    add("--also", metavar="NAME,...", default="", help="further protocols, each with tables of its own")
    add("--pictures", metavar="NAME,...", default=PICTURES, help=f"figures of the README; default {PICTURES}")
    add(
        "--paths",
        dest="trajectories",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="the paths of the kept test episodes, which the page's 3-D view and claims on the reward collected need",
    )
    add("--policies", action="store_true", help="each agent's best run as an ONNX file with its card")
    return parser


def main(argv: Sequence[str]) -> int:
    """Exit code 1 where something had to be left out: each is named."""
    for flag in ("--out", "--format"):
        if any(word.partition("=")[0] == flag for word in argv):
            raise UserError(f"{flag}: publish decides itself; --to DIR is the folder")
    paths, options, own = read(parser(), argv)
    study = Study(
        folder=Path(own["to"]),
        also=_names(own["also"]),
        pictures=_pictures(own["pictures"]),
        title=_line("--title", own["title"]) or Path(own["to"]).resolve().name,
        question=_line("--question", own["question"]),
        paths=own["trajectories"],
        policies=own["policies"],
        command=shlex.join(["auvbench", "publish", *map(_placeless, argv)]),
    )
    path_safety.check_output(study.folder)
    if study.folder.exists() and not study.folder.is_dir():
        raise UserError(f"--to {study.folder}: is a file; name a folder")
    if study.policies:
        export.require()
    from auvbench.runs.atomic_io import storage

    publish_readme.check(study, options)
    publish_readme.rehearse(paths, study, options)
    with storage(f"cannot write {study.folder}"):
        runs, left_out = _ship(paths, options, study)
        count, without = publish_readme.write(study, options, {run.id: run for run in runs})
    _close(study.folder, count)
    return 1 if left_out or without else 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _line(flag: str, text: str | None) -> str:
    """A text that becomes a line of the README, as it is: the author's own Markdown."""
    if text is None:
        return ""
    if not text.strip() or not text.isprintable():
        raise UserError(f"{flag} {text!r}: give one line of text")
    return text.strip()


def _pictures(text: str) -> tuple[str, ...]:
    from auvbench.reporting.figures import FIGURES

    names = _names(text)
    for name in names:
        if name not in FIGURES:
            raise UserError(f"--pictures {name}: no such figure; {closest(name, FIGURES)}")
    return names


def _placeless(word: str) -> str:
    """A word of the command without the place on this machine that it may name."""
    flag, given, value = word.partition("=")
    if flag.startswith("--") and given:
        return f"{flag}={_placeless(value)}"
    path = Path(word)
    if not path.is_absolute():
        return word
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else path.name


def _close(folder: Path, runs: int) -> None:
    """The closing line: how many runs, and how many bytes of what."""
    from auvbench.analysis.formatting import counted

    sizes = dict.fromkeys(("test episodes", "training rows", "paths", "policies", "figures", "the rest"), 0)
    for path in folder.rglob("*"):
        if path.is_file():
            sizes[_kind(path.relative_to(folder).parts)] += path.stat().st_size
    size = sum(sizes.values())
    parts = ", ".join(f"{kind} {count / 1e6:.1f}" for kind, count in sizes.items() if count)
    print(f"{counted(runs, 'run')}, {size / 1e6:.1f} MB in {os.path.relpath(folder)}: {parts}")
    if size > LARGEST:
        print(f"auvbench: more than {LARGEST / 1e6:.0f} MB: much for a repository", file=sys.stderr)


def _kind(parts: Sequence[str]) -> str:
    """What a file is counted as, by where it lies in the folder."""
    if parts[0] == "runs" and len(parts) > 3:
        if parts[2] == "train":
            return "training rows"
        return {"episodes.csv.bz2": "test episodes", "trajectories.npz": "paths"}.get(parts[-1], "the rest")
    return next((kind for kind in ("policies", "figures") if kind in parts[:-1]), "the rest")


def _ship(paths: Sequence[Path], options: Options, study: Study) -> tuple[list[RunRecord], int]:
    """Copies the runs; returns them as they were found, and how many things were left out, each of which is named.

    Raises:
        ReportError: not one can be shipped, or the folder holds what publish did not write; nothing was changed then.
        RunHeldError: other processes work on all of them.
    """
    from auvbench.analysis.grouping import failed_training
    from auvbench.analysis.load import load, require
    from auvbench.reporting import copies, shipped
    from auvbench.runs import lock

    folder = study.folder
    copies.prepare(folder)
    runs, problems = load(paths, (options.protocol, *study.also), options.where)
    require(runs, problems, options.protocol)
    _refuse_own(runs, folder)
    held = {run.id: holder for run in runs if (holder := _holder(run)) is not None}
    chosen = [run for run in runs if (run.evaluations or failed_training(run)) and run.id not in held]
    if not any(options.protocol in run.evaluations for run in chosen):
        name, holder = next(iter(held.items()))
        raise lock.RunHeldError(
            Path(name), holder, f"all runs that could be published are at work; {_at_work(held)}"
        )
    # Of a run that is there and cannot be shipped now, an earlier copy stays.
    found = {run.id for run in runs} | {Path(problem.where).name for problem in problems}
    gone = [name for name in copies.names(folder) if name not in found]
    _refuse_named(paths, folder, gone)
    left = [
        f"{run.id}: {said}"
        for run in chosen
        for said in shipped.ship(run, folder, options.protocol, study.paths)
    ]
    for name in gone:
        copies.remove(folder / copies.RUNS / name)
        print(f"removed {folder / copies.RUNS / name}: it is not among the runs that were named")
    copies.tidy_scenarios(folder)
    ids = {run.id for run in chosen}
    untested = [p for p in problems if p.kind == "missing"]
    left += [
        f"{p.where}: {p.message}"
        for p in problems
        if p.kind not in ("missing", "duplicate") and not (p.kind == "failed" and p.where in ids)
    ]
    left += [_at_work({name: holder}) for name, holder in held.items()]
    for line in (*left, *_in_short(untested)):
        print(f"not published: {line}")
    _say_which([p for p in problems if p.kind == "duplicate"])
    return chosen, len(left) + len(untested)


def _in_short(untested: Sequence[Problem]) -> list[str]:
    """A line for each run that was not tested; one for all of them where they are many, as of a whole grid."""
    from auvbench.analysis.formatting import listed

    if len(untested) <= NAMED:
        return [f"{p.where}: {p.message}" for p in untested]
    return [f"{listed([p.where for p in untested], NAMED)}; of the first: {untested[0].message}"]


def _holder(run: RunRecord) -> Holder | None:
    """Who works on a run at present; nobody works on a copy."""
    from auvbench.runs import lock
    from auvbench.runs.schemas import SHIPPED

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
