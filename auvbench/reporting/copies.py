"""The folder of a study's shipped runs: what in it `auvbench publish` wrote, and how a copy is replaced or removed.

Beside the copies lie the scenarios that their rows have in common, each table under its digest.

A copy says so itself, in its manifest and under the seal. Whatever does not is somebody's run, which may hold the only
weights there are: it is never replaced and never removed.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from auvbench.analysis import scenarios
from auvbench.errors import ReportError, RunError
from auvbench.runs.atomic_io import fsync_directory, make_folder, sha256, write_atomic
from auvbench.runs.directory import RunDirectory
from auvbench.runs.schemas import SHIPPED
from auvbench.untrusted import bz2_io, documents, reading
from auvbench.untrusted.text import short

RUNS = "runs"

WRITTEN = re.compile(
    r"config\.yaml|manifest\.json|train/(episodes|validation)\.csv\.bz2"
    r"|evaluations/[^/]+/(summary\.json|episodes\.csv\.bz2|trajectories\.npz)"
)
"""names of the files of a copy, relative to it"""

OURS = re.compile(r"[0-9a-f]{16}\.csv\.bz2")
"""names of tables of scenarios"""

NEW, OLD = "new", "old"
"""what a copy is called while it is written, and the one that it replaces until it is there"""


def why_not_ours(path: Path) -> str:
    """Why a folder is no copy that publish may replace or remove, in words; empty where it is one."""
    try:
        manifest = RunDirectory(path).manifest()
    except RunError as error:
        return str(error).removeprefix(f"{path}: ").removeprefix(f"{path}/")
    if manifest.get(SHIPPED) is not True:
        return "a run, not a copy of one"
    return _foreign(path)


def _foreign(path: Path) -> str:
    """The first thing in a copy that publish did not write; hidden files are the file manager's."""
    if path.is_symlink():
        return "a symbolic link"
    for file in sorted(path.rglob("*")):
        name = file.relative_to(path).as_posix()
        if file.is_symlink() or (
            file.is_file() and not file.name.startswith(".") and not WRITTEN.fullmatch(name)
        ):
            return f"it holds {short(name, 80)}, which publish did not write"
    return ""


def prepare(folder: Path) -> None:
    """Looks through `<folder>/runs` before anything is written, and completes a replacement that was interrupted.

    Raises:
        ReportError: it holds a run, or another folder, that is not publish's own.
    """
    runs = folder / RUNS
    for place in (runs, folder / scenarios.FOLDER):
        if place.is_symlink():
            raise ReportError(
                f"{place}: a symbolic link; publish writes to no place that a folder leads it to"
            )
    if not runs.is_dir():
        return
    for former in _left(runs, OLD):
        copy = runs / _name(former)
        if not copy.exists() and not why_not_ours(former):
            former.rename(copy)
    for path in sorted(_folders(runs)):
        if why := why_not_ours(path):
            raise ReportError(
                f"{path}: {why}; nothing there is replaced or removed: move it away, or name another folder with --to"
            )
    for leftover in (*_left(runs, OLD), *_left(runs, NEW)):
        if not _foreign(leftover):
            shutil.rmtree(leftover)


def names(folder: Path) -> list[str]:
    """Ids of the copies in a study's folder."""
    return sorted(path.name for path in _folders(folder / RUNS))


def _folders(runs: Path) -> Iterator[Path]:
    """What a report would read there: not `report`, which `auvbench report` writes, nor what is hidden."""
    for path in runs.iterdir() if runs.is_dir() else ():
        if path.is_dir() and not path.name.startswith(".") and path.name != "report":
            yield path


def _left(runs: Path, kind: str) -> list[Path]:
    return sorted(path for path in runs.glob(f".*.{kind}") if path.is_dir() and not path.is_symlink())


def _name(left: Path) -> str:
    return left.name[1:].rpartition(".")[0]


def stage(copy: Path) -> Path:
    """An empty folder beside a copy, in which the new one is written."""
    staged = copy.with_name(f".{copy.name}.{NEW}")
    if staged.is_dir():
        shutil.rmtree(staged)
    make_folder(staged)
    return staged


def put(staged: Path, copy: Path) -> None:
    """Puts a copy that was written beside in its place; the earlier one is there until then.

    Raises:
        RunError: what is there is no copy of publish's.
    """
    former = copy.with_name(f".{copy.name}.{OLD}")
    if copy.exists():
        if why := why_not_ours(copy):
            raise RunError(f"{copy}: {why}; left alone")
        copy.rename(former)
    staged.rename(copy)
    fsync_directory(copy.parent)
    if former.is_dir():
        shutil.rmtree(former)


def remove(copy: Path) -> None:
    """Removes a copy: out of sight at once, so that an interruption leaves no half of it.

    Raises:
        RunError: it is no copy of publish's.
    """
    if why := why_not_ours(copy):
        raise RunError(f"{copy}: {why}; left alone")
    doomed = copy.with_name(f".{copy.name}.{NEW}")
    if doomed.is_dir():
        shutil.rmtree(doomed)
    copy.rename(doomed)
    shutil.rmtree(doomed)


def put_scenarios(table: bytes, folder: Path) -> str:
    """Writes scenarios that runs have in common beside them, where they are not there yet; the digest that names them."""
    digest = sha256(table)
    file = folder / scenarios.FOLDER / scenarios.name_of(digest)
    data = bz2_io.packed(table)
    if not file.is_file() or file.read_bytes() != data:
        write_atomic(file, data)
    return digest


def tidy_scenarios(folder: Path) -> None:
    """Removes tables of scenarios that no copy names any more."""
    named = set()
    for summary in (folder / RUNS).glob("*/evaluations/*/summary.json"):
        try:
            found = documents.json_value(reading.content(summary))
        except (OSError, ValueError):
            return  # a damaged one may name any of them
        if isinstance(found, dict) and isinstance(digest := found.get(scenarios.NAMED), str):
            named.add(scenarios.name_of(digest))
    for file in (folder / scenarios.FOLDER).glob(f"*.csv{bz2_io.SUFFIX}"):
        if OURS.fullmatch(file.name) and file.name not in named and not file.is_symlink():
            file.unlink()
