"""The journal of a study: Optuna's operations, one line of JSON each, with a digest over all lines so far.

The digest is chained, so that an edited, removed or moved line is found wherever it is. Scores stay in the journal
and are not read again from the runs: a user may remove the runs of pruned trials. Optuna ignores the digest and
reads the file as its own.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from optuna.storages.journal import BaseJournalBackend

from auvbench.errors import RunError
from auvbench.runs import lock
from auvbench.runs.atomic_io import storage
from auvbench.untrusted import documents, path_safety, reading

CONTROLLER = "controller"
"""folder next to the journal; the study's controller holds its lock"""

LARGEST = 1 << 28
"""bytes of the longest journal that is read"""

DIGEST = "digest"


class Journal(BaseJournalBackend):
    """A journal file with one writer, the holder of the study's lock.

    A writer cuts off a last line that a kill left incomplete. With `write=False`, operations stay in memory.

    Raises:
        RunError: A line is damaged, or the file cannot be read.
    """

    def __init__(self, path: Path, *, write: bool = True) -> None:
        self.path, self.write = path, write
        self.logs: list[dict[str, Any]] = []
        self._last = ""
        data = self._read()
        lines = data.split(b"\n")
        incomplete = lines.pop()
        for number, line in enumerate(lines, 1):
            self._take(number, line)
        if incomplete and write:
            with storage(f"cannot write {path}"):
                os.truncate(path, len(data) - len(incomplete))

    def _read(self) -> bytes:
        try:
            return reading.content(path_safety.child(self.path.parent, self.path.name), LARGEST)
        except FileNotFoundError:
            return b""
        except (OSError, ValueError) as error:
            raise RunError(f"{self.path}: cannot be read: {error}") from error

    def _take(self, number: int, line: bytes) -> None:
        try:
            log = documents.json_value(line)
            if not isinstance(log, dict) or log.pop(DIGEST, "") != self._digest(log):
                raise ValueError("its digest does not match it and the lines before it")
        except ValueError as error:
            why = str(error).splitlines()[0]
            raise RunError(
                f"{self.path} line {number} is damaged ({why}): restore the file, or decide the study anew "
                f"(mv {self.path} ELSEWHERE); complete runs are not trained again"
            ) from error
        self.logs.append(log)
        self._last = self._digest(log)

    def _digest(self, log: dict[str, Any]) -> str:
        text = json.dumps([self._last, log], separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def read_logs(self, log_number_from: int) -> list[dict[str, Any]]:
        """Return the operations from a number on."""
        return self.logs[log_number_from:]

    def append_logs(self, logs: list[dict[str, Any]]) -> None:
        """Add operations; they are on the disk when this returns.

        Raises:
            LockLostError: Another process holds the study.
            TrainingError: The disk is full or failing.
        """
        data = b""
        for log in logs:
            plain = json.loads(json.dumps(log))
            self._last = self._digest(plain)
            self.logs.append(plain)
            data += json.dumps({**plain, DIGEST: self._last}, separators=(",", ":")).encode() + b"\n"
        if not self.write:
            return
        lock.verify(self.path.parent / CONTROLLER)
        with storage(f"cannot write {self.path}"):
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
            with open(os.open(self.path, flags, 0o666), "wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
