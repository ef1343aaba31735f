"""Read and write entries: archives in which users submit an agent with its results, weights and knowledge.

An entry is a published study with two additions. `entry.json` describes the submitter, the agent and the agent's
knowledge; `models/<run>/` has the files of each run's model. So `auvbench report` reads an entry like any study, and
`auvbench verify` needs only the archive to repeat the agent's test.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from auvbench.analysis.archive import EPISODES, RUNS, Archive
from auvbench.analysis.damage import Damage
from auvbench.analysis.records import RunRecord
from auvbench.errors import ReportError
from auvbench.reporting import archive
from auvbench.runs import integrity
from auvbench.runs.atomic_io import as_json, write_atomic
from auvbench.untrusted import archives, reading, tables, typed_json
from auvbench.untrusted.path_safety import child
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Count, Name, Prose, Range

FILE, MODELS, VERIFIED = "entry.json", "models", "verified.json"
Knowledge = Literal["sheet", "model", "preview", "map", "velocities"]
LARGEST = 512 * 1024**2
"""Largest size of an archive in bytes, packed and unpacked"""


@dataclass(frozen=True, slots=True)
class Entry:
    """Content of entry.json."""

    name: Name
    who: Name
    submitted: Name
    """Time in UTC, ISO 8601"""
    task: Name
    vehicle: Name
    protocol: Name
    scenarios: Name
    """Name of the scenario set, or the fingerprint"""
    knows: tuple[Knowledge, ...]
    """What the agent knows beyond noisy positions and yaw"""
    trials: Count
    """Number of tuning trials that chose the agent's settings"""
    tuned_on: Prose
    """Description of the scenarios on which the tuning trials were tested"""
    cpu: Name
    """Processor of the machine that ran the test"""
    auvbench: Name
    """Version of auvbench"""
    files: dict[str, integrity.FileEntry]
    schema_version: Annotated[int, Range(1, 1)] = 1


@dataclass(frozen=True, slots=True)
class Verified:
    """Content of verified.json."""

    date: Name
    auvbench: Name
    cpu: Name
    same_bits: bool
    """Whether all rows of the repeated test have the same bits as the submitted rows"""
    verdict: Name
    """Verdict on the agent against PID from the submitted rows"""
    again: Name
    """Verdict on the agent against PID from the rows of the repeated test"""
    ok: bool


def pack(entry: Entry, runs: Sequence[RunRecord], folder: Path, target: Path) -> None:
    """Pack an entry into an archive: the description, the tables of the runs, and the files of the runs' models.

    Args:
        entry: description whose list of files is still empty.
        runs: runs tested by the entry's protocol.
        folder: empty folder, into which the tables are written first.
        target: path of the ZIP file.

    Raises:
        OSError: a file cannot be read or written.
        ReportError: a run was changed after it was loaded.
    """
    problems = archive.write(runs, folder, [entry.protocol], trajectories=False)
    if problems:
        raise ReportError(problems[0])
    files = {name: (folder / name).read_bytes() for name in (RUNS, EPISODES)}
    for run in runs:
        for name in integrity.digests(run.manifest, "model/"):
            data = reading.content(child(run.directory, name), reading.WEIGHTS)
            if wrong := integrity.difference(run.manifest, name, data):
                raise ReportError(f"{run.directory}: {short(name)} {wrong}")
            files[f"{MODELS}/{run.id}/{name.removeprefix('model/')}"] = data
    table = {name: integrity.entry(data) for name, data in files.items()}
    document = as_json({**asdict(entry), "files": table})
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in {FILE: document, **files}.items():
            # The date is fixed, so that the same entry gives the same bytes.
            packed.writestr(zipfile.ZipInfo(name, (2026, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED)
    write_atomic(target, stream.getvalue())


def unpack(path: Path, folder: Path) -> Entry:
    """Copy an entry from a ZIP file or a folder into an empty folder, and return its description.

    Raises:
        ReportError: the entry cannot be read, is damaged, or has a file that its description does not name.
    """
    try:
        files = (
            _in_folder(path)
            if path.is_dir()
            else dict(archives.members(reading.content(path, LARGEST), LARGEST))
        )
        entry = read(files.get(FILE, b""), path)
        for name in files:
            if name not in (FILE, VERIFIED, *entry.files):
                raise ValueError(f"it has the file {short(name, 60)}, but {FILE} does not list this file")
        holder = {integrity.FILES: {name: asdict(item) for name, item in entry.files.items()}}
        for name in entry.files:
            target = child(folder, name)
            if name not in files:
                raise ValueError(f"{short(name, 60)} is missing")
            if wrong := integrity.difference(holder, name, files[name]):
                raise ValueError(f"{short(name, 60)} {wrong}")
            write_atomic(target, files[name])
        write_atomic(folder / FILE, files[FILE])
        Archive(folder)
    except FileNotFoundError as error:
        raise ReportError(f"{path}: no such file or folder") from error
    except (OSError, ValueError, Damage) as error:
        raise ReportError(f"{path}: {getattr(error, 'strerror', None) or short(error)}") from error
    return entry


def _in_folder(path: Path) -> dict[str, bytes]:
    """Return the contents of the files in an entry's folder, by name."""
    description = reading.content(path / FILE)
    entry = read(description, path)
    contents = {name: reading.content(child(path, name), tables.FILE) for name in entry.files}
    return {FILE: description, **contents}


def read(data: bytes, where: Path) -> Entry:
    """Return the description of an entry.

    Raises:
        ReportError: the data are not a description.
    """
    try:
        if not data:
            raise ValueError(f"{FILE} is missing")
        return typed_json.convert(reading.json_value(data), Entry)
    except ValueError as error:
        raise ReportError(f"{where}: is not an entry: {short(error)}") from error


def model_files(entry: Entry, run: str) -> list[str]:
    """Return the file names of a run's model in an entry."""
    return [name for name in entry.files if name.startswith(f"{MODELS}/{run}/")]


def write_verified(folder: Path, verified: Verified) -> None:
    """Write the result of a verification into the folder of an entry."""
    write_atomic(folder / VERIFIED, as_json(asdict(verified)))


def overview(folder: Path) -> str:
    """Return the entries in a folder as a Markdown table, newest first."""
    rows: list[tuple[str, str]] = []
    for path in sorted(folder.glob(f"*/{FILE}")):
        entry = read(reading.content(path), path.parent)
        rows.append((entry.submitted, _row(path.parent, entry)))
    header = "| entry | who | date | task, vehicle | knows | trials | tuned on | verified |\n"
    header += "|---" * 8 + "|\n"
    return header + "\n".join(row for _, row in sorted(rows, reverse=True)) + ("\n" if rows else "")


def _row(folder: Path, entry: Entry) -> str:
    from auvbench.reporting.tables.text_formats import escape

    cells = (
        f"[{escape(entry.name)}]({folder.name}/)",
        escape(entry.who),
        escape(entry.submitted[:10]),
        escape(f"{entry.task}, {entry.vehicle}"),
        escape(", ".join(entry.knows) or "nothing more"),
        str(entry.trials),
        escape(short(entry.tuned_on)),
        escape(_status(folder)),
    )
    return f"| {' | '.join(cells)} |"


def _status(folder: Path) -> str:
    try:
        verified = typed_json.read(folder / VERIFIED, Verified)
    except FileNotFoundError:
        return "not yet"
    except (OSError, ValueError):
        return "unknown: verified.json is damaged"
    if not verified.ok:
        return f"no: {verified.again} instead of {verified.verdict} ({verified.date[:10]})"
    return f"{'same bits' if verified.same_bits else 'same verdict'} ({verified.date[:10]})"
