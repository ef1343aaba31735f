"""Save and restore a run in training."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Learner, Ring, replay
from auvbench.errors import TrainingError
from auvbench.runs import lock
from auvbench.runs.atomic_io import (
    fsync,
    make_folder,
    sha256,
    storage,
    write_atomic,
)
from auvbench.training.checkpoint.logs import GrowingLog, LogMark, cut
from auvbench.training.checkpoint.store import Checkpoint, CheckpointStore, Segment
from auvbench.untrusted import archives, reading

FIELDS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
SEGMENT_TRANSITIONS = 16_384  # about 2 MB for the waypoint task


class ReplayStore:
    """Writes and reads the replay segments in one folder.

    Args:
        folder: `checkpoints/replay` of a run.
        transitions: length of a full segment in transitions (rows x environments).
    """

    def __init__(self, folder: Path, transitions: int = SEGMENT_TRANSITIONS) -> None:
        self.folder = folder
        self._transitions = transitions
        self._written: dict[tuple[int, int], Segment] = {}

    def save(self, buffer: Ring, rows: int) -> list[Segment]:
        """Write the segments before row `rows` that are not on disk yet; return all segments that cover the buffer's content.

        Raises:
            OSError: the disk is full or read-only; earlier segments do not change.
        """
        make_folder(self.folder)
        oldest = max(0, rows - buffer.buffer_size)
        length = max(1, self._transitions // buffer.n_envs)
        segments = []
        for start in range(oldest // length * length, rows, length):
            stop = min(start + length, rows)
            segment = self._written.get((start, stop))
            segments.append(segment or self._write(buffer, start, stop, rows))
        fsync(self.folder)
        return segments

    def _write(self, buffer: Ring, start: int, stop: int, rows: int) -> Segment:
        # If the last checkpoint is longer ago than the ring's length, the ring has overwritten the first rows of this
        # segment before they were written to disk. The segment then begins at the oldest remaining row.
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
        """Fill a new buffer with exactly the content that the saved buffer had after `rows` rows.

        Raises:
            OSError, ValueError, KeyError: a segment is not readable; check with `Segment.holds` first.
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


CLOCK = "clock"
"""Name of the component with the duration of training."""


class Stateful(Protocol):
    """Object with its own state that belongs to a run in training, for example the environments or a recorder, but not the learner."""

    def state_dict(self) -> Mapping[str, NDArray[Any]]: ...

    def load_state_dict(self, state: Mapping[str, NDArray[Any]], /) -> None: ...


class Checkpointer:
    """Saves a run so that it can continue bit-identically.

    Call the methods in this order:

        checkpointer = Checkpointer(run, logs=[...])
        checkpointer.prepare()              # before anything opens the logs
        ... build environments, learner, writers of the logs ...
        checkpointer.parts = {"environment": batch}
        checkpointer.restore(learner)       # when the learner is about to begin
        checkpointer.save(learner, steps)   # when the learner's state is complete

    Args:
        run: directory of the run.
        every_steps: environment steps between checkpoints, 0 for none.
        every_seconds: wall time in s between checkpoints, 0 for none.
        keep: number of complete checkpoints to keep.
        logs: growing files, relative to `run`; truncated on resume.

    Attributes:
        parts: other objects with state, by name.
        flush: function that flushes the buffers of the logs' writers; called before the logs are measured.
        saved_hook: function called after each checkpoint.
        resumed: checkpoint from which the run continues; None for a new run.
        saved: number of checkpoints that this process has written.
        saved_step: environment steps of the newest checkpoint, 0 before the first.
        spent: wall time in s spent on writing checkpoints.
        paused: wall time in s since `restore` that does not count as training.
    """

    def __init__(
        self,
        run: Path,
        every_steps: int = 0,
        every_seconds: float = 0.0,
        keep: int = 2,
        logs: Sequence[str] = (),
    ) -> None:
        self.store = CheckpointStore(run, keep)
        self.parts: Mapping[str, Stateful] = {}
        self.flush: Callable[[], object] = lambda: None
        self.saved_hook: Callable[[], object] = lambda: None
        self.resumed: Checkpoint | None = None
        self.spent = 0.0
        self.paused = 0.0
        self.saved = 0
        self.saved_step = 0
        self._every_steps, self._every_seconds = every_steps, every_seconds
        self._logs = {name: GrowingLog(run / name) for name in logs}
        self._replay = ReplayStore(self.store.replay_folder)
        self._saved_at = 0.0
        self._began, self._earlier = time.monotonic(), 0.0

    def prepare(self) -> Checkpoint | None:
        """Find the newest intact checkpoint, truncate the logs to it, and return it; None for a new run.

        Raises:
            RunError, TrainingError: see `CheckpointStore.latest_valid`.
        """
        self.resumed = self.store.latest_valid()
        marks: Mapping[str, LogMark] = self.resumed.logs if self.resumed else {}
        with storage(f"cannot resume {self.store.run}"):
            for name, log in self._logs.items():
                cut(log.path, marks[name].bytes if name in marks else 0)
        return self.resumed

    def restore(self, learner: Learner) -> int:
        """Restore the parts and the learner from the checkpoint; return the checkpoint's step, or 0 for a new run.

        Raises:
            RunError: the checkpoint belongs to another learner.
        """
        self._saved_at = self._began = time.monotonic()
        if self.resumed is None:
            return 0
        components, step = self.resumed.components, self.resumed.step
        for name, part in self.parts.items():
            part.load_state_dict(components.arrays[f"part-{name}"])
        learner.restore(components)  # Last: this restores generators from which the parts may draw.
        ring = replay(learner)
        if ring is not None:
            self._replay.load(ring, self.resumed.segments, step // ring.n_envs)
        self.saved_step = step
        self._earlier = components.values.get(CLOCK, {}).get("elapsed_ns", 0) / 1e9
        return step

    @property
    def elapsed(self) -> float:
        """Return the wall time of training in s, including the time before a resume and excluding `paused`."""
        return self._earlier + time.monotonic() - self._began - self.paused

    def save(self, learner: Learner, step: int) -> None:
        """Write a checkpoint, unless this step has one.

        Raises:
            TrainingError: the learner cannot be saved, or the disk is full or failing.
        """
        if step == self.saved_step:
            return
        began = time.monotonic()
        lock.verify(self.store.run)
        components = learner.state()
        for name, part in self.parts.items():
            components.arrays[f"part-{name}"] = {
                key: np.asarray(value) for key, value in part.state_dict().items()
            }
        components.values[CLOCK] = {"elapsed_ns": round(self.elapsed * 1e9)}
        ring = replay(learner)
        try:
            with storage(f"cannot write the checkpoint of step {step}"):
                self.flush()
                marks = {name: log.mark() for name, log in self._logs.items()}
                segments = [] if ring is None else self._replay.save(ring, step // ring.n_envs)
            self.store.save(step, components, tuple(segments), marks)
        except TrainingError:
            self.store.prune()  # segments without a checkpoint only fill the disk
            raise
        with storage(f"cannot note the checkpoint of step {step}"):
            self.saved_hook()
        self.saved_step, self._saved_at = step, time.monotonic()
        self.spent += self._saved_at - began
        self.saved += 1

    def is_due(self, step: int) -> bool:
        """Return whether enough steps or time have passed since the last checkpoint."""
        steps = step - self.saved_step
        # Use the monotonic clock, because the wall clock may jump, even backwards.
        return 0 < self._every_steps <= steps or (
            0 < self._every_seconds <= time.monotonic() - self._saved_at and steps > 0
        )
