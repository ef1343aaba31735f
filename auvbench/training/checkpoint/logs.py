"""Truncate a run's growing files (episodes.csv, TensorBoard events) to their length at a checkpoint.

A checkpoint records the length of each file and the hash of its content. A resume cuts off later content,
because the resumed run writes it again.
"""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

from auvbench.runs.atomic_io import fsync, sha256_of_prefix
from auvbench.tracking import Tracker
from auvbench.untrusted.typed_json import Count

NAME = "events.out.tfevents.auvbench"


class EventWriter:
    """Append scalars to `folder/events.out.tfevents.auvbench`.

    Args:
        folder: folder for TensorBoard.
        tracker: tracker that logs the same scalars.

    Raises:
        OSError: the file cannot be opened.
    """

    def __init__(self, folder: Path, tracker: Tracker | None = None) -> None:
        self.path = folder / NAME
        self._tracker = tracker
        folder.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("ab")
        self._records = RecordWriter(self._file)
        if self._file.tell() == 0:
            self._add(Event(wall_time=time.time(), file_version="brain.Event:2"))
            self._file.flush()

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Append scalars by name, in the order of their names."""
        for key, value in sorted(scalars.items()):
            summary = Summary(value=[Summary.Value(tag=key, simple_value=float(value))])
            self._add(Event(wall_time=time.time(), step=step, summary=summary))
        self._file.flush()
        if self._tracker is not None:
            self._tracker.write(scalars, step)

    def close(self) -> None:
        """Close the file and the tracker; if an exception is being handled, pass it to the tracker."""
        self._file.close()
        if self._tracker is not None:
            self._tracker.close(sys.exception())

    def _add(self, event: Event) -> None:
        self._records.write(event.SerializeToString())


@dataclass(frozen=True, slots=True)
class LogMark:
    """State of one growing file at a checkpoint, as recorded in the checkpoint's manifest."""

    bytes: Count
    sha256: str
    """SHA-256 of the file's first `bytes` bytes"""

    def holds(self, path: Path) -> bool:
        """Return whether the file still begins with the content that it had at the checkpoint."""
        return self.bytes == 0 or sha256_of_prefix(path, self.bytes) == self.sha256


class GrowingLog:
    """Follows one file, and hashes the content that was added since the last mark.

    Args:
        path: path of the file; it may not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._digest = hashlib.sha256()
        self._length = 0
        self._named = False

    def mark(self) -> LogMark:
        """Sync the file and its folder entry to disk and return its mark. The writer must have flushed its buffer."""
        if not self.path.exists():
            return LogMark(0, hashlib.sha256().hexdigest())
        with self.path.open("rb") as file:
            file.seek(self._length)
            while block := file.read(1 << 20):
                self._digest.update(block)
                self._length += len(block)
            os.fsync(file.fileno())
        if not self._named:
            fsync(self.path.parent)
            fsync(self.path.parent.parent)
            self._named = True
        return LogMark(self._length, self._digest.hexdigest())


def cut(path: Path, length: int) -> None:
    """Truncate a file to `length` bytes; length 0 removes it if it exists.

    Raises:
        OSError: the file cannot be changed.
    """
    if length == 0:
        path.unlink(missing_ok=True)
        if path.parent.is_dir():
            fsync(path.parent)
        return
    if path.stat().st_size > length:
        with path.open("r+b") as file:
            file.truncate(length)
            os.fsync(file.fileno())
