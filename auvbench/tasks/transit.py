"""Transit: reach a point, in a field of obstacles by default (docs/transit.md)."""

from __future__ import annotations

import math

from auvbench.tasks import fingerprint
from auvbench.tasks.base import Task
from auvbench.tasks.records import Record
from auvbench.tasks.rows import SUCCESS, arrival, drawn, put, row, triple, wrap

SLOWEST, FASTEST = 8.0, 2.0
"""Times between which the score of the BARN challenge decreases, as multiples of the time for the shortest way (Xiao et al.,
"Autonomous ground navigation in highly constrained spaces", IEEE Robotics and Automation Magazine 29(4), 2022)"""


@row
def draw(e: Record, p: Record, stream: int) -> float:
    """Draw the goal and the yaw at the start; return the yaw."""
    heading, bearing, far, high = drawn(e, stream, 0)
    x, y, z = triple(p.start)
    put(e.start, (x, y, z))
    distance = p.distance_low + (p.distance_high - p.distance_low) * far
    rise = p.rise * (2.0 * high - 1.0)
    level = math.sqrt(distance * distance - rise * rise)
    angle = 2.0 * math.pi * bearing
    put(e.reference, (x + level * math.cos(angle), y + level * math.sin(angle), z + rise))
    return wrap(2.0 * math.pi * heading)


class TransitTask(Task):
    """N episodes of transit."""

    draw = staticmethod(draw)
    step = staticmethod(arrival)
    reference_columns = fingerprint.COLUMNS
    reference_blocks = tuple(name for name in fingerprint.BLOCKS if name != "velocity_error")
    reference_key = "goal"

    def own_metrics(self, i: int) -> dict[str, float]:
        e = self.episodes[i]
        points = {"start": e.start.tolist(), "goal": self.goal(i).tolist()}
        ratio = float(e.way_ratio) if "way_ratio" in self.episodes.dtype.names else 1.0
        best = ratio * float(e.initial_distance) / float(self.parameters[0].speed)
        time = float(e.steps) * self.duration
        reached = float(e.outcome == SUCCESS)
        return {
            **{
                f"{name}_{axis}_m": value
                for name, point in points.items()
                for axis, value in zip("xyz", point, strict=True)
            },
            "barn_score": reached * best / min(max(time, FASTEST * best), SLOWEST * best),
        }
