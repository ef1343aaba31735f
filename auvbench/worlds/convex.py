"""Sphere, capsule, cylinder, box and plane, each in its own axes with its centre at the origin.

* `*_distance`: signed distance of a point in m, negative inside, and the gradient of this distance, a unit vector out of the solid.
  The formulas are from Quilez, "Distance functions" (iquilezles.org/articles/distfunctions).
* `*_span`: the part of a ray inside the solid, as two distances along the ray in m. The shapes are convex, so this part is one
  interval: the overlap of the intervals of simpler shapes (Kay and Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986) or, for a
  capsule, the hull of these intervals.

The discriminant of a quadratic is computed from the point of the ray nearest to the centre. This keeps the precision for rays that
start far away (Haines et al., "Precision improvements for ray/sphere intersection", Ray Tracing Gems, 2019, chapter 7).
"""

from __future__ import annotations

import math

from auvbench.dynamics.compiled import inline
from auvbench.dynamics.layout import Pair, Vector
from auvbench.dynamics.vectors import add, dot, scale

MISS = (math.inf, -math.inf)
EVERYWHERE = (-math.inf, math.inf)
PARALLEL = 1e-30
"""Largest squared sine of the angle between a ray and an axis that are treated as parallel"""

Signed = tuple[float, Vector]
"""Signed distance in m, and its gradient."""


# --- Signed distances ---------------------------------------------------------------------------------------------------------


@inline
def sphere_distance(p: Vector, radius: float) -> Signed:
    """Return the signed distance of a point from a sphere."""
    length = math.sqrt(dot(p, p))
    return length - radius, scale(1.0 / length, p) if length > 0.0 else (1.0, 0.0, 0.0)


@inline
def capsule_distance(p: Vector, radius: float, half: float) -> Signed:
    """Return the signed distance of a point from a capsule along z."""
    x, y, z = p
    return sphere_distance((x, y, z - min(max(z, -half), half)), radius)


@inline
def cylinder_distance(p: Vector, radius: float, half: float) -> Signed:
    """Return the signed distance of a point from a cylinder along z."""
    x, y, z = p
    level = math.sqrt(x * x + y * y)
    outward = (x / level, y / level, 0.0) if level > 0.0 else (1.0, 0.0, 0.0)
    upward = (0.0, 0.0, math.copysign(1.0, z))
    out, up = level - radius, abs(z) - half
    if out > 0.0 and up > 0.0:
        distance = math.sqrt(out * out + up * up)
        return distance, add(scale(out / distance, outward), scale(up / distance, upward))
    return (out, outward) if out > up else (up, upward)


@inline
def box_distance(p: Vector, half: Vector) -> Signed:
    """Return the signed distance of a point from a box."""
    (x, y, z), (half_x, half_y, half_z) = p, half
    out_x, out_y, out_z = abs(x) - half_x, abs(y) - half_y, abs(z) - half_z
    most = max(out_x, out_y, out_z)
    if most > 0.0:
        beyond = (
            math.copysign(max(out_x, 0.0), x),
            math.copysign(max(out_y, 0.0), y),
            math.copysign(max(out_z, 0.0), z),
        )
        distance = math.sqrt(dot(beyond, beyond))
        return distance, scale(1.0 / distance, beyond)
    if out_x == most:
        return most, (math.copysign(1.0, x), 0.0, 0.0)
    if out_y == most:
        return most, (0.0, math.copysign(1.0, y), 0.0)
    return most, (0.0, 0.0, math.copysign(1.0, z))


@inline
def plane_distance(p: Vector) -> Signed:
    """Return the signed distance of a point from the plane z = 0, below which all is solid."""
    _, _, z = p
    return z, (0.0, 0.0, 1.0)


# --- Rays ---------------------------------------------------------------------------------------------------------------------


@inline
def first_crossing(span: Pair) -> float:
    """Return the distance along a ray to the first point on the surface, from outside or inside; infinity if the ray has no such point."""
    enter, leave = span
    if enter > leave or leave < 0.0:
        return math.inf
    return enter if enter >= 0.0 else leave


@inline
def overlap(a: Pair, b: Pair) -> Pair:
    """Return the part of a ray that is inside two shapes at the same time; `a` and `b` are the parts inside each shape."""
    (a_enter, a_leave), (b_enter, b_leave) = a, b
    enter, leave = max(a_enter, b_enter), min(a_leave, b_leave)
    return (enter, leave) if enter <= leave else MISS


@inline
def hull(a: Pair, b: Pair) -> Pair:
    """Return the shortest interval of a ray that contains the intervals `a` and `b`; it is the union's span if the union is convex."""
    (a_enter, a_leave), (b_enter, b_leave) = a, b
    return min(a_enter, b_enter), max(a_leave, b_leave)


@inline
def sphere_span(o: Vector, d: Vector, radius: float) -> Pair:
    """Return the part of the ray o + t d, with d of length 1, in a sphere."""
    middle = -dot(o, d)
    nearest = add(o, scale(middle, d))
    squared = radius * radius - dot(nearest, nearest)
    if squared < 0.0:
        return MISS
    half = math.sqrt(squared)
    return middle - half, middle + half


@inline
def tube_span(o: Vector, d: Vector, radius: float) -> Pair:
    """Return the part of a ray in an infinitely long cylinder along z."""
    (x, y, _), (dx, dy, _) = o, d
    across = dx * dx + dy * dy
    if across < PARALLEL:
        return EVERYWHERE if x * x + y * y <= radius * radius else MISS
    middle = -(x * dx + y * dy) / across
    near_x, near_y = x + middle * dx, y + middle * dy
    squared = radius * radius - (near_x * near_x + near_y * near_y)
    if squared < 0.0:
        return MISS
    half = math.sqrt(squared / across)
    return middle - half, middle + half


@inline
def slab_span(o: float, d: float, half: float) -> Pair:
    """Return the part of a ray between the planes at +-`half`; o and d are the ray's origin and direction along the planes' normal."""
    if d == 0.0:
        return EVERYWHERE if abs(o) <= half else MISS
    a, b = (-half - o) / d, (half - o) / d
    return (a, b) if a <= b else (b, a)


@inline
def cylinder_span(o: Vector, d: Vector, radius: float, half: float) -> Pair:
    """Return the part of a ray in a cylinder along z."""
    (_, _, z), (_, _, dz) = o, d
    return overlap(tube_span(o, d, radius), slab_span(z, dz, half))


@inline
def capsule_span(o: Vector, d: Vector, radius: float, half: float) -> Pair:
    """Return the part of a ray in a capsule along z: a cylinder and two spheres."""
    x, y, z = o
    ends = hull(sphere_span((x, y, z - half), d, radius), sphere_span((x, y, z + half), d, radius))
    return hull(cylinder_span(o, d, radius, half), ends)


@inline
def box_span(o: Vector, d: Vector, half: Vector) -> Pair:
    """Return the part of a ray in a box."""
    (x, y, z), (dx, dy, dz), (half_x, half_y, half_z) = o, d, half
    level = overlap(slab_span(x, dx, half_x), slab_span(y, dy, half_y))
    return overlap(level, slab_span(z, dz, half_z))


@inline
def plane_span(o: Vector, d: Vector) -> Pair:
    """Return the part of a ray below the plane z = 0."""
    (_, _, z), (_, _, dz) = o, d
    if dz == 0.0:
        return EVERYWHERE if z <= 0.0 else MISS
    crossing = -z / dz
    return (crossing, math.inf) if dz < 0.0 else (-math.inf, crossing)
