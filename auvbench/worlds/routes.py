"""Find the shortest way past the solids of a known map, on the grid of `passage`, as a line with few corners.

The arena is the same as in `passage`: x runs from the start to the goal. A way is free at all depths between start and goal.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.layout import Vector
from auvbench.worlds.casting import nearest_surface
from auvbench.worlds.kinds import Floats
from auvbench.worlds.passage import CELL, grid_of, place_of, search
from auvbench.worlds.solids import triple

MARGIN = 0.5
"""Smallest distance between the vehicle and solids on a way, m; if no way keeps this distance, `route` tries half of it, then 0"""
CORNERS = 64
"""Largest number of points of a way"""
LEVEL = 0.5
"""Largest distance between the depths at which a way is checked, m"""


@njit(nogil=True)
def visible(room: Floats, columns: int, first: int, second: int, least: float) -> bool:
    """Return whether the straight line between two cells leads through free cells only."""
    row, column = first // columns, first % columns
    up, right = second // columns - row, second % columns - column
    steps = 2 * max(abs(up), abs(right))
    for k in range(1, steps):
        share = k / steps
        if room[round(row + share * up) * columns + round(column + share * right)] < least:
            return False
    return True


@njit(nogil=True)
def pulled(cells: Any, room: Floats, columns: int, least: float) -> Any:
    """Return the cells at the corners and both ends of a way after the way is pulled tight like a string."""
    corners = [cells[0]]
    at = 0
    while at < len(cells) - 1:
        farthest = len(cells) - 1
        while farthest > at + 1 and not visible(room, columns, cells[at], cells[farthest], least):
            farthest -= 1
        corners.append(cells[farthest])
        at = farthest
    return corners


@njit(nogil=True)
def leg(corners: Floats, k: int) -> float:
    """Return the horizontal distance in m from corner k - 1 to corner k."""
    before = k - 1
    (x, y, _), (to_x, to_y, _) = triple(corners[before]), triple(corners[k])
    return math.hypot(to_x - x, to_y - y)


@compiled("dynamics")
def route(
    solids: Any, heights: Floats, start: Vector, goal: Vector, radius: float, side: float, out: Floats
) -> int:
    """Fill `out` (CORNERS, 3) with the corners and ends of the shortest way, in m; return the number of points, 0 if no way exists.

    Args:
        solids: (n,) records of SOLID, which do not move.
        heights: heights (m,) of all terrain, m.
        start: first point of the way, m.
        goal: last point of the way, m.
        radius: radius of the vehicle, m.
        side: width of the map beyond start and goal, and to each side of the line between them, m.
        out: array to write to; if the way has more points than `out` has rows, the result is 0.
    """
    (x, y, z), (to_x, to_y, to_z) = start, goal
    distance = math.hypot(to_x - x, to_y - y)
    cosine, sine = ((to_x - x) / distance, (to_y - y) / distance) if distance > 0.0 else (1.0, 0.0)
    rows, columns, first, last = grid_of(distance, side)
    levels = 1 + math.ceil(abs(to_z - z) / LEVEL)
    farthest = radius + MARGIN + CELL
    room = np.empty(rows * columns)
    for cell in range(rows * columns):
        along, aside = place_of(cell, rows, columns, side)
        east, north = x + along * cosine - aside * sine, y + along * sine + aside * cosine
        nearest = farthest
        for k in range(levels):
            depth = z + (to_z - z) * k / max(levels - 1, 1)
            nearest, _, _ = nearest_surface(solids, heights, 0.0, (east, north, depth), nearest)
        room[cell] = nearest - radius
    for share in (1.0, 0.5, 0.0):
        least = share * MARGIN + CELL * math.sqrt(0.5)
        length, before = search(room, rows, columns, first, last, least)
        if not math.isfinite(length):
            continue
        cells = [last]
        while before[cells[-1]] >= 0:
            cells.append(before[cells[-1]])
        corners = pulled(cells[::-1], room, columns, least)
        count = max(len(corners), 2)  # start and goal may be in the same cell
        if count > CORNERS:
            return 0
        for k in range(1, count - 1):
            along, aside = place_of(corners[k], rows, columns, side)
            out[k, 0], out[k, 1] = x + along * cosine - aside * sine, y + along * sine + aside * cosine
        out[0, 0], out[0, 1], out[0, 2] = start
        out[count - 1, 0], out[count - 1, 1], out[count - 1, 2] = goal
        total = 0.0
        for k in range(1, count):
            total += leg(out, k)
        so_far = 0.0
        for k in range(1, count - 1):
            so_far += leg(out, k)
            out[k, 2] = z + (to_z - z) * so_far / total
        return count
    return 0
