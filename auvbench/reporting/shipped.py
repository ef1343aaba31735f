"""Runs as a study ships them: what its numbers were computed from, compressed, and nothing that only training needs.

    <folder>/runs/<run id>/config.yaml                            as it was, without the place where the run lay
    <folder>/runs/<run id>/manifest.json                          as it was, marked, without the machine's name and the place
    <folder>/runs/<run id>/evaluations/<protocol>/summary.json    as it was, but for the digests of the next three, and means
                                                                  of the rows as they are shipped; of further protocols none
    <folder>/runs/<run id>/evaluations/<protocol>/episodes.csv.bz2  numbers to four significant digits; of further
                                                                  protocols to three, and the columns that every report needs
    <folder>/scenarios/<digest>.csv.bz2                           what the rows of the first protocol have in common: waypoints,
                                                                  starts and distances, as they were
    <folder>/runs/<run id>/evaluations/<protocol>/trajectories.npz  paths to 1 mm, packed, of the first protocol alone
    <folder>/runs/<run id>/train/episodes.csv.bz2                  the columns that a report reads
    <folder>/runs/<run id>/train/validation.csv.bz2                as it was, compressed

A report reads such a folder as it reads runs, and gives the numbers that are shipped, which are computed from it. The
digests hold: of compressed files they are those of the content.
"""

from __future__ import annotations

import csv
import io
import shlex
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auvbench.analysis import consistency, derived_columns, packed_paths, scenarios
from auvbench.analysis.evaluations import CORE_COLUMNS, MEASURED, Damage, sealed
from auvbench.analysis.model import Evaluation, RunRecord
from auvbench.analysis.training import NUMBERS, training
from auvbench.analysis.validation_curve import NAME as VALIDATION
from auvbench.errors import RunError
from auvbench.reporting import copies
from auvbench.runs import integrity, schemas
from auvbench.runs.atomic_io import as_lines, write_atomic
from auvbench.runs.directory import RunDirectory
from auvbench.untrusted import archives, bz2_io, reading, tables
from auvbench.untrusted.text import short

PATHS = "trajectories.npz"
OUTPUT = "outputs"
"""what config.yaml says of where the run lay: no part of a run's identity"""

TRAINING = "train/episodes.csv"
TRAINING_COLUMNS = ("outcome", *NUMBERS)

FURTHER_COLUMNS = ("condition", "frequency_hz", "episode", "outcome", *CORE_COLUMNS)
"""of the rows of protocols that are shipped beside the first: a robustness test has thousands of episodes for each run"""

DIGITS = 4
"""significant ones of a shipped number: a centimetre of a way of 50 m, and a third of the room of all 17"""
TRAINING_DIGITS = 5
FURTHER_DIGITS = 3
"""of the rows of further protocols"""


def ship(run: RunRecord, folder: Path, protocol: str, paths: bool = True) -> list[str]:
    """Copies what a report reads of a run, and replaces an earlier copy; one that lies there already stays as it is.

    Args:
        run: as `load` read it, complete or failed; the evaluations that it holds are shipped. Those that an earlier copy
            has beside them stay, where they are of the same model.
        folder: of the study, in which `copies.prepare` found nothing foreign.
        protocol: the first one, of which all columns are shipped, and the kept paths.
        paths: whether these are shipped.

    Returns:
        what of the run was left out, in words.

    Raises:
        OSError: it cannot be read or written.
        RunError: it was changed since `load` read it, a file of it is damaged, or its id names no folder.
    """
    if Path(run.id).name != run.id or run.id.startswith("."):
        raise RunError(f"{run.directory}: its id is {short(repr(run.id), 60)}, which names no folder")
    copy = folder / copies.RUNS / run.id
    if copy.resolve() == run.directory.resolve():
        return []
    config = RunDirectory(run.directory).config()
    if wrong := consistency.of_run(run.manifest, config):
        raise RunError(f"{run.directory}: {wrong}: it was changed meanwhile; publish again")
    staged = copies.stage(copy)
    here = RunDirectory(staged)
    here.write_config(_placeless(config))
    manifest = without_place(run)
    files = integrity.table(manifest)
    problems = []
    try:
        if (rows := _training(run)) is not None:
            write_atomic(staged / f"{TRAINING}{bz2_io.SUFFIX}", bz2_io.packed(rows))
            files[TRAINING] = integrity.entry(rows)
    except (Damage, OSError) as error:
        problems.append(short(error))
        files.pop(TRAINING, None)
    try:
        if bz2_io.beside(run.directory / VALIDATION) is not None:
            data = bz2_io.content(run.directory / VALIDATION, reading.DATA)
            write_atomic(staged / f"{VALIDATION}{bz2_io.SUFFIX}", bz2_io.packed(data))
    except ValueError as error:
        problems.append(f"{VALIDATION}: {short(error)}")
    for evaluation in run.evaluations.values():
        first = evaluation.protocol == protocol
        target = here.evaluation(evaluation.protocol)
        _ship_evaluation(evaluation, target, folder, first, first and paths)
    _keep_evaluations(copy, staged, run.manifest)
    manifest[integrity.FILES] = files
    write_atomic(here.manifest_path, as_lines(integrity.sealed({**manifest, schemas.SHIPPED: True})))
    copies.put(staged, copy)
    return problems


def _training(run: RunRecord) -> bytes | None:
    """Return the training rows that a report reads; None without any.

    Raises:
        Damage: they are not what the manifest records, or hold what no training writes.
        OSError: they cannot be read.
    """
    if training(run) is None:
        return None
    return slim(bz2_io.content(run.directory / TRAINING, reading.DATA))


def _ship_evaluation(evaluation: Evaluation, target: Path, study: Path, first: bool, paths: bool) -> None:
    rows = bz2_io.content(evaluation.directory / "episodes.csv", reading.DATA)
    if wrong := consistency.of_file(evaluation.summary, "episodes.csv", rows):
        raise RunError(f"{evaluation.directory}: {wrong}: it was changed meanwhile; publish again")
    summary = dict(evaluation.summary)
    if first:
        rows, shared = scenarios.split(rows)
        if scenarios.NAMED in summary:  # a copy's
            shared = scenarios.of_study(summary[scenarios.NAMED], evaluation.directory)
        rows, left_out = _without_following(rows, summary)
        rows = rounded(rows, DIGITS)
        frame = derived_columns.completed(tables.csv(rows, words=("condition",)), left_out)
        summary = consistency.renewed(summary, frame)
        if shared is not None:
            summary[scenarios.NAMED] = copies.put_scenarios(shared, study)
    else:
        rows, _ = _without_following(rows, summary)
        rows = rounded(rows, FURTHER_DIGITS, FURTHER_COLUMNS)
        summary = consistency.without_means(summary)
        summary.pop(scenarios.NAMED, None)
    write_atomic(target / f"episodes.csv{bz2_io.SUFFIX}", bz2_io.packed(rows))
    files = integrity.table(summary) | {"episodes.csv": integrity.entry(rows)}
    source = evaluation.directory / PATHS
    if paths and source.is_file():
        data = only_paths(source)
        write_atomic(target / PATHS, data)
        files[PATHS] = integrity.entry(data)
    else:
        files.pop(PATHS, None)
    summary = integrity.sealed({**summary, integrity.FILES: files})
    write_atomic(target / "summary.json", as_lines(summary))


def _without_following(rows: bytes, summary: dict[str, Any]) -> tuple[bytes, list[str]]:
    """Rows without what follows from others; the summary says which columns, those that a copy left out already among them."""
    rows, names = derived_columns.split(rows)
    left_out = sorted({*derived_columns.named(summary), *names})
    if left_out:
        summary[derived_columns.NAMED] = left_out
    return rows, left_out


def _keep_evaluations(former: Path, staged: Path, manifest: Mapping[str, Any]) -> None:
    """Takes over the evaluations of an earlier copy that were not asked for now: their rows may be nowhere else."""
    for summary in sorted(former.glob("evaluations/*/summary.json")):
        folder = summary.parent
        target = staged / "evaluations" / folder.name
        try:
            found = sealed(summary, schemas.Summary)
        except Damage:
            continue
        if not target.exists() and not consistency.of_evaluation(manifest, found, folder.name):
            shutil.copytree(folder, target)


def only_paths(file: Path) -> bytes:
    """The paths in the trajectories.npz of an evaluation, packed, without the commands; nothing is unpickled.

    Raises:
        RunError: it is damaged, or not the one that the summary beside it vouches for.
    """
    try:
        data = reading.content(file, reading.DATA)
        if wrong := consistency.of_neighbour(file, data):
            raise RunError(f"{file.parent}: {wrong}")
        with archives.opened(data) as found:
            if packed_paths.holds(found.files):
                return data
            kept = {
                name: found[name]
                for name in found.files
                if name.startswith(("position_", "time_", "waypoint_"))
            }
        return packed_paths.pack(kept)
    except archives.FAULTS as error:
        raise RunError(f"{file}: cannot be read: {short(error)}") from error


def without_place(run: RunRecord) -> dict[str, Any]:
    """The manifest of a run, silent on whose machine, and in which folder of it, the run was made."""
    kept = dict(run.manifest)
    host = kept.get("host")
    if isinstance(host, Mapping):
        kept["host"] = {key: value for key, value in host.items() if key != "name"}
    try:
        words = shlex.split(str(kept.get("command") or ""))
    except ValueError:  # somebody's own text
        words = []
    kept["command"] = shlex.join(word for word in words if not word.startswith("output="))
    error = kept.get("error")
    if isinstance(error, Mapping):  # a traceback is full of places, and a message may name the run's
        message = str(error.get("message", "no message"))
        for place in (run.directory.absolute().parent, run.directory.parent):
            message = message.replace(f"{place}/", "")
        kept["error"] = {"message": message, "step": error.get("step")}
    return kept


def _placeless(config: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration without the folders in which the run, and a policy's file, lay: neither is part of its identity."""
    kept = {**config, "output": OUTPUT}
    algo = config.get("algo")
    if isinstance(algo, Mapping) and algo.get("path"):
        kept["algo"] = {**algo, "path": Path(str(algo["path"])).name}
    return kept


def slim(data: bytes) -> bytes:
    """The rows of training with the columns that a report reads, to `TRAINING_DIGITS` significant digits."""
    rows = csv.DictReader(io.StringIO(data.decode("utf-8")))
    shortened = [{**row, **{name: _rounded(row[name], TRAINING_DIGITS) for name in NUMBERS}} for row in rows]
    return tables.text(shortened, TRAINING_COLUMNS)


def rounded(data: bytes, digits: int, columns: Sequence[str] | None = None) -> bytes:
    """The rows of a test, what was measured to so many significant digits; those of `columns` that are there, all with None.

    What a row is known by (its condition, its step frequency) stays as it was: a summary names it, too.
    """
    rows = csv.DictReader(io.StringIO(data.decode("utf-8")))
    there = rows.fieldnames or ()
    kept = [name for name in there if columns is None or name in columns]
    shortened = [
        {name: _rounded(row[name], digits) if name in MEASURED else row[name] for name in kept}
        for row in rows
    ]
    return tables.text(shortened, kept)


def _rounded(written: str, digits: int) -> str:
    """A number, shortened; a whole one as it was written."""
    return repr(float(f"{float(written):.{digits}g}")) if "." in written or "e" in written else written
