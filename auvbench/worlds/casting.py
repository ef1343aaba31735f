"""Find the nearest of many solids along a ray or from a point.

`first_hit` is for one ray and `nearest_surface` for one point; `cast` is for many rays and `clearance` for many points.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import borrowed, compiled, inline
from auvbench.dynamics.layout import Matrix, Record, Vector
from auvbench.dynamics.vectors import ZERO, dot, product, subtract
from auvbench.worlds.convex import (
    Signed,
    box_distance,
    box_span,
    capsule_distance,
    capsule_span,
    cylinder_distance,
    cylinder_span,
    first_crossing,
    plane_distance,
    plane_span,
    sphere_distance,
    sphere_span,
)
from auvbench.worlds.kinds import BOX, CAPSULE, CYLINDER, NOTHING, PLANE, SPHERE, Floats
from auvbench.worlds.solids import position_at, to_solid, to_world, triple
from auvbench.worlds.terrain import terrain_distance, terrain_range

Integers = NDArray[np.int64]


@inline
def passes(v: Vector, direction: Vector, reach: float, longest: float) -> bool:
    """Return whether a ray of length `longest` misses a sphere of radius `reach`; v points from the sphere's centre to the ray's origin."""
    ahead = -dot(v, direction)
    if ahead < -reach or ahead - reach > longest:
        return True
    return dot(v, v) - ahead * ahead > reach * reach


@compiled("dynamics")
def range_to(
    s: Record, heights: Floats, time: float, origin: Vector, direction: Vector, longest: float
) -> float:
    """Return the distance in m along a ray to a solid's surface; a result above `longest` means no hit within `longest`.

    This function is not inlined into its callers, because a ray misses most solids, and the callers' loops are twice as fast
    without its code.
    """
    o, d = to_solid(s, subtract(origin, position_at(s, time))), to_solid(s, direction)
    _, _, half_length = half = triple(s.half)
    kind = s.kind
    if kind == SPHERE:
        return first_crossing(sphere_span(o, d, s.radius))
    if kind == CAPSULE:
        return first_crossing(capsule_span(o, d, s.radius, half_length))
    if kind == CYLINDER:
        return first_crossing(cylinder_span(o, d, s.radius, half_length))
    if kind == BOX:
        return first_crossing(box_span(o, d, half))
    if kind == PLANE:
        return first_crossing(plane_span(o, d))
    return terrain_range(s, heights, o, d, longest)


@compiled("dynamics")
def distance_to(s: Record, heights: Floats, time: float, point: Vector, longest: float) -> Signed:
    """Return the signed distance in m of a point from a solid, and its gradient in world axes; see `terrain_distance` for `longest`."""
    p = to_solid(s, subtract(point, position_at(s, time)))
    _, _, half_length = half = triple(s.half)
    kind = s.kind
    if kind == SPHERE:
        distance, gradient = sphere_distance(p, s.radius)
    elif kind == CAPSULE:
        distance, gradient = capsule_distance(p, s.radius, half_length)
    elif kind == CYLINDER:
        distance, gradient = cylinder_distance(p, s.radius, half_length)
    elif kind == BOX:
        distance, gradient = box_distance(p, half)
    elif kind == PLANE:
        distance, gradient = plane_distance(p)
    else:
        distance, gradient = terrain_distance(s, heights, p, longest)
    return distance, to_world(s, gradient)


@inline
def first_hit(
    solids: Any, heights: Floats, time: float, origin: Vector, direction: Vector, longest: float
) -> tuple[float, int]:
    """Return the distance in m along a ray to the first surface, and the index of the solid with this surface.

    If no surface is nearer than `longest`, the result is `longest` and NOTHING. A ray that starts inside a solid hits the surface of
    that solid from inside.

    Args:
        solids: (n,) records of SOLID.
        heights: heights (m,) of all terrain, m.
        time: time, s, from which the positions of moving solids follow.
        origin: origin of the ray, m, world axes.
        direction: direction of length 1.
        longest: largest distance, m; must be finite.
    """
    nearest, index = longest, NOTHING
    for k in range(solids.shape[0]):
        s = solids[k]
        if passes(subtract(origin, position_at(s, time)), direction, s.reach, nearest):
            continue
        distance = range_to(s, heights, time, origin, direction, nearest)
        if distance < nearest:
            nearest, index = distance, k
    return nearest, index


@compiled("dynamics")
def nearest_along(
    solids: Any,
    heights: Floats,
    time: float,
    origin: Vector,
    rotation: Matrix,
    rays: Floats,
    first: int,
    stop: int,
    longest: float,
) -> float:
    """Return the smallest distance in m to a surface along any of several rays; `longest` if no surface is nearer.

    Args:
        solids: (n,) records of SOLID.
        heights: heights (m,) of all terrain, m.
        time: time, s, from which the positions of moving solids follow.
        origin: origin of the rays, m, world axes.
        rotation: rotation from the rays' axes to world axes.
        rays: (k, 3) directions of length 1; rays first .. stop - 1 are used.
        first: index of the first ray.
        stop: index after the last ray.
        longest: largest distance, m; must be finite.
    """
    nearest = longest
    for k in range(first, stop):
        nearest, _ = first_hit(solids, heights, time, origin, product(rotation, triple(rays[k])), nearest)
    return nearest


@compiled("dynamics")
def range_below(solids: Any, heights: Floats, time: float, point: Vector, longest: float) -> float:
    """Return the distance in m from a point down to the first surface; `longest` if no surface is nearer."""
    distance, _ = first_hit(solids, heights, time, point, (0.0, 0.0, -1.0), longest)
    return distance


@compiled("dynamics")
def nearest_surface(
    solids: Any, heights: Floats, time: float, point: Vector, longest: float
) -> tuple[float, int, Vector]:
    """Return the signed distance in m to the nearest solid, the solid's index, and the distance's gradient; arguments: see `first_hit`.

    If no solid is nearer than `longest`, the result is `longest`, NOTHING and a zero vector.
    """
    nearest, index, gradient = longest, NOTHING, ZERO
    for k in range(solids.shape[0]):
        s = solids[k]
        v = subtract(point, position_at(s, time))
        room = max(nearest, 0.0) + s.reach
        if dot(v, v) > room * room:
            continue
        distance, slope = distance_to(s, heights, time, point, max(nearest, 0.0))
        if distance < nearest:
            nearest, index, gradient = distance, k, slope
    return nearest, index, gradient


@compiled("dynamics")
def cast(
    solids: Any,
    heights: Floats,
    time: float,
    origins: Floats,
    directions: Floats,
    longest: float,
    ranges: Floats,
    hits: Integers,
) -> None:
    """Write `first_hit` of each ray from `origins` (k, 3) along `directions` (k, 3): distances (k,) and indices of solids (k,)."""
    solids, heights = borrowed(solids), borrowed(heights)
    for r in range(ranges.shape[0]):
        ranges[r], hits[r] = first_hit(
            solids, heights, time, triple(origins[r]), triple(directions[r]), longest
        )


@compiled("dynamics")
def clearance(
    solids: Any,
    heights: Floats,
    time: float,
    points: Floats,
    longest: float,
    distances: Floats,
    nearest: Integers,
    gradients: Floats,
) -> None:
    """Write `nearest_surface` of each of `points` (k, 3): signed distances (k,), indices of solids (k,) and gradients (k, 3)."""
    solids, heights = borrowed(solids), borrowed(heights)
    for r in range(distances.shape[0]):
        distance, index, (x, y, z) = nearest_surface(solids, heights, time, triple(points[r]), longest)
        distances[r], nearest[r] = distance, index
        gradients[r, 0], gradients[r, 1], gradients[r, 2] = x, y, z
