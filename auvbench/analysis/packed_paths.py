"""Paths of a test as a study ships them: to a millimetre, in a tenth of the room.

A vehicle has inertia: from step to step its velocity changes little, so that the second differences of its positions are
small numbers. A shipped trajectories.npz has

    units                  (4,) of x, y, z and the time: 1 mm, 1 mm, 1 mm, 1 us, in m and s

and of each condition

    episodes_<condition>   (E,) int64
    points_<condition>     (E,) int64: positions of each
    waypoints_<condition>  (E, 3) as they were, m
    changes_<condition>    (B, sum of the points, 4) uint8: x, y, z and the time in these units as whole numbers,
                           their second differences along the points, signs folded in (0, -1, 1, -2, ... as 0, 1, 2, 3, ...),
                           in B bytes each, the least significant first
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Packed = tuple[int, NDArray[Any], NDArray[Any], NDArray[Any]]
"""episode, waypoint (3,) m, positions (T + 1, 3) m, times (T + 1,) s"""

UNITS = np.array([1e-3, 1e-3, 1e-3, 1e-6])
"""m, m, m, s: of what is packed; a file is read in the units that it names"""
LARGEST = 1e9
"""m and s: more is no path of a vehicle, and counts of `UNITS` and their differences stay whole numbers of 64 bits"""
POINTS = 2_000_000
"""positions of one condition; 1000 episodes of 2000 steps. A packed one takes four bytes, and unpacked 160 at a time"""
_CHANGES = "changes_"


def holds(names: Iterator[str] | list[str]) -> bool:
    """Whether arrays of these names are packed paths."""
    return any(name.startswith(_CHANGES) for name in names)


def pack(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """An .npz file of the positions, times and waypoints among the arrays of an evaluation's trajectories.npz.

    Raises:
        ValueError: they are no paths.
    """
    episodes: dict[str, list[int]] = {}
    for name in arrays:
        if name.startswith("position_"):
            condition, _, number = name.removeprefix("position_").rpartition("_")
            episodes.setdefault(condition, []).append(int(number))
    kept: dict[str, NDArray[Any]] = {"units": UNITS}
    for condition, numbers in episodes.items():
        tables = []
        for episode in sorted(numbers):
            position, time = (arrays[f"{kind}_{condition}_{episode}"] for kind in ("position", "time"))
            if position.ndim != 2 or position.shape[1] != 3 or time.shape != position.shape[:1]:
                raise ValueError(f"position_{condition}_{episode} and its times are no path")
            table = np.column_stack([position, time]).astype(np.float64)
            if not (np.abs(table) < LARGEST).all():  # nor where it is not a number
                raise ValueError(f"position_{condition}_{episode} and its times are not finite")
            tables.append(table)
        kept[f"episodes_{condition}"] = np.array(sorted(numbers), dtype=np.int64)
        kept[f"points_{condition}"] = np.array([len(table) for table in tables], dtype=np.int64)
        kept[f"waypoints_{condition}"] = np.array(
            [arrays[f"waypoint_{condition}_{e}"] for e in sorted(numbers)]
        )
        kept[f"{_CHANGES}{condition}"] = _changes(np.concatenate(tables))
    stream = io.BytesIO()
    np.savez_compressed(stream, **kept)  # type: ignore[arg-type]
    return stream.getvalue()


def _changes(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(B, n, 4) bytes of the second differences of (n, 4) m, m, m, s along the first axis."""
    counts = np.rint(values / UNITS).astype(np.int64)
    second = np.diff(counts, n=2, axis=0, prepend=np.zeros((2, 4), dtype=np.int64))
    folded = ((second << 1) ^ (second >> 63)).astype("<u8")
    size = max(1, -(-int(folded.max(initial=0)).bit_length() // 8))
    bytes_ = np.ascontiguousarray(folded).view(np.uint8).reshape(*folded.shape, 8)
    return np.ascontiguousarray(np.moveaxis(bytes_[..., :size], -1, 0))


def _values(changes: NDArray[np.uint8], units: NDArray[np.float64]) -> NDArray[np.float64]:
    """What `_changes` was given, to half a unit."""
    bytes_ = np.zeros((*changes.shape[1:], 8), dtype=np.uint8)
    bytes_[..., : len(changes)] = np.moveaxis(changes, 0, -1)
    folded = bytes_.view("<u8")[..., 0]
    second = (folded >> np.uint64(1)).astype(np.int64) ^ -(folded & np.uint64(1)).astype(np.int64)
    counts = np.cumsum(np.cumsum(second, axis=0), axis=0)
    return np.asarray(counts * units)


def unpack(arrays: Mapping[str, NDArray[Any]], condition: str) -> Iterator[Packed]:
    """The paths of one condition, in the order of the episodes.

    Raises:
        ValueError: they are not what `pack` makes.
    """
    if f"{_CHANGES}{condition}" not in arrays:
        return
    episodes, points, waypoints, changes = (
        np.asarray(arrays[f"{kind}_{condition}"]) for kind in ("episodes", "points", "waypoints", "changes")
    )
    units = np.asarray(arrays["units"])
    if units.shape != (4,) or units.dtype != np.float64 or not ((units > 0) & (units < LARGEST)).all():
        raise ValueError("units are not those of x, y, z and time")
    n = len(episodes) if episodes.ndim == 1 and episodes.dtype.kind == "i" else -1
    sound = (
        points.shape == (n,) and points.dtype.kind == "i" and (points > 0).all() and waypoints.shape == (n, 3)
    )
    if (
        changes.dtype != np.uint8
        or changes.ndim != 3
        or not 1 <= changes.shape[0] <= 8
        or changes.shape[2] != 4
    ):
        raise ValueError(f"changes_{condition} holds no paths")
    if changes.shape[1] > POINTS:
        raise ValueError(
            f"changes_{condition} holds {changes.shape[1]:,} positions; at most {POINTS:,} are read"
        )
    if not sound or int(points.sum()) != changes.shape[1]:
        raise ValueError(f"changes_{condition} is not of the episodes that are named")
    values = _values(changes, units)
    ends = np.cumsum(points)
    for episode, waypoint, end, count in zip(episodes, waypoints, ends, points, strict=True):
        table = values[end - count : end]
        yield int(episode), waypoint, table[:, :3], table[:, 3]
