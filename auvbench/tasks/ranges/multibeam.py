"""A multibeam sonar: all beams of a plane at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvbench.config.ranges import oldest
from auvbench.tasks.ranges.base import (
    Floats,
    RangeSensor,
    Scene,
    arrived,
    closeness,
    distance_along,
    keep,
    new_step,
    pings_until,
)
from auvbench.tasks.ranges.beams import fan, middles, spread
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row

ACROSS, HIGH = 2, 5
"""Number of rays across the horizontal angle of a beam, and across its vertical angle"""


@row
def sense(e: Record, d: Record, memory: Floats, p: Record, rays: Any, scene: Scene, out: Any) -> None:
    """Write the closeness of each beam and the age of the ping."""
    beams = out.shape[0] - 1
    if new_step(e, d):
        if e.steps == 0 or pings_until(e.steps, p) > pings_until(e.steps - 1, p):
            per_beam = rays.shape[0] // beams
            for k in range(beams):
                first = k * per_beam
                distance = distance_along(scene, scene.rotation, rays, first, first + per_beam, p.high)
                memory[k] = closeness(e, p, scene.stream, k, distance, p.low)
            memory[beams] = e.steps * p.duration
        keep(e, p, memory)
    for k in range(beams):
        out[k] = arrived(e, p, memory, k)
    out[beams] = min(e.steps * p.duration - arrived(e, p, memory, beams), p.oldest)


class MultibeamSonar(RangeSensor):
    """Multibeam sonar. The rays of a beam cover the beam's part of the horizontal angle, and the whole vertical angle."""

    sense = staticmethod(sense)

    def directions(self) -> Floats:
        s = self.settings
        count = s.beams * ACROSS
        azimuths = -middles(s.horizontal, count)
        return fan(np.repeat(azimuths, HIGH), np.tile(spread(s.vertical, HIGH), count))

    def size(self) -> int:
        return int(self.settings.beams) + 1  # closenesses, time of the ping in s

    def more(self) -> dict[str, Any]:
        s = self.settings
        return {"period": 1.0 / s.rate, "oldest": oldest(s)}
