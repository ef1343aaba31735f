"""Draw solids as line segments for pictures. Only pictures use these outlines: rays and clearances use the exact solids."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.worlds.kinds import BOX, CAPSULE, CYLINDER, PLANE, SPHERE, TERRAIN, Floats, Solids

ROOM = 5.0
"""Smallest margin around an episode in a picture, m"""
Segments = NDArray[np.float64]
"""Ends (k, 2, 3) of k segments, m"""

SIDES = 16
"""number of segments of a circle"""
LINES = 12
"""Number of lines of a plane in each direction; a bottom has at most about twice as many"""


def outlines(solids: Solids, heights: Floats, low: Floats, high: Floats, time: float = 0.0) -> Segments:
    """Return segments (k, 2, 3) in m that draw solids inside a box, and a line from each moving solid's position at time 0 to the solid.

    Args:
        heights: heights of all height fields (see `solids.terrain`), m.
        low: lowest corner (3,) of the box, m.
        high: highest corner (3,) of the box, m.
        time: time at which moving solids are drawn, s.
    """
    now = solids.copy()
    now["position"] += time * solids["velocity"]
    trails = np.stack([solids["position"], now["position"]], axis=1)
    parts = [trails[solids["velocity"].any(axis=1)]]
    for solid in now:
        if solid["kind"] == TERRAIN:
            parts.append(_terrain(solid, heights, low, high))
        else:
            parts.append(_OUTLINES[int(solid["kind"])](solid, low, high))
    return clipped(np.concatenate(parts), low, high)


def round_path(points: Floats) -> tuple[Floats, Floats]:
    """Return the lowest and the highest corner (3,) in m of a picture that shows points (n, 3)."""
    low, high = points.min(0), points.max(0)
    room = max(ROOM, 0.25 * float((high - low).max()))
    return low - room, high + room


def clipped(segments: Segments, low: Floats, high: Floats) -> Segments:
    """Return the parts of segments inside a box (Liang and Barsky 1984, "A new concept and method for line clipping")."""
    start, way = segments[:, 0], segments[:, 1] - segments[:, 0]
    first, last = np.zeros(len(segments)), np.ones(len(segments))
    for axis in range(3):
        moves = way[:, axis] != 0.0
        step = np.where(moves, way[:, axis], 1.0)
        a, b = (low[axis] - start[:, axis]) / step, (high[axis] - start[:, axis]) / step
        within = (start[:, axis] >= low[axis]) & (start[:, axis] <= high[axis])
        first = np.maximum(first, np.where(moves, np.minimum(a, b), np.where(within, 0.0, 2.0)))
        last = np.minimum(last, np.where(moves, np.maximum(a, b), 1.0))
    inside = first < last
    ends = np.stack([first[inside], last[inside]], axis=1)
    return np.asarray(start[inside, None] + ends[:, :, None] * way[inside, None])


def _axes(solid: Any) -> Floats:
    """Return the directions (3, 3) of a solid's own axes as rows."""
    return np.array([solid["along_x"], solid["along_y"], solid["along_z"]])


def _joined(points: Floats) -> Segments:
    """Return the segments (n - 1, 2, 3) between neighbours of n points."""
    return np.stack([points[:-1], points[1:]], axis=1)


def _circle(centre: Floats, u: Floats, v: Floats, turns: float = 1.0) -> Segments:
    """Return the segments of a circle with the perpendicular radius vectors u and v (3,); if `turns` is less than 1, of an arc."""
    angles = np.linspace(0.0, 2.0 * math.pi * turns, round(SIDES * turns) + 1)[:, None]
    return _joined(centre + np.cos(angles) * u + np.sin(angles) * v)


def _sphere(solid: Any, low: Floats, high: Floats) -> Segments:
    centre, axes = solid["position"], float(solid["radius"]) * np.eye(3)
    return np.concatenate([_circle(centre, axes[k], axes[(k + 1) % 3]) for k in range(3)])


def _upright(solid: Any, low: Floats, high: Floats) -> Segments:
    """Return the segments of a capsule or cylinder: circles, and lines parallel to the axis."""
    centre, axes = solid["position"], _axes(solid)
    u, v, half = (
        float(solid["radius"]) * axes[0],
        float(solid["radius"]) * axes[1],
        float(solid["half"][2]) * axes[2],
    )
    ends = [centre - half, centre + half]
    lines = [np.array([[ends[0] + r, ends[1] + r]]) for r in (u, v, -u, -v)]
    # A long solid may have both ends outside the picture, so a third ring is drawn near the picture's middle.
    length = float(solid["half"][2])
    along = float(np.clip((0.5 * (low + high) - centre) @ axes[2], -length, length))
    rings = [_circle(point, u, v) for point in [*ends, centre + along * axes[2]]]
    caps = []
    if solid["kind"] == CAPSULE:
        tip = float(solid["radius"]) * axes[2]
        caps = [
            _circle(end, r, sign * tip, 0.5)
            for end, sign in zip(ends, (-1.0, 1.0), strict=True)
            for r in (u, v)
        ]
    return np.concatenate([*lines, *rings, *caps])


def _box(solid: Any, low: Floats, high: Floats) -> Segments:
    sides = np.array(solid["half"])[:, None] * _axes(solid)
    signs = np.array([[a, b, c] for a in (-1.0, 1.0) for b in (-1.0, 1.0) for c in (-1.0, 1.0)])
    pairs = [(p, q) for i, p in enumerate(signs) for q in signs[i + 1 :] if np.abs(p - q).sum() == 2.0]
    return np.array([[solid["position"] + p @ sides, solid["position"] + q @ sides] for p, q in pairs])


def _plane(solid: Any, low: Floats, high: Floats) -> Segments:
    """Return a grid of lines on a plane, drawn from `low` to `high`."""
    _, _, normal = _axes(solid)
    # The plane's equation gives the coordinate along world axis k, the axis nearest to the normal, from the other two coordinates.
    k = int(np.abs(normal).argmax())
    i, j = (k + 1) % 3, (k + 2) % 3
    lines = []
    for fixed, free in ((i, j), (j, i)):
        for value in np.linspace(low[fixed], high[fixed], LINES):
            ends = np.zeros((2, 3))
            ends[:, fixed], ends[:, free] = value, (low[free], high[free])
            off = (ends - solid["position"]) @ normal - (ends[:, k] - solid["position"][k]) * normal[k]
            ends[:, k] = solid["position"][k] - off / normal[k]
            lines.append(ends)
    return np.array(lines)


def _terrain(solid: Any, heights: Floats, low: Floats, high: Floats) -> Segments:
    """Return lines along the rows and columns of the grid, at most about 2 LINES in each direction."""
    axes, spacing = _axes(solid), float(solid["spacing"])
    corners = np.array([[x, y, 0.0] for x in (low[0], high[0]) for y in (low[1], high[1])])
    own = (corners - solid["position"]) @ axes.T / spacing
    first, last = np.floor(own[:, :2].min(0)).astype(int), np.ceil(own[:, :2].max(0)).astype(int)
    stride = max(1, math.ceil(int((last - first).max()) / (2 * LINES)))
    i, j = (np.arange(first[k] // stride * stride, last[k] + stride, stride) for k in (0, 1))
    columns, rows = int(solid["columns"]), int(solid["rows"])
    z = heights[int(solid["first"]) + (j[:, None] % rows) * columns + i[None, :] % columns]
    u, v = np.meshgrid(spacing * i, spacing * j)
    points = solid["position"] + u[..., None] * axes[0] + v[..., None] * axes[1] + z[..., None] * axes[2]
    lines = [*points, *points.transpose(1, 0, 2)]
    return np.concatenate([_joined(line) for line in lines])


_OUTLINES: dict[int, Callable[[Any, Floats, Floats], Segments]] = {
    SPHERE: _sphere,
    CAPSULE: _upright,
    CYLINDER: _upright,
    BOX: _box,
    PLANE: _plane,
}
