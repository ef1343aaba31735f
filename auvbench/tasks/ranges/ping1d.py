"""A Ping1D echo sounder: the nearest echo in a cone, with a confidence.

Confidence, noise and jumps come from 15 Hz recordings of the Seattle Aquarium's vehicle. 6 % of the pings have confidence 0, 14 % a
confidence below 50 % and 81 % a confidence of 100 %. The noise is 2 mm. 1.2 % of the pings jump by more than 1 m; of the pings with a
confidence of at least 80 %, 0.2 % jump. The recordings do not show where a jump leads. Here it leads anywhere from the shortest range to
twice the distance, which is the second echo.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from auvbench.config.ranges import oldest
from auvbench.tasks.ranges.base import (
    Floats,
    RangeSensor,
    Scene,
    arrived,
    distance_along,
    draws,
    keep,
    new_step,
    normal,
    pings_until,
)
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row

# Shares of the pings that have an echo.
WEAK = 0.08 / 0.94
"""Share of pings with a confidence below 50 %"""
FAIR = 0.05 / 0.94
"""Share of pings with a confidence from 50 % to 100 %"""
SURE = 0.8
"""Confidence from which jumps are rare"""
SURE_JUMPS = 0.2 / 1.2
"""Jump rate of pings with a confidence of at least SURE, relative to the jump rate of all pings"""
SURE_SHARE = 0.81 + 0.05 * (1.0 - SURE) / 0.5
UNSURE_SHARE = 0.94 - SURE_SHARE
UNSURE_JUMPS = (1.0 - SURE_JUMPS * SURE_SHARE) / UNSURE_SHARE

INNER, OUTER = 6, 12
"""Number of rays on the ring at half of the cone's half angle, and on the ring at the whole half angle"""


@row
def measure(e: Record, memory: Floats, p: Record, scene: Scene, true: float) -> None:
    """Write distance and confidence of a ping whose nearest echo is `true` m away. Without an echo, write only the confidence 0."""
    lost, grade, depth, jumps = draws(e, p, scene.stream, 0)
    u, v, place, _ = draws(e, p, scene.stream, 1)
    if true >= p.high or lost < p.dropout:
        memory[1] = 0.0
        return
    confidence = 1.0
    if grade < WEAK:
        confidence = 0.5 * depth
    elif grade < WEAK + FAIR:
        confidence = 0.5 + 0.5 * depth
    distance = true + p.noise * normal(u, v)
    if jumps < p.jumps * (SURE_JUMPS if confidence >= SURE else UNSURE_JUMPS):
        distance = p.low + place * max(2.0 * true - p.low, 0.0)
    memory[0] = min(max(distance, p.low), p.high)
    memory[1] = 0.0 if true < p.low else confidence


@row
def sense(e: Record, d: Record, memory: Floats, p: Record, rays: Any, scene: Scene, out: Any) -> None:
    """Write distance, confidence and age of the last ping that has arrived."""
    if new_step(e, d):
        pings = pings_until(e.steps, p)
        if e.steps == 0:
            memory[0] = p.high
        if e.steps == 0 or pings > pings_until(e.steps - 1, p):
            measure(
                e, memory, p, scene, distance_along(scene, scene.rotation, rays, 0, rays.shape[0], p.high)
            )
            memory[2] = e.steps * p.duration
        keep(e, p, memory)
    out[0], out[1] = arrived(e, p, memory, 0), arrived(e, p, memory, 1)
    out[2] = min(e.steps * p.duration - arrived(e, p, memory, 2), p.oldest)


class EchoSounder(RangeSensor):
    """Echo sounder whose cone is sampled by one ray along the axis and two rings of rays."""

    sense = staticmethod(sense)

    def directions(self) -> Floats:
        half = 0.5 * self.settings.beam
        rings = [(0.0, 1), (0.5 * half, INNER), (half, OUTER)]
        off = np.concatenate([np.full(count, angle) for angle, count in rings])
        around = np.concatenate([2.0 * math.pi * np.arange(count) / count for _, count in rings])
        return np.stack([np.cos(off), np.sin(off) * np.cos(around), np.sin(off) * np.sin(around)], axis=1)

    def size(self) -> int:
        return 3  # distance in m, confidence, time of the ping in s

    def more(self) -> dict[str, Any]:
        s = self.settings
        return {"period": 1.0 / s.rate, "oldest": oldest(s)}
