"""The geometry of solids again in plain NumPy, as an oracle: signed distances of many points, and rays by marching."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.worlds import solids as made

Floats = NDArray[np.float64]
Distance = Callable[[Floats], Floats]


def own_axes(solid: Any, points: Floats) -> Floats:
    axes = np.array([solid["along_x"], solid["along_y"], solid["along_z"]])
    return (points - solid["position"]) @ axes.T


def signed_distance(solid: Any, points: Floats) -> Floats:
    """Return the signed distances (k,) of points (k, 3) from a convex solid, by a formula for each region."""
    p = own_axes(solid, points)
    radius, half = float(solid["radius"]), np.asarray(solid["half"])
    if solid["kind"] == made.SPHERE:
        return np.linalg.norm(p, axis=1) - radius
    if solid["kind"] == made.PLANE:
        return p[:, 2]
    if solid["kind"] == made.CAPSULE:
        a, b = np.array([0.0, 0.0, -half[2]]), np.array([0.0, 0.0, half[2]])
        share = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        return np.linalg.norm(p - a - share[:, None] * (b - a), axis=1) - radius
    if solid["kind"] == made.BOX:
        q = np.abs(p) - half
    else:
        q = np.stack([np.hypot(p[:, 0], p[:, 1]) - radius, np.abs(p[:, 2]) - half[2]], axis=1)
    return np.where(q.max(1) > 0.0, np.linalg.norm(np.maximum(q, 0.0), axis=1), q.max(1))


def march(
    distance: Distance,
    origins: Floats,
    directions: Floats,
    limits: Floats,
    shortest: float,
    slope: float = 1.0,
) -> Floats:
    """Return how far (k,) each ray gets before its distance changes its sign; at most `limits` (k,).

    Args:
        distance: of points (k, 3); its size must not exceed `slope` times the distance to its next zero.
        shortest: m, smallest step: a crossing of a shorter part of a ray may be missed.
    """
    at = np.zeros(len(origins))
    sign = np.sign(distance(origins))
    active = np.arange(len(origins))
    while len(active):
        value = distance(origins[active] + at[active, None] * directions[active])
        active, value = active[same := value * sign[active] > 0.0], value[same]
        at[active] += np.maximum(np.abs(value) / slope, shortest)
        active = active[at[active] < limits[active]]
    return np.minimum(at, limits)


def triangles(heights: Floats, spacing: float, corner: Floats, reach: int) -> Floats:
    """Return the triangles (k, 3, 3) of a height field that repeats `reach` times to each side."""
    rows, columns = heights.shape
    found = []
    for j in range(-reach * rows, reach * rows):
        for i in range(-reach * columns, reach * columns):
            a, b, c, d = (
                np.array([(i + x) * spacing, (j + y) * spacing, heights[(j + y) % rows, (i + x) % columns]])
                for y in (0, 1)
                for x in (0, 1)
            )
            found += [[a, b, d], [a, c, d]]
    return np.array(found) + corner


def triangle_distance(triangle: Floats, points: Floats) -> Floats:
    """Return the distances (k,) of points (k, 3) from a triangle: from its plane, or the nearest of its sides."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    inside = np.ones(len(points), dtype=bool)
    sides = []
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (points - p) @ np.cross(normal, q - p) >= 0.0
        share = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0.0, 1.0)
        sides.append(np.linalg.norm(points - p - share[:, None] * (q - p), axis=1))
    return np.where(inside, np.abs((points - a) @ normal), np.min(sides, axis=0))


def height(heights: Floats, spacing: float, corner: Floats, points: Floats) -> Floats:
    """Return the heights (k,) in m of the ground below points (k, 3): barycentric coordinates in their triangles."""
    u, v = ((points[:, :2] - corner[:2]) / spacing).T
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    rows, columns = heights.shape
    a, b, c, d = (heights[(j + y) % rows, (i + x) % columns] for y in (0, 1) for x in (0, 1))
    u, v = u - i, v - j
    below = (1.0 - u) * a + (u - v) * b + v * d
    above = (1.0 - v) * a + (v - u) * c + u * d
    return corner[2] + np.where(u >= v, below, above)
