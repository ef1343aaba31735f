"""Solids as records, and the functions that make them.

A solid has a kind, a pose, sizes and a constant velocity. A solid's own axes are three unit vectors in world axes. The third vector is
the axis of a capsule or cylinder, and the normal of a plane.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Record, Vector, record
from auvbench.dynamics.vectors import add, dot, scale
from auvbench.worlds.kinds import BOX, CAPSULE, CYLINDER, PLANE, SPHERE, TERRAIN, Floats, Solids

SOLID = record(
    kind=np.int64,
    # m, position at time 0: the solid's centre; a point of a plane; the vertex (0, 0) of terrain, at height 0
    position=(3,),
    velocity=(3,),  # m/s
    along_x=(3,),  # unit vectors of the solid's own axes, in world axes
    along_y=(3,),
    along_z=(3,),
    radius=(),  # m, radius of a sphere, capsule or cylinder
    # m, half the sides of a box; for a capsule or cylinder, the third number is half the length of the axis
    half=(3,),
    reach=(),  # m, radius of the sphere around the position that contains the solid
    # The remaining fields describe terrain.
    first=np.int64,  # index of the vertex (0, 0) in the array of heights
    columns=np.int64,  # vertices along x
    rows=np.int64,  # vertices along y
    spacing=(),  # m between vertices
    lowest=(),  # m, lowest height
    highest=(),  # m, highest height
    cosine=(),  # cosine of the angle between the steepest triangle and the horizontal
)

STILL = (0.0, 0.0, 0.0)
NO_HEIGHTS: Floats = np.zeros(1)
"""Heights array of a world without terrain"""


def sphere(centre: ArrayLike, radius: float, velocity: ArrayLike = STILL) -> Solids:
    """Return a sphere (1,); centre and radius in m, velocity in m/s."""
    return _solid(SPHERE, centre, velocity, radius=radius)


def capsule(
    centre: ArrayLike, axis: ArrayLike, length: float, radius: float, velocity: ArrayLike = STILL
) -> Solids:
    """Return a capsule (1,): all points at most `radius` m from a segment of `length` m along `axis`."""
    half = 0.5 * length
    return _solid(
        CAPSULE,
        centre,
        velocity,
        _with_third(axis),
        radius=radius,
        half=(0.0, 0.0, half),
    )


def cylinder(
    centre: ArrayLike, axis: ArrayLike, length: float, radius: float, velocity: ArrayLike = STILL
) -> Solids:
    """Return a cylinder (1,) with flat ends."""
    half = 0.5 * length
    return _solid(CYLINDER, centre, velocity, _with_third(axis), radius=radius, half=(0.0, 0.0, half))


def box(
    centre: ArrayLike, sides: ArrayLike, axes: ArrayLike | None = None, velocity: ArrayLike = STILL
) -> Solids:
    """Return a box (1,) with `sides` (3,) in m; the rows of `axes` (3, 3) are the sides' directions, by default the world's axes."""
    half = 0.5 * np.asarray(sides, dtype=np.float64)
    return _solid(
        BOX,
        centre,
        velocity,
        np.eye(3) if axes is None else axes,
        half=half,
    )


def plane(point: ArrayLike, normal: ArrayLike) -> Solids:
    """Return a plane (1,) through a point; `normal` points to the water, the other side is solid."""
    return _solid(PLANE, point, STILL, _with_third(normal))


def terrain(heights: Floats, spacing: float, corner: ArrayLike, yaw: float = 0.0, first: int = 0) -> Solids:
    """Return a height field (1,): two triangles for each cell of a regular grid, which repeats beyond its edges.

    Args:
        heights: heights (rows, columns) relative to the corner, m; each row runs along the field's x axis.
        spacing: distance between vertices, m.
        corner: position (3,) of vertex (0, 0) at height 0, m.
        yaw: angle of the field's x axis from east, rad.
        first: index of vertex (0, 0) in the world's array of heights; the caller puts `heights.ravel()` there.
    """
    east, north = np.roll(heights, -1, 1), np.roll(heights, -1, 0)
    opposite = np.roll(east, -1, 0)
    # Steepest rise over the length of a cell, of the triangle below and the triangle above each cell's diagonal.
    below = np.hypot(east - heights, opposite - east)
    above = np.hypot(opposite - north, north - heights)
    steepest = float(max(below.max(), above.max())) / spacing
    field = _solid(
        TERRAIN,
        corner,
        STILL,
        first=first,
        columns=heights.shape[1],
        rows=heights.shape[0],
        spacing=spacing,
        lowest=float(heights.min()),
        highest=float(heights.max()),
        cosine=1.0 / math.hypot(1.0, steepest),
    )
    return laid(field, corner, yaw)


def laid(field: Solids, corner: ArrayLike, yaw: float) -> Solids:
    """Return a copy of a height field (1,) with another corner (3,) in m and another yaw of the x axis, rad from east."""
    moved = field.copy()
    moved["position"] = corner
    moved["along_x"] = math.cos(yaw), math.sin(yaw), 0.0
    moved["along_y"] = -math.sin(yaw), math.cos(yaw), 0.0
    return moved


def none() -> Solids:
    """Return an empty array (0,) of solids."""
    return np.zeros(0, SOLID)


def _solid(
    kind: int, position: ArrayLike, velocity: ArrayLike, axes: ArrayLike | None = None, **sizes: Any
) -> Solids:
    solid = np.zeros(1, SOLID)
    solid["kind"], solid["position"], solid["velocity"] = kind, position, velocity
    rows = np.eye(3) if axes is None else np.asarray(axes)
    for name, axis in zip(("along_x", "along_y", "along_z"), rows, strict=True):
        solid[name] = axis
    for name, value in sizes.items():
        solid[name] = value
    solid["reach"] = reach_of(kind, float(solid["radius"][0]), solid["half"][0])
    return solid


def reach_of(kind: int, radius: float, half: ArrayLike) -> float:
    """Return the radius in m of the sphere around a solid's position that contains the solid."""
    sides = np.asarray(half, dtype=np.float64)
    if kind == SPHERE:
        return radius
    if kind == CAPSULE:
        return float(sides[2]) + radius
    if kind == CYLINDER:
        return math.hypot(float(sides[2]), radius)
    return float(np.linalg.norm(sides)) if kind == BOX else math.inf


def _with_third(axis: ArrayLike) -> Floats:
    """Return three perpendicular unit vectors as rows (3, 3); the third has the direction of `axis`."""
    third = np.asarray(axis, dtype=np.float64)
    third = third / np.linalg.norm(third)
    other = np.eye(3)[np.argmin(np.abs(third))]
    first = np.cross(other, third)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(third, first), third])


# --- Compiled -----------------------------------------------------------------------------------------------------------------


@inline
def triple(a: Any) -> Vector:
    """Return a field (3,) as a tuple."""
    return a[0], a[1], a[2]


@inline
def position_at(s: Record, time: float) -> Vector:
    """Return a solid's position in m at a time in s."""
    return add(triple(s.position), scale(time, triple(s.velocity)))


@inline
def to_solid(s: Record, v: Vector) -> Vector:
    """Convert a vector from world axes to a solid's own axes."""
    return dot(triple(s.along_x), v), dot(triple(s.along_y), v), dot(triple(s.along_z), v)


@inline
def to_world(s: Record, v: Vector) -> Vector:
    """Convert a vector from a solid's own axes to world axes."""
    x, y, z = v
    level = add(scale(x, triple(s.along_x)), scale(y, triple(s.along_y)))
    return add(level, scale(z, triple(s.along_z)))
