"""Compute and check the digests of files.

The manifest of a run and the summary of a test each have a table `files`, which maps each file's path to its size in bytes
and SHA-256. The manifest and the summary also have a `seal`, the SHA-256 of all other entries. When a file is read, its
digest is checked. A flipped bit in a file, a digest or another entry is therefore detected.

Digests detect accidents but not tampering: a person who changes a file can also change its digest.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from auvbench.runs.atomic_io import as_json, replace_folder, sha256, storage
from auvbench.runs.identity import SCHEMA_VERSION
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.path_safety import child
from auvbench.untrusted.text import short
from auvbench.untrusted.typed_json import Count, Name, Prose, Range, Seconds, Share

SEAL = "seal"
FILES = "files"

Entry = dict[str, Any]
"""a `FileEntry` as JSON"""


@dataclass(frozen=True, slots=True)
class FileEntry:
    """Size and digest of a file."""

    bytes: Count
    sha256: str


class VersionError(ValueError):
    """A file has another schema version."""


def entry(data: bytes) -> Entry:
    """Return the entry for a file with the content `data`."""
    return {"bytes": len(data), "sha256": sha256(data)}


def entry_of(path: Path) -> Entry:
    """Return the entry for a file on disk; the file is read in blocks.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        return {"bytes": file.tell(), "sha256": digest}


def sealed(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of `value` with their seal as the last entry."""
    return {**_bare(value), SEAL: _seal(value)}


def replace_sealed(
    folder: Path, name: str, holder: Mapping[str, Any], files: Mapping[str, bytes]
) -> dict[str, Entry]:
    """Create or replace a folder with files and a sealed JSON file that records their digests; return the entries by file name.

    Args:
        folder: path of the folder.
        name: name of the JSON file.
        holder: other entries of the JSON file.
        files: content of each file by name.

    Raises:
        TrainingError: the disk is full, read-only or failing.
    """
    recorded = {file: entry(data) for file, data in files.items()}
    document = as_json(sealed({**holder, FILES: recorded}))
    with storage(f"cannot write {folder}"):
        replace_folder(folder, {**files, name: document})
    return recorded


def read_sealed(path: Path, *versions: int) -> dict[str, Any]:
    """Return the JSON object in a sealed file.

    Raises:
        OSError: the file is missing or cannot be read.
        VersionError, ValueError: see `check_sealed`.
    """
    return check_sealed(reading.json_value(reading.content(path)), *versions)


def check_sealed(value: Any, *versions: int) -> dict[str, Any]:
    """Check a sealed JSON object and return it.

    Raises:
        VersionError: the object has another schema version.
        ValueError: the value is not a JSON object, or was changed since it was written.
    """
    if not isinstance(value, dict):
        raise ValueError("it is not a JSON object")
    broken = broken_seal(value)
    readable = " and ".join(map(str, versions))
    version_found = value.get("schema_version")
    # If the seal is broken, a flipped bit may have changed the version; the error then says that the file is damaged.
    if version_found not in versions and (SEAL not in value or not broken):
        raise VersionError(
            f"schema_version {short(version_found, 40)}, but this auvbench reads {readable}; use the "
            "auvbench that wrote it"
        )
    if broken:
        raise ValueError(broken)
    return value


def broken_seal(value: Mapping[str, Any]) -> str:
    """Return what is wrong with the seal of a manifest or summary; '' if the seal is correct."""
    if SEAL not in value:
        return f"its {SEAL} is missing"
    return "" if value[SEAL] == _seal(value) else f"it was changed since it was written (its {SEAL} differs)"


def _bare(value: Mapping[str, Any]) -> dict[str, Any]:
    return {key: item for key, item in value.items() if key != SEAL}


def _seal(value: Mapping[str, Any]) -> str:
    return sha256(json.dumps(_bare(value), sort_keys=True, separators=(",", ":")).encode())


def table(holder: Mapping[str, Any]) -> dict[str, Entry]:
    """Return the table `files` of a manifest or summary: entry by file name."""
    return dict(holder.get(FILES) or {})


def digests(holder: Mapping[str, Any], prefix: str) -> dict[str, str]:
    """Return the SHA-256 of the recorded files whose names begin with `prefix`."""
    return {name: item["sha256"] for name, item in table(holder).items() if name.startswith(prefix)}


def difference(holder: Mapping[str, Any], name: str, data: bytes) -> str:
    """Return how the content of a file differs from its entry in the table; '' if it is unchanged.

    Args:
        holder: manifest or summary.
        name: name of the file in the table.
        data: content of the file.
    """
    expected = table(holder).get(name)
    if expected is None:
        return "has no valid digest"
    if len(data) != expected["bytes"]:
        return f"has {len(data):,} bytes instead of {expected['bytes']}"
    return "" if sha256(data) == expected["sha256"] else "differs from its digest: it was changed or damaged"


def lacking(folder: Path, holder: Mapping[str, Any], prefix: str = "", *, deep: bool = True) -> str:
    """Return the first recorded file that is missing, unreadable or changed, with the reason; '' if all files are unchanged.

    Args:
        folder: folder that the names in the table are relative to.
        holder: manifest or summary.
        prefix: check only files whose names begin with this prefix.
        deep: compare the content; otherwise compare only the size.
    """
    for name, expected in table(holder).items():
        if not name.startswith(prefix):
            continue
        try:
            path = child(folder, name)
            if deep:
                wrong = difference(holder, name, reading.content(path, reading.WEIGHTS))
            else:
                size = path.stat().st_size
                wrong = (
                    "" if size == expected["bytes"] else f"has {size:,} bytes instead of {expected['bytes']}"
                )
        except FileNotFoundError:
            wrong = "is missing"
        except (OSError, ValueError) as error:
            wrong = f"cannot be read: {getattr(error, 'strerror', None) or error}"
        if wrong:
            return f"{short(name)} {wrong}"
    return ""


@dataclass(frozen=True, slots=True)
class Failure:
    """Reason of a run's failure."""

    message: Prose | None = None
    step: Count | None = None
    type: str | None = None
    traceback: Prose | None = None


@dataclass(frozen=True, slots=True)
class Host:
    """Machine that computed a result."""

    name: str | None = None
    cpu: str | None = None
    cores: Count | None = None
    threads: Count | None = None


@dataclass(frozen=True, slots=True)
class Git:
    """Git checkout that auvbench ran from."""

    commit: str | None = None
    dirty: bool | None = None


@dataclass(frozen=True, slots=True)
class Manifest:
    """manifest.json of a run."""

    id: str
    state: Literal["pending", "running", "interrupted", "failed", "complete"]
    algo: str
    seed: Count
    steps: Count
    total_steps: Count
    attempts: Count
    wall_time_s: Seconds
    error: Failure | None
    episodes: Count | None = None
    success_rate: Share | None = None
    started: str | None = None
    ended: str | None = None
    created: str | None = None
    cpu_time_s: Seconds | None = None
    command: Prose | None = None
    phases: dict[str, Seconds] | None = None
    analysis: str | None = None
    versions: dict[str, str] | None = None
    git: Git | None = None
    host: Host | None = None
    files: dict[str, FileEntry] | None = None
    episodes_begun_again: list[Count] = field(default_factory=list)
    started_over: list[Count] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition of a test. The file also has rates and means, but readers compute these numbers from the test's rows."""

    name: Name
    episodes: Annotated[int, Range(1)]
    frequency_hz: Annotated[float, Range(1e-9)]
    max_steps: Count
    notes: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Inference:
    """Median processor time per action in ms, and the processor."""

    median_ms: Seconds
    cpu: str


@dataclass(frozen=True, slots=True)
class Sealed:
    """Sealed protocol that a test used (`evaluation.sealed`)."""

    sha256: dict[str, str]
    """Digests of the protocol's files, by file name"""
    not_tested: list[str]
    """Conditions and tasks of the protocol that were not tested, one line each with the reason"""


@dataclass(frozen=True, slots=True)
class Summary:
    """summary.json of an evaluation."""

    fingerprint: Name
    conditions: list[Condition]
    files: dict[str, FileEntry]
    run: str
    protocol: str
    model: dict[str, str]
    fingerprint_parts: dict[str, str]
    seed: Count
    scenarios: str
    inference: Inference | None
    versions: dict[str, str]
    clocks: dict[str, str] | None = None
    sealed: Sealed | None = None


def read(path: Path, schema: type) -> dict[str, Any]:
    """Return the content of a manifest, a summary or another sealed file, checked against its schema.

    Raises:
        OSError: the file is missing or cannot be read.
        VersionError: the file has another schema version.
        ValueError: the file is damaged; the message names the entry.
    """
    return checked(reading.json_value(reading.content(path)), schema)


def checked(value: Any, schema: type) -> dict[str, Any]:
    """Return a JSON value as the content of a sealed file, checked against its seal and schema.

    Raises:
        VersionError, ValueError: see `read`.
    """
    content = check_sealed(value, SCHEMA_VERSION)
    typed_json.convert(content, schema)
    return content
