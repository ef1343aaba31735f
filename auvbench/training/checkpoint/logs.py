"""Files of a run that only grow (episodes.csv, TensorBoard events), cut back to their length at a checkpoint.

A checkpoint records the length of each file and the hash of its content. A resume cuts off what was written after
the checkpoint, because the resumed run writes it again.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from auvbench.runs.atomic_io import fsync_directory, sha256_of_prefix
from auvbench.untrusted.typed_json import Count


@dataclass(frozen=True, slots=True)
class LogMark:
    """The state of one growing file at a checkpoint, as the checkpoint's manifest has it."""

    bytes: Count
    sha256: str
    """of these bytes"""

    def holds(self, path: Path) -> bool:
        """Whether the file still begins with what the checkpoint saw."""
        return self.bytes == 0 or sha256_of_prefix(path, self.bytes) == self.sha256


class GrowingLog:
    """Follow one file and hash what is new since the last mark.

    Args:
        path: the file; it may not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._digest = hashlib.sha256()
        self._length = 0
        self._named = False

    def mark(self) -> LogMark:
        """Fsync the file and its name and return its mark; the writer must have flushed its buffer."""
        if not self.path.exists():
            return LogMark(0, hashlib.sha256().hexdigest())
        with self.path.open("rb") as file:
            file.seek(self._length)
            while block := file.read(1 << 20):
                self._digest.update(block)
                self._length += len(block)
            os.fsync(file.fileno())
        if not self._named:
            fsync_directory(self.path.parent)
            fsync_directory(self.path.parent.parent)
            self._named = True
        return LogMark(self._length, self._digest.hexdigest())


def cut(path: Path, length: int) -> None:
    """Cut a file to `length` bytes; length 0 removes it, also where it does not exist.

    Raises:
        OSError: the file cannot be changed.
    """
    if length == 0:
        path.unlink(missing_ok=True)
        if path.parent.is_dir():
            fsync_directory(path.parent)
        return
    if path.stat().st_size > length:
        with path.open("r+b") as file:
            file.truncate(length)
            os.fsync(file.fileno())
