"""The replay buffer on disk: segments of fixed ranges of rows, so that a checkpoint writes only what is new.

A row is what all environments did in one step. Rows are numbered from the start of the run, so the row r lies
in the ring at r % size, and a segment `<first>-<last>.npz` holds the rows first <= r < last. Segments begin at
multiples of a fixed length; the last one is short and is written again, longer, at the next checkpoint. Both
kept checkpoints share the segments; one that neither needs is deleted.
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from auvbench.agents.base import Ring
from auvbench.runs.atomic_io import fsync_directory, make_folder, sha256, sha256_of_prefix, write_atomic
from auvbench.untrusted import archives, reading
from auvbench.untrusted.typed_json import Count

FIELDS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
SEGMENT_TRANSITIONS = 16_384  # about 2 MB for the waypoint task


@dataclass(frozen=True, slots=True)
class Segment:
    """One file of rows, as a checkpoint's manifest has it."""

    first: Count
    last: Count
    """one past the last row"""
    bytes: Count
    sha256: str

    @property
    def name(self) -> str:
        return f"{self.first:010d}-{self.last:010d}.npz"

    def holds(self, folder: Path) -> bool:
        """Whether the file exists with the recorded size and hash."""
        path = folder / self.name
        return (
            path.is_file()
            and path.stat().st_size == self.bytes
            and sha256_of_prefix(path, self.bytes) == self.sha256
        )


class ReplayStore:
    """Write and read the segments in one folder.

    Args:
        folder: `checkpoints/replay` of a run.
        transitions: length of a whole segment in transitions (rows x environments).
    """

    def __init__(self, folder: Path, transitions: int = SEGMENT_TRANSITIONS) -> None:
        self.folder = folder
        self._transitions = transitions
        self._written: dict[tuple[int, int], Segment] = {}

    def save(self, buffer: Ring, rows: int) -> list[Segment]:
        """Write what is new up to row `rows`; return all segments of the ring's content.

        Raises:
            OSError: the disk is full or read-only; earlier segments are untouched.
        """
        make_folder(self.folder)
        oldest = max(0, rows - buffer.buffer_size)
        length = max(1, self._transitions // buffer.n_envs)
        segments = []
        for start in range(oldest // length * length, rows, length):
            stop = min(start + length, rows)
            known = self._written.get((start, stop))
            segments.append(known or self._write(buffer, start, stop, rows))
        fsync_directory(self.folder)
        return segments

    def _write(self, buffer: Ring, start: int, stop: int, rows: int) -> Segment:
        # A segment whose head the ring has overwritten and that was never written whole (the cadence was
        # longer than the ring) begins at the oldest row that is still there.
        first = max(start, rows - buffer.buffer_size)
        at = np.arange(first, stop) % buffer.buffer_size
        stream = io.BytesIO()
        np.savez(stream, **{field: getattr(buffer, field)[at] for field in FIELDS})
        data = stream.getvalue()
        segment = Segment(first, stop, len(data), sha256(data))
        write_atomic(self.folder / segment.name, data, sync_folder=False)
        self._written[start, stop] = segment
        return segment

    def load(self, buffer: Ring, segments: Iterable[Segment], rows: int) -> None:
        """Fill a fresh buffer with the ring's content at row `rows`, bit by bit.

        Raises:
            OSError, ValueError, KeyError: a segment is not readable; `Segment.holds` tells this before.
        """
        oldest = max(0, rows - buffer.buffer_size)
        length = max(1, self._transitions // buffer.n_envs)
        for segment in segments:
            arrays = archives.arrays(reading.content(self.folder / segment.name, reading.WEIGHTS))
            skip = max(0, oldest - segment.first)
            at = np.arange(segment.first + skip, segment.last) % buffer.buffer_size
            for field in FIELDS:
                getattr(buffer, field)[at] = arrays[field][skip:]
            self._written[segment.first // length * length, segment.last] = segment
        buffer.pos = rows % buffer.buffer_size
        buffer.full = rows >= buffer.buffer_size
