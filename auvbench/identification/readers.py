"""Read logs by the kind of file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench.identification import records
from auvbench.identification.log import Log, LogError


def _csv(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import csv_log

    return [csv_log.read(path, frame)]


def _dataflash(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import dataflash

    return dataflash.read(path)


def _telemetry(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import tlog

    return tlog.read(path)


READERS: dict[str, Callable[[Path, str], list[Log]]] = {
    ".csv": _csv,
    ".bin": _dataflash,
    ".tlog": _telemetry,
}
"""Readers by the ending of a file: path and axes to logs."""
SAID = ".csv, .BIN and .tlog (ArduSub), and auvbench's own records (.npz, or a folder of missions)"


def read(paths: Sequence[str], frame: str = "enu") -> list[Log]:
    """Return the logs of files and folders.

    Args:
        paths: files or folders.
        frame: axes of tables, "enu" or "ned"; other formats know theirs.

    Raises:
        LogError: a file cannot be read, or a log cannot be used.
    """
    logs: list[Log] = []
    for text in paths:
        path = Path(text)
        if not path.exists():
            raise LogError(f"{text}: does not exist")
        if records.is_record(path):
            logs += records.read(path)
        elif reader := READERS.get(path.suffix.lower()):
            logs += reader(path, frame)
        else:
            raise LogError(f"{text}: not a log that auvbench reads; valid: {SAID}")
    return logs
