"""A Ping360 scanning sonar: one narrow beam at a time.

All beams that are due in an agent step are sent from the pose at the end of the step. A sector shows the measurement of the head's last
pass, in the vehicle's axes at that time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auvbench.config.ranges import GRADIANS
from auvbench.dynamics.layout import Matrix
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
from auvbench.tasks.ranges.beams import fan, spread
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row

RAYS = 5
"""Number of rays across the vertical angle of a beam"""


@row
def turned(rotation: Matrix, yaw: float) -> Matrix:
    """Return a rotation after a turn about the vertical axis of the body."""
    c, s = math.cos(yaw), math.sin(yaw)
    a, b, f = rotation
    return (
        (a[0] * c + a[1] * s, a[1] * c - a[0] * s, a[2]),
        (b[0] * c + b[1] * s, b[1] * c - b[0] * s, b[2]),
        (f[0] * c + f[1] * s, f[1] * c - f[0] * s, f[2]),
    )


@row
def beam_of(count: int, p: Record) -> int:
    """Return the index in the scan, 0 .. beams - 1, of the beam that is sent as number `count` of the episode."""
    if p.to_and_fro == 0:
        return int(count % p.beams)
    place = count % (2 * p.beams)
    return int(min(place, 2 * p.beams - 1 - place))


@row
def direction(beam: int, p: Record) -> float:
    """Return the direction of a beam in rad, from the centre of the scan."""
    return float((beam + 0.5) * p.turn - 0.5 * p.beams * p.turn)


@row
def sense(e: Record, d: Record, memory: Floats, p: Record, rays: Any, scene: Scene, out: Any) -> None:
    """Write the closeness of each sector and the direction of the head."""
    if new_step(e, d):
        last, done = pings_until(e.steps, p), 0 if e.steps == 0 else pings_until(e.steps - 1, p)
        if e.steps == 0:
            memory[:] = 0.0
            d.sector = -1
        # Beams before these are not needed: later beams of the same sectors overwrite them.
        for count in range(max(done, last - 2 * p.beams), last):
            beam = beam_of(count, p)
            sector = beam * p.sectors // p.beams
            rotation = turned(scene.rotation, direction(beam, p))
            distance = distance_along(scene, rotation, rays, 0, rays.shape[0], p.high)
            echo = closeness(e, p, scene.stream, count - done, distance, p.low)
            memory[sector] = max(echo, memory[sector]) if sector == d.sector else echo
            d.sector = sector
        angle = direction(beam_of(last, p), p)
        memory[p.sectors], memory[p.sectors + 1] = math.cos(angle), math.sin(angle)
        keep(e, p, memory)
    for j in range(out.shape[0]):
        out[j] = arrived(e, p, memory, j)


class ScanningSonar(RangeSensor):
    """Scanning sonar whose beam is one ray wide and several rays high."""

    sense = staticmethod(sense)
    fields = (("sector", "i8"),)  # sector of the last beam; -1: no beam yet

    def directions(self) -> Floats:
        elevations = spread(self.settings.beam, RAYS)
        return fan(np.zeros(RAYS), elevations)

    def size(self) -> int:
        return int(self.settings.sectors) + 2  # closenesses, cosine and sine of the head's direction

    def more(self) -> dict[str, Any]:
        s = self.settings
        return {
            "period": s.beam_time,
            "beams": s.beams,
            "turn": 2.0 * math.pi * s.step / GRADIANS,
            "to_and_fro": int(s.span < GRADIANS),
        }
