"""The journal of a study: Optuna's operations, one line of JSON each, with a digest over all lines so far.

The digest is chained, so that an edited, removed or moved line is always found. Scores stay in the journal
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

    Raises:
        RunError: A line is damaged, or the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.logs: list[dict[str, Any]] = []
        self._last, self._size = "", 0
        try:
            data = reading.content(path_safety.child(path.parent, path.name), LARGEST)
        except FileNotFoundError:
            return
        except (OSError, ValueError) as error:
            raise RunError(f"{path}: cannot be read: {error}") from error
        for line in data.split(b"\n")[
            :-1
        ]:  # what follows the last line break is a line that a kill cut short
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            log = documents.json_value(line)
            if not isinstance(log, dict) or log.pop(DIGEST, "") != self._digest(log):
                raise ValueError("its digest does not match it and the lines before it")
        except ValueError as error:
            why = str(error).splitlines()[0]
            raise RunError(
                f"{self.path} line {len(self.logs) + 1} is damaged ({why}): restore the file, or decide the study anew "
                f"(mv {self.path} ELSEWHERE); complete runs are not trained again"
            ) from error
        self._last = self._digest(log)
        self._size += len(line) + 1
        self.logs.append(log)

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
        lock.verify(self.path.parent / CONTROLLER)
        with storage(f"cannot write {self.path}"):
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            with open(descriptor, "r+b") as file:
                file.truncate(self._size)
                file.seek(self._size)
                for log in logs:
                    plain = json.loads(json.dumps(log))
                    line = json.dumps({**plain, DIGEST: self._digest(plain)}, separators=(",", ":")).encode()
                    file.write(line + b"\n")
                    self._take(line)
                file.flush()
                os.fsync(file.fileno())
