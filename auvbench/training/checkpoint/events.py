"""TensorBoard scalars in one file that a resumed run goes on writing.

SB3's own writer begins a new file in each process and writes from a thread, so after a crash there are events
of steps that the resumed run will write again. This one appends to a single file in the calling thread: a
checkpoint records its length, and a resume cuts it there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

NAME = "events.out.tfevents.auvbench"


class EventWriter:
    """Appends scalars to `folder/events.out.tfevents.auvbench`.

    Args:
        folder: where TensorBoard looks.

    Raises:
        OSError: the file cannot be opened.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        folder.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("ab")
        self._records = RecordWriter(self._file)
        if self._file.tell() == 0:
            self._add(Event(wall_time=time.time(), file_version="brain.Event:2"))
            self._file.flush()

    def write(self, scalars: Mapping[str, float], step: int) -> None:
        """Appends scalars by name, in the order of their names."""
        for key, value in sorted(scalars.items()):
            summary = Summary(value=[Summary.Value(tag=key, simple_value=float(value))])
            self._add(Event(wall_time=time.time(), step=step, summary=summary))
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def _add(self, event: Event) -> None:
        self._records.write(event.SerializeToString())
