"""An ideal fan of rays: it measures at every step, without delay."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvbench.tasks.ranges.base import Floats, RangeSensor, Scene, closeness, distance_along
from auvbench.tasks.ranges.beams import fan, spread
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row


@row
def sense(e: Record, d: Record, memory: Floats, p: Record, rays: Any, scene: Scene, out: Any) -> None:
    """Write the closeness along each ray."""
    for k in range(rays.shape[0]):
        distance = distance_along(scene, scene.rotation, rays, k, k + 1, p.high)
        out[k] = closeness(e, p, scene.stream, k, distance, 0.0)


class IdealFan(RangeSensor):
    """Fan of `rows` times `columns` rays."""

    sense = staticmethod(sense)

    def directions(self) -> Floats:
        s = self.settings
        azimuths, elevations = -spread(s.horizontal, s.columns), spread(s.vertical, s.rows)
        return fan(np.tile(azimuths, s.rows), np.repeat(elevations, s.columns))
