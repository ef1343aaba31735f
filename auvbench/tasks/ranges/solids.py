"""Show the nearest solids of a known map as numbers, for agents that plan: an ideal map and not a sensor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvbench.dynamics.vectors import add, dot, scale, subtract
from auvbench.tasks import records
from auvbench.tasks.ranges.base import Floats, Scene
from auvbench.tasks.ranges.specs import MOST, NUMBERS, SIGHT
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row, triple
from auvbench.worlds.casting import distance_to
from auvbench.worlds.kinds import PLANE


@row
def level(scene: Scene, v: tuple[float, float, float], out: Any) -> None:
    """Convert a vector from world axes to levelled body axes, which have only the body's yaw, and write it to `out`."""
    c, s = scene.rotation[0][0], scene.rotation[1][0]
    size = (c * c + s * s) ** 0.5
    if size > 0.0:
        c, s = c / size, s / size
    else:
        c, s = 1.0, 0.0
    x, y, z = v
    out[0], out[1], out[2] = c * x + s * y, c * y - s * x, z


@row
def sense(e: Record, d: Record, memory: Floats, p: Record, rays: Any, scene: Scene, out: Any) -> None:
    """Write the nearest solids, the nearest first; `memory` is working space for their distances and indices."""
    time, found = scene.time, 0
    half = memory.shape[0] // 2
    distances, indices = memory[:half], memory[half:]
    for k in range(scene.n_solids):
        s = scene.solids[k]
        off = subtract(scene.position, add(triple(s.position), scale(time, triple(s.velocity))))
        room = SIGHT + s.reach
        if dot(off, off) > room * room:
            continue
        distance, _ = distance_to(s, scene.heights, time, scene.position, SIGHT)
        if distance >= SIGHT or (found == MOST and distance >= distances[MOST - 1]):
            continue
        at = min(found, MOST - 1)
        while at > 0 and distances[at - 1] > distance:
            distances[at], indices[at] = distances[at - 1], indices[at - 1]
            at -= 1
        distances[at], indices[at] = distance, k
        found = min(found + 1, MOST)
    for j in range(MOST * NUMBERS):
        out[j] = 0.0
    for j in range(found):
        s = scene.solids[int(indices[j])]
        own = out[j * NUMBERS : (j + 1) * NUMBERS]
        if s.kind < PLANE:
            own[0] = 1.0 + s.kind
            off = subtract(add(triple(s.position), scale(time, triple(s.velocity))), scene.position)
            level(scene, off, own[1:4])
            level(scene, triple(s.along_z), own[4:7])
            level(scene, triple(s.along_x), own[7:10])
            own[10], own[11], own[12], own[13] = s.radius, s.half[0], s.half[1], s.half[2]
        else:
            # A wall, or the plane that touches a bottom at its nearest point.
            distance, gradient = distance_to(s, scene.heights, time, scene.position, SIGHT)
            own[0] = 1.0 + PLANE
            level(scene, scale(-distance, gradient), own[1:4])
            level(scene, gradient, own[4:7])


class NearestSolids:
    """The nearest solids of N episodes, with the attributes of `RangeSensor` that the observing loop needs."""

    sense = staticmethod(sense)

    def __init__(
        self, name: str, settings: Any, n: int, frequency: float, shared: Mapping[str, float]
    ) -> None:
        owner = f"task.observation={name}"
        self.name = name
        self.parameters = records.one_row({}, shared, owner)
        self.rays: Floats = np.zeros((1, 3))
        self.state = records.state(n, (("step", "i8"),), owner)
        self.memory: Floats = np.zeros((n, 2 * MOST))
