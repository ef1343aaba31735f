"""Keep the history of an experiment: one line whenever a training starts or ends, a run is tested, or runs are declared.

If a run is deleted, its lines stay in the history.

`history.jsonl` is in the experiment's folder, next to the runs. Lines are only appended, each by a single
write, so that processes and nodes can write at the same time. If a line cannot be written, auvbench warns, and the
run continues.
"""

from __future__ import annotations

import json
import os
import stat
import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from auvbench.errors import AuvbenchWarning
from auvbench.untrusted import reading, typed_json
from auvbench.untrusted.typed_json import Count, Name

FILE = "history.jsonl"
LONGEST = 4096
"""Largest line in bytes"""
Event = Literal["running", "complete", "failed", "interrupted", "tested", "declared"]
"""Kind of a line: the state that a run has entered, `tested` for a test of a run, or `declared` for the declaration of runs"""
STARTED: Event = "running"
TESTED: Event = "tested"
DECLARED: Event = "declared"


@dataclass(frozen=True, slots=True)
class Line:
    """One entry of the history. Unknown fields of a line are ignored."""

    time: Name
    """Time in UTC, ISO 8601"""
    event: Event
    run: Name | None = None
    algo: Name | None = None
    seed: Count | None = None
    steps: Count | None = None
    """Environment steps of the training so far"""
    protocol: Name | None = None
    fingerprint: Name | None = None
    """Fingerprint of the test's scenarios"""
    episodes: Count | None = None
    """Test episodes of all conditions together"""
    analysis: Name | None = None
    """Digest of a declaration"""

    @property
    def text(self) -> str:
        """Return the line as JSON."""
        return json.dumps({key: value for key, value in asdict(self).items() if value is not None})


def append(folder: Path, line: Line) -> None:
    """Append a line to the history of an experiment; warn if the line cannot be written."""
    flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(folder / FILE, flags, 0o644)
        try:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
                raise OSError("it is not a regular file, or it has a second hard link")
            # If a full disk or a power cut truncated the last line, a line break keeps the new line separate.
            cut = status.st_size > 0 and os.pread(descriptor, 1, status.st_size - 1) != b"\n"
            os.write(descriptor, b"\n" * cut + line.text.encode()[:LONGEST] + b"\n")
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        reason = f"{folder / FILE}: cannot write the history: {error.strerror or error}"
        warnings.warn(AuvbenchWarning(reason), stacklevel=2)


def entered(folder: Path, manifest: Mapping[str, Any], time: str) -> None:
    """Append a line for the state in a run's manifest."""
    append(
        folder,
        Line(time, manifest["state"], manifest["id"], manifest["algo"], manifest["seed"], manifest["steps"]),
    )


def read(folder: Path) -> list[Line]:
    """Return the history lines of an experiment or a published study; damaged lines are skipped.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is longer than the limit.
    """
    try:
        data = reading.content(folder / FILE)
    except FileNotFoundError:
        return []
    lines = []
    for text in data.splitlines():
        try:
            lines.append(typed_json.convert(reading.json_value(text), Line))
        except ValueError:
            continue
    return lines


def merged(histories: Iterable[Iterable[Line]]) -> list[Line]:
    """Return the lines of several histories without duplicates, sorted by time."""
    lines = dict.fromkeys(line for history in histories for line in history)
    return sorted(lines, key=lambda line: line.time)


def as_bytes(lines: Iterable[Line]) -> bytes:
    """Return the content of a history's file."""
    return "".join(f"{line.text}\n" for line in lines).encode()


def deleted(lines: Iterable[Line], existing: Collection[str]) -> set[str]:
    """Return the ids of runs that were trained or tested but are not in `existing`."""
    events = (STARTED, TESTED)
    return {line.run for line in lines if line.event in events and line.run is not None} - set(existing)


def summary(lines: Collection[Line], existing: Collection[str]) -> str:
    """Return, as text, the numbers of trainings and tests: in total, and for the runs that are not in `existing`.

    >>> lines = [Line("2026", "running", "a"), Line("2026", "tested", "a"), Line("2026", "tested", "b")]
    >>> summary(lines, ["a"])
    '1 training and 2 tests; 0 trainings and 1 test are of 1 run that is not here'
    """
    started = {line.run for line in lines if line.event == STARTED}
    tested = [line.run for line in lines if line.event == TESTED]
    gone = deleted(lines, existing)

    def counts(trainings: int, tests: int) -> str:
        return f"{_counted(trainings, 'training')} and {_counted(tests, 'test')}"

    text = counts(len(started), len(tested))
    if not gone:
        return text
    of_gone = counts(len(started & gone), sum(run in gone for run in tested))
    relation = "run that is" if len(gone) == 1 else "runs that are"
    return f"{text}; {of_gone} are of {len(gone)} {relation} not here"


def _counted(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"
