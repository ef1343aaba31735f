"""`train/episodes.csv`: one row per training episode, in the order in which they end."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path

from auvbench.record import RECORD_COLUMNS, Record

COLUMNS = ("step", *RECORD_COLUMNS)


class EpisodeLog:
    """Appends rows; full precision; complete rows only.

    Args:
        path: of the CSV file; begun anew with its header unless `keep` says how many bytes of it stay.
        keep: length in bytes to which an existing file is cut (exact resume).
    """

    def __init__(self, path: Path, keep: int | None = None) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "ab" if keep is not None else "wb")  # noqa: SIM115
        if keep is None:
            self._write([COLUMNS])
        else:
            self._file.truncate(keep)
            self._file.seek(0, os.SEEK_END)

    def append(self, step: int, records: Sequence[Record]) -> None:
        """Rows of the episodes that ended at environment step `step` of the run."""
        self._write([(step, *(record[name] for name in RECORD_COLUMNS)) for record in records])

    def _write(self, rows: Sequence[Sequence[object]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        self._file.write(text.getvalue().encode())

    def flush(self, *, sync: bool = False) -> int:
        """Hands all rows to the system (and to the disk); returns the file's length in bytes."""
        self._file.flush()
        if sync:
            os.fsync(self._file.fileno())
        return self._file.tell()

    def abandon(self) -> None:
        """Closes without writing what is still held back."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._file.fileno())
        os.close(nowhere)

    def close(self) -> None:
        self._file.close()
