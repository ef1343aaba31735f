"""Types of the JSON files of a run: manifest.json and the summary.json of an evaluation.

Code reads the plain dictionaries, in which entries of a newer auvbench survive; these types say what it can rely on.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from auvbench.runs import integrity
from auvbench.runs.identity import SCHEMA_VERSION
from auvbench.runs.integrity import FileEntry
from auvbench.untrusted import documents, reading, typed_json
from auvbench.untrusted.typed_json import Count, Name, Prose, Range, Seconds, Share


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a run failed."""

    message: Prose | None = None
    step: Count | None = None
    type: str | None = None
    traceback: Prose | None = None


@dataclass(frozen=True, slots=True)
class Host:
    """The machine that computed something."""

    name: str | None = None
    cpu: str | None = None
    cores: Count | None = None
    threads: Count | None = None


@dataclass(frozen=True, slots=True)
class Git:
    """The checkout that auvbench ran from."""

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
    created: str | None = None
    started: str | None = None
    ended: str | None = None
    cpu_time_s: Seconds | None = None
    phases: dict[str, Seconds] | None = None
    command: Prose | None = None
    analysis: str | None = None
    versions: dict[str, str] | None = None
    git: Git | None = None
    host: Host | None = None
    files: dict[str, FileEntry] | None = None
    episodes_begun_again: list[Count] = field(default_factory=list)
    started_over: list[Count] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition of a test; its rates and means are compared with its rows where they are read."""

    name: Name
    episodes: Annotated[int, Range(1)]
    frequency_hz: float | None = None
    max_steps: Count | None = None
    notes: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Summary:
    """summary.json of an evaluation."""

    fingerprint: Name
    conditions: list[Condition]
    files: dict[str, FileEntry]
    run: str | None = None
    protocol: str | None = None
    model: dict[str, str] | None = None
    fingerprint_parts: dict[str, str] | None = None
    seed: Count | None = None
    scenarios: str | None = None
    clocks: dict[str, str] | None = None
    inference: dict[str, Any] | None = None
    versions: dict[str, str] | None = None


def read(path: Path, schema: type[Manifest | Summary]) -> dict[str, Any]:
    """Return the content of a manifest or summary, checked against its schema.

    Raises:
        OSError: it is missing or cannot be read.
        integrity.VersionError: it has another schema version.
        ValueError: it is damaged; the message names the entry.
    """
    return checked(documents.json_value(reading.content(path)), schema)


def checked(value: Any, schema: type[Manifest | Summary]) -> dict[str, Any]:
    """Return a JSON value as a manifest or summary, checked against its seal and schema.

    Raises:
        integrity.VersionError, ValueError: as `read`.
    """
    found = integrity.check_sealed(value, SCHEMA_VERSION)
    typed_json.convert(found, schema)
    return found
