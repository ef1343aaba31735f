"""Obstacles as seen from above: discs that do not overlap, and the shortest way between them.

The arena is a rectangle: x runs from the start, at (0, 0), to the goal, at (distance, 0). A way between the discs is free at every
depth.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import uniform4
from auvbench.worlds.kinds import Floats
from auvbench.worlds.solids import triple

CELL = 0.5
"""side of a cell of the map, m"""
DARTS = 40
"""Largest number of darts (random positions) for each disc"""

Key = tuple[int, int, int, int]
"""Seed, stream, episode and environment of the draws."""


@njit(nogil=True)
def apart(x: float, y: float) -> float:
    """Return the length of (x, y)."""
    return math.sqrt(x * x + y * y)


@compiled("dynamics")
def scatter(
    key: Key,
    attempt: int,
    count: int,
    arena: tuple[float, float],
    radii: tuple[float, float],
    gap: float,
    free: float,
) -> Floats:
    """Return random discs (k, 3): x, y and radius in m.

    Darts are thrown until `count` discs are placed or `DARTS` darts for each disc are thrown (Poisson-disc sampling).

    Args:
        key: key of the draws.
        attempt: number of the attempt with this key; each attempt draws different discs.
        count: number of discs.
        arena: distance from start to goal and margin on all sides, m.
        radii: smallest and largest radius, m.
        gap: smallest distance between discs, m.
        free: smallest distance of a disc from start and goal, m.
    """
    seed, stream, episode, environment = key
    (distance, margin), (low, high) = arena, radii
    discs = np.empty((count, 3))
    placed = 0
    for dart in range(DARTS * count):
        if placed == count:
            break
        u, v, w, _ = uniform4(seed, stream, dart, attempt, episode, environment)
        x, y, radius = (
            -margin + u * (distance + 2.0 * margin),
            margin * (2.0 * v - 1.0),
            low + (high - low) * w,
        )
        if min(apart(x, y), apart(x - distance, y)) < radius + free:
            continue
        has_room = True
        for k in range(placed):
            other_x, other_y, other_radius = triple(discs[k])
            if apart(x - other_x, y - other_y) < radius + other_radius + gap:
                has_room = False
                break
        if has_room:
            discs[placed, 0], discs[placed, 1], discs[placed, 2] = x, y, radius
            placed += 1
    return discs[:placed].copy()


@njit(nogil=True)
def room_at(discs: Floats, x: float, y: float) -> float:
    """Return the distance in m of a point from the nearest disc."""
    room = math.inf
    for k in range(discs.shape[0]):
        disc_x, disc_y, radius = triple(discs[k])
        room = min(room, apart(x - disc_x, y - disc_y) - radius)
    return room


@njit(nogil=True)
def grid_of(distance: float, margin: float) -> tuple[int, int, int, int]:
    """Return the map's numbers of rows and columns, and the indices of the cells that contain start and goal."""
    columns = math.ceil((distance + 2.0 * margin) / CELL) + 1
    rows = 2 * math.ceil(margin / CELL) + 1
    middle = (rows - 1) // 2 * columns
    return rows, columns, middle + round(margin / CELL), middle + round((distance + margin) / CELL)


@njit(nogil=True)
def place_of(cell: int, rows: int, columns: int, margin: float) -> tuple[float, float]:
    """Return x and y in m of the middle of a cell."""
    left, low = -margin, -0.5 * (rows - 1) * CELL
    return left + (cell % columns) * CELL, low + (cell // columns) * CELL


@njit(nogil=True)
def search(
    room: Floats, rows: int, columns: int, start: int, goal: int, least: float
) -> tuple[float, NDArray[np.int64]]:
    """Return the length in m of the shortest way by Dijkstra's algorithm, and each cell's predecessor on the way from the start.

    The length is infinite if no way exists. The predecessor is -1 for the start and for cells that were not reached.

    Args:
        room: (rows * columns,) distance of each cell from the obstacles, m.
        rows: number of rows of the map.
        columns: number of columns of the map.
        start: index of the cell of the start.
        goal: index of the cell of the goal.
        least: smallest distance of a free cell from the obstacles, m.
    """
    length = np.full(rows * columns, math.inf)
    before = np.full(rows * columns, -1)
    length[start] = 0.0
    waiting = [(0.0, start)]
    while len(waiting) > 0:
        so_far, cell = heapq.heappop(waiting)
        if cell == goal:
            break
        if so_far > length[cell]:
            continue
        row, column = cell // columns, cell % columns
        for up in range(-1, 2):
            for right in range(-1, 2):
                if not (0 <= row + up < rows and 0 <= column + right < columns):
                    continue
                other = cell + up * columns + right
                then = so_far + CELL * math.sqrt(up * up + right * right)
                if room[other] >= least and then < length[other]:
                    length[other], before[other] = then, cell
                    heapq.heappush(waiting, (then, other))
    return length[goal], before


@compiled("dynamics")
def shortest_way(discs: Floats, radius: float, distance: float, margin: float) -> tuple[float, float]:
    """Return the length in m of the shortest way from start to goal, and the mean clearance in m of a vehicle on this way.

    Dijkstra's algorithm runs on a map with cells of CELL m and eight neighbours. A cell is free if a vehicle of this radius at any
    point of the cell touches no disc. The length is infinite if no way leads to the goal.
    """
    rows, columns, start, goal = grid_of(distance, margin)
    room = np.empty(rows * columns)
    for cell in range(rows * columns):
        x, y = place_of(cell, rows, columns, margin)
        room[cell] = room_at(discs, x, y) - radius
    length, before = search(room, rows, columns, start, goal, CELL * math.sqrt(0.5))
    total, cells, cell = 0.0, 0, goal
    while cell >= 0:
        total, cells, cell = total + room[cell], cells + 1, before[cell]
    return length, total / cells
