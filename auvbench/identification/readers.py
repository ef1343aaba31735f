"""Read logs by the kind of file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from auvbench.identification import records
from auvbench.identification.log import Log, LogError, Motors
from auvbench.vehicles.vehicle_model import VehicleModel


def _csv(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import csv_log

    return [csv_log.read(path, frame)]


def _dataflash(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import dataflash

    return dataflash.read(path)


def _telemetry(path: Path, frame: str) -> list[Log]:
    from auvbench.identification import tlog

    return tlog.read(path)


def _bag(path: Path) -> list[Log]:
    from auvbench.identification import bags

    return bags.read(path)


READERS: dict[str, Callable[[Path, str], list[Log]]] = {
    ".csv": _csv,
    ".bin": _dataflash,
    ".tlog": _telemetry,
}
"""Readers by the ending of a file: path and axes to logs."""
AUTOPILOT = (".bin", ".tlog")
"""Endings of files whose inputs are the outputs of an autopilot."""
SAID = ".csv, .BIN and .tlog (ArduSub), folders of ROS 2 bags, and auvbench's own records (.npz, or a folder of missions)"


def read(
    paths: Sequence[str], frame: str = "enu", motors: Callable[[VehicleModel], Motors] | None = None
) -> list[Log]:
    """Return the logs of files and folders.

    Args:
        paths: files or folders.
        frame: axes of tables, "enu" or "ned"; other formats know theirs.
        motors: thrusters of a vehicle that an autopilot drives, for logs of autopilots.

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
        elif (path / "metadata.yaml").is_file():
            logs += _bag(path)
        elif reader := READERS.get(path.suffix.lower()):
            own = reader(path, frame)
            logs += [replace(log, motors=motors) for log in own] if path.suffix.lower() in AUTOPILOT else own
        else:
            raise LogError(f"{text}: not a log that auvbench reads; valid: {SAID}")
    return logs
