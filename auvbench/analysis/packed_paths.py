"""Paths of a test as a study ships them: the very same numbers in less than half of the room.

A vehicle moves little in a step, so that consecutive numbers share their leading bits. Of each condition a shipped
trajectories.npz has

    episodes_<condition>   (E,) int64
    points_<condition>     (E,) int64: positions of each
    waypoints_<condition>  (E, 3) as they were, m
    planes_<condition>     (B, sum of the points, 4) uint8: x, y, z in m and the time in s, each number of B bytes taken as
                           an integer, less the one before it in its column, the least significant bytes first
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Packed = tuple[int, NDArray[Any], NDArray[Any], NDArray[Any]]
"""episode, waypoint (3,) m, positions (T + 1, 3) m, times (T + 1,) s"""

_INTEGERS: dict[int, np.dtype[Any]] = {4: np.dtype("<u4"), 8: np.dtype("<u8")}
_FLOATS: dict[int, np.dtype[Any]] = {4: np.dtype("<f4"), 8: np.dtype("<f8")}
_PLANES = "planes_"


def holds(names: Iterator[str] | list[str]) -> bool:
    """Whether arrays of these names are packed paths."""
    return any(name.startswith(_PLANES) for name in names)


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
    kept: dict[str, NDArray[Any]] = {}
    for condition, numbers in episodes.items():
        tables = []
        for episode in sorted(numbers):
            position, time = (arrays[f"{kind}_{condition}_{episode}"] for kind in ("position", "time"))
            if position.ndim != 2 or position.shape[1] != 3 or time.shape != position.shape[:1]:
                raise ValueError(f"position_{condition}_{episode} and its times are no path")
            if position.dtype.kind != "f" or position.dtype != time.dtype:
                raise ValueError(f"position_{condition}_{episode} and its times are not of one type")
            tables.append(np.column_stack([position, time]))
        kept[f"episodes_{condition}"] = np.array(sorted(numbers), dtype=np.int64)
        kept[f"points_{condition}"] = np.array([len(table) for table in tables], dtype=np.int64)
        kept[f"waypoints_{condition}"] = np.array(
            [arrays[f"waypoint_{condition}_{e}"] for e in sorted(numbers)]
        )
        kept[f"{_PLANES}{condition}"] = _planes(np.concatenate(tables))
    stream = io.BytesIO()
    np.savez_compressed(stream, **kept)  # type: ignore[arg-type]
    return stream.getvalue()


def _planes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """(B, n, 4) bytes of the differences along the first axis."""
    size = values.dtype.itemsize
    if size not in _FLOATS:
        raise ValueError(f"paths of {values.dtype} are not known")
    integers = np.ascontiguousarray(values, dtype=_FLOATS[size]).view(_INTEGERS[size])
    steps = np.diff(integers, axis=0, prepend=np.zeros((1, integers.shape[1]), dtype=_INTEGERS[size]))
    bytes_ = np.ascontiguousarray(steps).view(np.uint8).reshape(*steps.shape, size)
    return np.ascontiguousarray(np.moveaxis(bytes_, -1, 0))


def _values(planes: NDArray[Any]) -> NDArray[Any]:
    """What `_planes` was given."""
    size = planes.shape[0]
    steps = np.ascontiguousarray(np.moveaxis(planes, 0, -1)).view(_INTEGERS[size])[..., 0]
    return np.cumsum(steps, axis=0, dtype=_INTEGERS[size]).view(_FLOATS[size])


def unpack(arrays: Mapping[str, NDArray[Any]], condition: str) -> Iterator[Packed]:
    """The paths of one condition, in the order of the episodes.

    Raises:
        ValueError: they are not what `pack` makes.
    """
    if f"{_PLANES}{condition}" not in arrays:
        return
    episodes, points, waypoints, planes = (
        np.asarray(arrays[f"{kind}_{condition}"]) for kind in ("episodes", "points", "waypoints", "planes")
    )
    n = len(episodes) if episodes.ndim == 1 and episodes.dtype.kind == "i" else -1
    sound = (
        points.shape == (n,) and points.dtype.kind == "i" and (points > 0).all() and waypoints.shape == (n, 3)
    )
    if planes.dtype != np.uint8 or planes.ndim != 3 or planes.shape[0] not in _FLOATS or planes.shape[2] != 4:
        raise ValueError(f"planes_{condition} holds no paths")
    if not sound or int(points.sum()) != planes.shape[1]:
        raise ValueError(f"planes_{condition} is not of the episodes that are named")
    values = _values(planes)
    ends = np.cumsum(points)
    for episode, waypoint, end, count in zip(episodes, waypoints, ends, points, strict=True):
        table = values[end - count : end]
        yield int(episode), waypoint, table[:, :3], table[:, 3]
