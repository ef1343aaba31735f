"""Read auvbench's own records: trajectories of a test, and missions of a pilot."""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path

import numpy as np

from auvbench.identification.log import CHANNELS, Log, LogError, checked
from auvbench.untrusted import archives, reading
from auvbench.untrusted.text import short

TRAJECTORIES = "trajectories.npz"
MOST = 50
"""Largest number of episodes that are read from a file."""


def is_record(path: Path) -> bool:
    """Return whether a path is a folder of missions, or a file with trajectories of a test or of missions."""
    return path.suffix == ".npz" or (path / TRAJECTORIES).is_file()


def read(path: Path) -> list[Log]:
    """Return a log for each sufficiently long episode of a file or folder.

    Raises:
        LogError: the file cannot be read, or has no episode that can be used.
    """
    file = path / TRAJECTORIES if path.is_dir() else path
    try:
        data = reading.content(file, reading.DATA)
        episodes = _episodes(archives.names(data))
        arrays = {
            (condition, number): archives.paths(data, condition, [number])
            for condition, number in episodes[:MOST]
        }
        actuators = _actuators(file.parent)
    except OSError as error:
        raise LogError(f"{file}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise LogError(f"{file}: not trajectories of auvbench: {short(error)}") from None
    if not episodes:
        raise LogError(f"{file}: has no trajectory; run auvbench evaluate, or auvbench pilot --record FOLDER")
    digest = sha256(data).hexdigest()
    logs, fault = [], None
    for (condition, number), stored in arrays.items():
        try:
            logs.append(
                _log(f"{file} {condition} {number}", digest, stored, f"{condition}_{number}", actuators)
            )
        except LogError as error:  # An episode may be too short; all usable episodes are read.
            fault = fault or error
    if not logs:
        raise fault or LogError(f"{file}: has no episode that can be used")
    return logs


def _episodes(names: list[str]) -> list[tuple[str, int]]:
    """Return condition and number of each episode that has a time array, given the names of all arrays in an archive."""
    matches = (re.fullmatch(r"time_(.+)_(\d{1,9})(?:\.npy)?", name) for name in names)
    return sorted((match[1], int(match[2])) for match in matches if match)


def _actuators(folder: Path) -> tuple[str, ...]:
    """Return the names of a mission's actuators; () for a test, whose commands are in the order of the sheet."""
    about = folder / "mission.json"
    if not about.is_file():
        return ()
    content = reading.json_value(reading.content(about))
    listed = content.get("actuators") if isinstance(content, dict) else None
    if not isinstance(listed, list):
        raise ValueError("mission.json names no actuators")
    return tuple(str(name) for name in listed)


def _log(name: str, digest: str, stored: dict[str, np.ndarray], key: str, actuators: tuple[str, ...]) -> Log:
    missing = [part for part in ("time", "position", "yaw", "command") if f"{part}_{key}" not in stored]
    if missing:
        raise LogError(f"{name}: has no {missing[0]}")
    time, position, yaw, command = (
        np.asarray(stored[f"{part}_{key}"], dtype=np.float64)
        for part in ("time", "position", "yaw", "command")
    )
    rows = time.size
    if (
        position.shape != (rows, 3)
        or yaw.shape != (rows,)
        or command.shape[:1] != (rows - 1,)
        or command.ndim != 2
    ):
        raise LogError(f"{name}: its arrays have different lengths")
    measured = np.full((rows, len(CHANNELS)), np.nan)
    measured[:, :3] = position
    measured[:, 5] = np.unwrap(yaw)
    names = actuators or tuple(f"thruster{number}" for number in range(1, command.shape[1] + 1))
    if len(names) != command.shape[1]:
        raise LogError(f"{name}: has commands of {command.shape[1]} actuators, but names of {len(names)}")
    # The last row is the time at which the last command ends; `Log` needs inputs in this row too.
    inputs = np.vstack([command, command[-1:]])
    return checked(
        Log(
            name=name,
            digest=digest,
            time=time,
            kind="force",
            actuators=names,
            inputs=inputs,
            measured=measured,
        )
    )
