"""Reads the trajectories of a test, checked, for the figure and for the 3-D view of the page."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis import consistency
from auvbench.analysis.evaluations import Damage, finite
from auvbench.analysis.records import Evaluation
from auvbench.untrusted import archives, reading
from auvbench.untrusted.text import short

NAME = "trajectories.npz"
REQUIRED = ("waypoint", "position", "time")
OPTIONAL = ("reference", "dock_yaw")

FloatArray = NDArray[np.float64]

UNREADABLE = (*archives.FAULTS, TypeError)


@dataclass(frozen=True, slots=True, eq=False)
class StoredPath:
    """The path of a vehicle through one test episode."""

    episode: int
    waypoint: tuple[float, float, float]  # m; the goal of a task with another
    position: FloatArray  # (T + 1, 3) m
    time: FloatArray  # (T + 1,) s
    reference: FloatArray | None = None  # (T + 1, 3) m, where it moves; a published study has none
    dock_yaw: float | None = None  # rad; likewise


def has_paths(evaluation: Evaluation | None) -> bool:
    """Return whether trajectories of a test are stored."""
    if evaluation is None:
        return False
    if evaluation.archive is not None:
        return evaluation.archive.has_paths
    return (evaluation.directory / NAME).is_file()


def paths(run: str, evaluation: Evaluation, condition: str, episodes: int) -> Iterator[StoredPath]:
    """Yield the stored trajectories of one condition, at most `episodes` of them.

    Raises:
        Damage: The file cannot be read, or holds no trajectories; a pickle is never loaded.
    """
    if evaluation.archive is None:
        yield from _of_file(evaluation.directory / NAME, condition, episodes)
        return
    rows = evaluation.episodes
    rows = rows[rows["condition"] == condition].set_index("episode")
    named = "waypoint" if "waypoint_x_m" in rows.columns else "goal"
    waypoints = rows[[f"{named}_{axis}_m" for axis in "xyz"]].to_numpy(dtype=np.float64)
    where = {int(episode): i for i, episode in enumerate(rows.index)}
    found = evaluation.archive.paths(run, evaluation.protocol, condition)
    for episode, position, time in itertools.islice(found, episodes):
        if episode not in where:
            raise Damage(f"trajectories of episode {episode}, which was not tested")
        x, y, z = waypoints[where[episode]].tolist()
        yield StoredPath(episode, (x, y, z), position, time)


def _of_file(file: Path, condition: str, episodes: int) -> Iterator[StoredPath]:
    try:
        data = reading.content(file, reading.DATA)
        with archives.opened(data) as arrays:
            found = [
                _checked(episode, f"{condition}_{episode}", path)
                for episode, path in _raw(arrays, condition, episodes)
            ]
    except UNREADABLE as error:
        raise Damage(f"trajectories.npz cannot be read: {short(error)}") from error
    # Last, for what can be said of the damage says more.
    if wrong := consistency.of_neighbour(file, data):
        raise Damage(wrong)
    yield from found


def _checked(episode: int, suffix: str, raw: dict[str, Any]) -> StoredPath:
    """Return the arrays of one episode.

    Raises:
        ValueError: one has another type or shape, or is not finite.
    """
    # Before they are widened to float64: a byte would take eight.
    if any(array.dtype.kind != "f" for array in raw.values()):
        raise ValueError(f"episode {episode} holds no floating-point numbers")
    path = {name: array.astype(np.float64) for name, array in raw.items()}
    position = path["position"]
    if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
        raise ValueError(f"position_{suffix} has shape {position.shape}, expected (steps + 1, 3)")
    shapes = {"time": (len(position),), "waypoint": (3,), "reference": position.shape, "dock_yaw": (1,)}
    for name, array in path.items():
        if array.shape != shapes.get(name, array.shape):
            raise ValueError(f"{name}_{suffix} has shape {array.shape}, expected {shapes[name]}")
    if not all(finite(values) for values in path.values()):
        raise ValueError(f"episode {episode} holds numbers that are not finite")
    x, y, z = path["waypoint"].tolist()
    yaw = float(path["dock_yaw"][0]) if "dock_yaw" in path else None
    return StoredPath(episode, (x, y, z), position, path["time"], path.get("reference"), yaw)


def _raw(arrays: Any, condition: str, episodes: int) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield episodes and their arrays as they stand in the file."""
    name = re.compile(rf"position_{re.escape(condition)}_(\d+)")
    numbers = sorted(int(match[1]) for key in arrays.files if (match := name.fullmatch(key)))
    for episode in numbers[:episodes]:
        names = {name: f"{name}_{condition}_{episode}" for name in (*REQUIRED, *OPTIONAL)}
        yield episode, {n: arrays[key] for n, key in names.items() if n in REQUIRED or key in arrays.files}
