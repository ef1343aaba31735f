"""Read logs, each with the reader for its format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from auvbench import integrations
from auvbench.identification import csv_log, records
from auvbench.identification.columns import READABLE
from auvbench.identification.log import Log, LogError
from auvbench.registry import resolve

Reader = Callable[[Path, Sequence[str] | None], list[Log]]


def read(paths: Sequence[str], frame: str = "enu", motors: Sequence[str] | None = None) -> list[Log]:
    """Return the logs of files and folders.

    Args:
        paths: files or folders.
        frame: axes of .csv files, "enu" or "ned"; other formats define their own axes.
        motors: thruster names in the order of an autopilot's motors, with `-` before a reversed thruster; None: the order is found
            from the thrusters' directions.

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
        elif path.suffix.lower() == ".csv":
            logs.append(csv_log.read(path, frame))
        elif reader := _foreign(path):
            logs += reader(path, motors)
        else:
            raise LogError(
                f"{text}: not a log that auvbench reads; valid: {READABLE} and auvbench's own records (.npz, or a folder of missions)"
            )
    if motors is not None and (named := [log.name for log in logs if log.motors is None]):
        raise LogError(f"motors={','.join(motors)}: {named[0]} names its thrusters; leave motors= out")
    return logs


def _foreign(path: Path) -> Reader | None:
    """Return the reader of an integration for a log of another system; None if no integration reads it."""
    for mark, (_, code) in integrations.LOGS.items():
        if (path / mark).is_file() or path.suffix.lower() == mark:
            reader: Reader = resolve(code)
            return reader
    return None
