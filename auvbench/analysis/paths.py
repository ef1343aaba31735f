"""Reads the trajectories of a test, checked, for the figure and for the 3-D view of the page."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis import agreement
from auvbench.analysis.evaluations import Damage, finite
from auvbench.untrusted import archives, reading
from auvbench.untrusted.text import short

FloatArray = NDArray[np.float64]

UNREADABLE = (*archives.FAULTS, TypeError)

Path3 = tuple[int, tuple[float, float, float], FloatArray, FloatArray]
"""episode, waypoint m, positions (T+1, 3) m, times (T+1,) s"""


def paths(file: Path, condition: str, episodes: int) -> Iterator[Path3]:
    """The first episodes of one condition in a trajectories.npz.

    Raises:
        Damage: the file cannot be read, or holds what is no path; a pickle in it is never loaded.
    """
    name = re.compile(rf"position_{re.escape(condition)}_(\d+)")
    try:
        data = reading.content(file, archives.UNPACKED)
        found: list[Path3] = []
        with archives.opened(data) as arrays:
            numbers = sorted(int(match[1]) for key in arrays.files if (match := name.fullmatch(key)))
            for episode in numbers[:episodes]:
                suffix = f"{condition}_{episode}"
                position = np.asarray(arrays[f"position_{suffix}"], dtype=np.float64)
                time = np.asarray(arrays[f"time_{suffix}"], dtype=np.float64)
                waypoint = np.asarray(arrays[f"waypoint_{suffix}"], dtype=np.float64)
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
    if wrong := agreement.of_neighbour(file, data):
        raise Damage(wrong)
    yield from found
