"""The clearance of a vehicle after an agent step, compiled into the loops of tasks with a world."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auvbench.dynamics.layout import record
from auvbench.dynamics.vectors import add, product, rotation_matrix
from auvbench.tasks.records import Record
from auvbench.tasks.rows import Floats, Vehicle, row
from auvbench.worlds.casting import nearest_surface

HULL = record(
    radius=(),  # m, radius of the hull's spheres
    first=(),  # m, x of the first sphere's centre in body axes
    spacing=(),  # m between centres along x
    count=np.int64,
    near=(),  # m, clearance below which the time near solids is counted
)

FIELDS = (
    ("solids", "i8"),  # number of solids in the world
    ("contact", "i8"),  # 1 + index of the solid that the vehicle has hit; 0: none
    ("clearance", "f8"),  # m, smallest clearance so far
    ("near_time", "f8"),  # s, time with a clearance below `near`
)
"""Fields of an episode in a world with solids"""


@row
def touch(e: Record, v: Vehicle, p: Record, solids: Any, heights: Floats, hull: Record) -> None:
    """Write the smallest clearance so far, the time near solids, and the solid that the vehicle has hit."""
    time = e.steps * p.duration
    rotation = rotation_matrix(v.attitude)
    least = math.inf
    for k in range(hull.count):
        centre = add(v.position, product(rotation, (hull.first + k * hull.spacing, 0.0, 0.0)))
        # Solids that are farther away do not affect the fields.
        longest = max(e.clearance, hull.near) + hull.radius
        distance, index, _ = nearest_surface(solids[: e.solids], heights, time, centre, longest)
        least = min(least, distance - hull.radius)
        if distance <= hull.radius:
            e.contact = 1 + index
    e.clearance = min(e.clearance, least)
    if least < hull.near:
        e.near_time += p.duration
