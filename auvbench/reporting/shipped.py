"""Runs as a study ships them: what its numbers were computed from, compressed, and nothing that only training needs.

    <folder>/runs/<run id>/config.yaml                            as it was, without the place where the run lay
    <folder>/runs/<run id>/manifest.json                          as it was, without the machine's name and the place
    <folder>/runs/<run id>/evaluations/<protocol>/summary.json    as it was, but for the digest of the next but one
    <folder>/runs/<run id>/evaluations/<protocol>/episodes.csv.gz as it was, compressed
    <folder>/runs/<run id>/evaluations/<protocol>/trajectories.npz  paths without commands, of the first protocol alone
    <folder>/runs/<run id>/train/episodes.csv.gz                  the columns that a report reads
    <folder>/runs/<run id>/train/validation.csv.gz                as it was, compressed

A report reads such a folder as it reads runs, and gives the same numbers. The digests still hold: of compressed files
they are those of the content.
"""

from __future__ import annotations

import csv
import io
import shlex
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.analysis import agreement
from auvbench.analysis.model import Evaluation, RunRecord
from auvbench.analysis.training import NUMBERS
from auvbench.analysis.watched import NAME as VALIDATION
from auvbench.errors import RunError
from auvbench.runs import integrity
from auvbench.runs.directory import RunDirectory
from auvbench.runs.files import write_atomic, write_json
from auvbench.untrusted import archives, packed, reading, tables
from auvbench.untrusted.text import short

RUNS = "runs"
PATHS = "trajectories.npz"
OUTPUT = "outputs"
"""what config.yaml says of where the run lay: no part of a run's identity"""

TRAINING = "train/episodes.csv"
TRAINING_COLUMNS = ("outcome", *NUMBERS)


def ship(run: RunRecord, folder: Path, paths_of: str) -> Path:
    """Copies what a report reads of a complete run, and replaces an earlier copy.

    Args:
        run: as `load` read it; the evaluations that it holds are shipped.
        folder: of the study.
        paths_of: the protocol whose kept paths are shipped, too.

    Returns:
        the run's folder there.

    Raises:
        OSError: it cannot be read or written.
        RunError: a file of it is damaged.
    """
    there = RunDirectory(run.directory)
    here = RunDirectory(folder / RUNS / run.id)
    if here.path.is_symlink() or here.path.resolve() == there.path.resolve():
        return here.path
    shutil.rmtree(here.path, ignore_errors=True)
    here.write_config({**there.config(), "output": OUTPUT})
    manifest = without_place(there.manifest())
    files = dict(integrity.table(manifest) or {})
    training = packed.beside(run.directory / TRAINING)
    if training is not None:
        rows = slim(packed.content(run.directory / TRAINING, tables.LARGEST))
        write_atomic(here.path / f"{TRAINING}{packed.SUFFIX}", packed.packed(rows))
        files[TRAINING] = integrity.entry(rows)
    if packed.beside(run.directory / VALIDATION) is not None:
        data = packed.content(run.directory / VALIDATION, tables.LARGEST)
        write_atomic(here.path / f"{VALIDATION}{packed.SUFFIX}", packed.packed(data))
    for evaluation in run.evaluations.values():
        _ship_evaluation(evaluation, here.evaluation(evaluation.protocol), evaluation.protocol == paths_of)
    if integrity.table(manifest) is not None:
        manifest[integrity.FILES] = files
    write_json(here.manifest_path, integrity.sealed(manifest))  # last: a folder without it is no run
    return here.path


def _ship_evaluation(evaluation: Evaluation, target: Path, with_paths: bool) -> None:
    rows = packed.content(evaluation.directory / "episodes.csv", tables.LARGEST)
    write_atomic(target / f"episodes.csv{packed.SUFFIX}", packed.packed(rows))
    summary = dict(evaluation.summary)
    files = dict(integrity.table(summary) or {})
    source = evaluation.directory / PATHS
    if with_paths and source.is_file():
        data = only_paths(source)
        write_atomic(target / PATHS, data)
        files[PATHS] = integrity.entry(data)
    else:
        files.pop(PATHS, None)
    if integrity.table(summary) is not None:
        summary = integrity.sealed({**summary, integrity.FILES: files})
    write_json(target / "summary.json", summary)


def only_paths(file: Path) -> bytes:
    """The trajectories.npz of an evaluation without the commands, which are half of it; nothing is unpickled.

    Raises:
        RunError: it is damaged, or not the one that the summary beside it vouches for.
    """
    try:
        data = reading.content(file, archives.UNPACKED)
        if wrong := agreement.of_neighbour(file, data):
            raise RunError(f"{file.parent}: {wrong}")
        with archives.opened(data) as found:
            kept = {
                name: found[name]
                for name in found.files
                if name.startswith(("position_", "time_", "waypoint_"))
            }
    except archives.FAULTS as error:
        raise RunError(f"{file}: cannot be read: {short(error)}") from error
    stream = io.BytesIO()
    np.savez_compressed(stream, **kept)  # type: ignore[arg-type]
    return stream.getvalue()


def without_place(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """A manifest that does not say on whose machine, or in which folder of it, the run was made."""
    kept = dict(manifest)
    host = kept.get("host")
    if isinstance(host, Mapping):
        kept["host"] = {key: value for key, value in host.items() if key != "name"}
    try:
        words = shlex.split(str(kept.get("command") or ""))
    except ValueError:  # somebody's own text
        words = []
    kept["command"] = shlex.join(word for word in words if not word.startswith("output="))
    return kept


def slim(data: bytes) -> bytes:
    """The rows of training with the columns that a report reads, each number as it was written."""
    rows = csv.DictReader(io.StringIO(data.decode("utf-8")))
    text = io.StringIO()
    writer = csv.DictWriter(text, TRAINING_COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()
