"""Reads the trajectories of a test, checked, for the figure and for the 3-D view of the page."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
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

FloatArray = NDArray[np.float64]

UNREADABLE = (*archives.FAULTS, TypeError)

Path3 = tuple[int, tuple[float, float, float], FloatArray, FloatArray]
"""episode, waypoint m, positions (T+1, 3) m, times (T+1,) s"""


def has_paths(evaluation: Evaluation | None) -> bool:
    """Return whether trajectories of a test are stored."""
    if evaluation is None:
        return False
    if evaluation.archive is not None:
        return evaluation.archive.has_paths
    return (evaluation.directory / NAME).is_file()


def paths(run: str, evaluation: Evaluation, condition: str, episodes: int) -> Iterator[Path3]:
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
        yield episode, (x, y, z), position, time


def _of_file(file: Path, condition: str, episodes: int) -> Iterator[Path3]:
    try:
        data = reading.content(file, reading.DATA)
        found: list[Path3] = []
        with archives.opened(data) as arrays:
            for episode, *path in _raw(arrays, condition, episodes):
                # Before they are widened to float64: a byte would take eight.
                if any(array.dtype.kind != "f" for array in path):
                    raise ValueError(f"episode {episode} holds no floating-point numbers")
                waypoint, position, time = (array.astype(np.float64) for array in path)
                suffix = f"{condition}_{episode}"
                if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
                    raise ValueError(f"position_{suffix} has shape {position.shape}, expected (steps + 1, 3)")
                if time.shape != (len(position),):
                    raise ValueError(f"time_{suffix} has shape {time.shape}, expected ({len(position)},)")
                if waypoint.shape != (3,):
                    raise ValueError(f"waypoint_{suffix} has shape {waypoint.shape}, expected (3,)")
                if not all(finite(values) for values in (position, time, waypoint)):
                    raise ValueError(f"episode {episode} holds numbers that are not finite")
                x, y, z = waypoint.tolist()
                found.append((episode, (x, y, z), position, time))
    except UNREADABLE as error:
        raise Damage(f"trajectories.npz cannot be read: {short(error)}") from error
    # Last, for what can be said of the damage says more.
    if wrong := consistency.of_neighbour(file, data):
        raise Damage(wrong)
    yield from found


def _raw(arrays: Any, condition: str, episodes: int) -> Iterator[tuple[int, Any, Any, Any]]:
    """Yield episode, waypoint, positions and times as they stand in the file."""
    name = re.compile(rf"position_{re.escape(condition)}_(\d+)")
    numbers = sorted(int(match[1]) for key in arrays.files if (match := name.fullmatch(key)))
    for episode in numbers[:episodes]:
        suffix = f"{condition}_{episode}"
        yield episode, arrays[f"waypoint_{suffix}"], arrays[f"position_{suffix}"], arrays[f"time_{suffix}"]
