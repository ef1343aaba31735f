"""A height field in its own axes: heights at the vertices of a regular grid, two triangles for each cell.

The diagonal of a cell goes from the lower left to the upper right vertex. The grid repeats beyond its edges, so that each
point has ground below it. Coordinates `u`, `v` are x and y in units of the cell size.
"""

from __future__ import annotations

import math

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Record, Vector
from auvbench.dynamics.vectors import add, cross, dot, scale, subtract
from auvbench.worlds.convex import Signed
from auvbench.worlds.kinds import Floats

Corners = tuple[float, float, float, float]
"""Heights of the corners of a cell in m: lower left, lower right, upper left, upper right."""

MARGIN = 1e-6
"""Distance by which the slab that contains all heights is made thicker on each side, m"""


@inline
def wrapped(index: int, count: int) -> int:
    """Return the index of a vertex, wrapped into the grid, which repeats beyond its edges."""
    return index if 0 <= index < count else index % count


@inline
def corners_of(s: Record, heights: Floats, i: int, j: int) -> Corners:
    """Return the heights of the corners of cell (i, j)."""
    left, right = wrapped(i, s.columns), wrapped(i + 1, s.columns)
    low = s.first + wrapped(j, s.rows) * s.columns
    high = s.first + wrapped(j + 1, s.rows) * s.columns
    return heights[low + left], heights[low + right], heights[high + left], heights[high + right]


@inline
def ground(corners: Corners, u: float, v: float) -> float:
    """Return the height in m at a point of a cell; u and v in [0, 1] are measured from the cell's lower left corner."""
    a, b, c, d = corners
    return a + (b - a) * u + (d - b) * v if u >= v else a + (d - c) * u + (c - a) * v


@inline
def boundary(u: float, du: float, i: int) -> float:
    """Return the distance along a ray to the edge at which the ray leaves column or row i."""
    if du == 0.0:
        return math.inf
    return (i + 1 - u) / du if du > 0.0 else (i - u) / du


@inline
def between_heights(s: Record, z: float, dz: float, longest: float) -> tuple[float, float]:
    """Return the distances along a ray at which the ray enters and leaves the slab between the lowest and the highest point."""
    low, high = s.lowest - MARGIN, s.highest + MARGIN
    if dz == 0.0:
        return 0.0, longest if low <= z <= high else -1.0
    a, b = (low - z) / dz, (high - z) / dz
    return max(0.0, min(a, b)), min(longest, max(a, b))


@inline
def terrain_range(s: Record, heights: Floats, o: Vector, d: Vector, longest: float) -> float:
    """Return the distance in m along a ray to the ground, from above or below; infinity if no hit is within `longest` (finite).

    The ray goes from cell to cell (Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987). The
    ray's height above a triangle is linear. The signs of this height at both ends of the ray's part over the triangle
    show whether the ray crosses the ground.
    """
    (x, y, z), (dx, dy, dz) = o, d
    u, v, du, dv = x / s.spacing, y / s.spacing, dx / s.spacing, dy / s.spacing
    t, far = between_heights(s, z, dz, longest)
    i, j = math.floor(u), math.floor(v)
    side = math.copysign(1.0, z - ground(corners_of(s, heights, i, j), u - i, v - j))
    i, j = math.floor(u + t * du), math.floor(v + t * dv)
    while t < far:
        corners = corners_of(s, heights, i, j)
        above = side * (z + t * dz - ground(corners, u + t * du - i, v + t * dv - j))
        next_i, next_j = boundary(u, du, i), boundary(v, dv, j)
        end = min(max(t, min(next_i, next_j)), far)
        diagonal = ((v - j) - (u - i)) / (du - dv) if du != dv else t
        for stop in (diagonal, end):
            if stop >= t and stop <= end:
                then = side * (z + stop * dz - ground(corners, u + stop * du - i, v + stop * dv - j))
                if then <= 0.0:
                    above = max(above, 0.0)
                    return t + (stop - t) * above / (above - then) if above > then else t
                t, above = stop, then
        if next_i <= next_j:
            i += 1 if du > 0.0 else -1
        else:
            j += 1 if dv > 0.0 else -1
    return math.inf


@inline
def on_triangle(p: Vector, a: Vector, b: Vector, c: Vector) -> Vector:
    """Return the point of a triangle that is nearest to p (Ericson, "Real-time collision detection", 2005, section 5.1.5)."""
    ab, ac, ap = subtract(b, a), subtract(c, a), subtract(p, a)
    d1, d2 = dot(ab, ap), dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a
    bp = subtract(p, b)
    d3, d4 = dot(ab, bp), dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return b
    on_ab = d1 * d4 - d3 * d2
    if on_ab <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return add(a, scale(d1 / (d1 - d3), ab))
    cp = subtract(p, c)
    d5, d6 = dot(ab, cp), dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return c
    on_ac = d5 * d2 - d1 * d6
    if on_ac <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return add(a, scale(d2 / (d2 - d6), ac))
    on_bc = d3 * d6 - d5 * d4
    if on_bc <= 0.0 and d4 >= d3 and d5 >= d6:
        return add(b, scale((d4 - d3) / ((d4 - d3) + (d5 - d6)), subtract(c, b)))
    share = 1.0 / (on_bc + on_ac + on_ab)
    return add(a, add(scale(on_ac * share, ab), scale(on_ab * share, ac)))


@inline
def beyond(value: float, low: float, high: float) -> float:
    """Return how far a number is from an interval."""
    return max(low - value, value - high, 0.0)


@inline
def upward(corners: Corners, spacing: float, u: float, v: float) -> Vector:
    """Return the normal of the triangle at a point of a cell."""
    a, b, c, d = corners
    rise_x, rise_y = (b - a, d - b) if u >= v else (d - c, c - a)
    normal = cross((spacing, 0.0, rise_x), (0.0, spacing, rise_y))
    return scale(1.0 / math.sqrt(dot(normal, normal)), normal)


@inline
def terrain_distance(s: Record, heights: Floats, p: Vector, longest: float) -> Signed:
    """Return the signed distance of a point from the ground, negative for a point below the ground.

    The distance along z times the cosine of the steepest slope is a lower bound of the distance. If this bound is at least `longest`,
    the result is the bound. The nearest triangle is not farther than the distance along z, so the search covers only a square with this
    distance as half width.
    """
    x, y, z = p
    side = s.spacing
    u, v = x / side, y / side
    i, j = math.floor(u), math.floor(v)
    corners = corners_of(s, heights, i, j)
    above = z - ground(corners, u - i, v - j)
    normal = upward(corners, side, u - i, v - j)
    size = abs(above)
    if size * s.cosine >= longest:
        return above * s.cosine, normal
    nearest, squared = (x, y, z - above), above * above
    for row in range(math.floor((y - size) / side), math.floor((y + size) / side) + 1):
        for column in range(math.floor((x - size) / side), math.floor((x + size) / side) + 1):
            left, low = column * side, row * side
            away_x, away_y = beyond(x, left, left + side), beyond(y, low, low + side)
            level = away_x * away_x + away_y * away_y
            if level >= squared:
                continue
            a, b, c, d = corners_of(s, heights, column, row)
            away_z = beyond(z, min(a, b, c, d), max(a, b, c, d))
            if level + away_z * away_z >= squared:
                continue
            first, last = (left, low, a), (left + side, low + side, d)
            for corner in ((left + side, low, b), (left, low + side, c)):
                point = on_triangle(p, first, corner, last)
                apart = subtract(p, point)
                if dot(apart, apart) < squared:
                    nearest, squared = point, dot(apart, apart)
    distance = math.sqrt(squared)
    if distance < MARGIN:
        return math.copysign(distance, above), normal
    sign = math.copysign(1.0, above)
    return sign * distance, scale(sign / distance, subtract(p, nearest))
