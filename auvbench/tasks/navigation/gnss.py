"""GNSS: horizontal positions at the surface; radio waves do not reach an antenna below it."""

from __future__ import annotations

from auvbench.tasks.navigation.state import GNSS, NEVER, expect, normals
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row, triple


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the episode."""
    if p.has_gnss == 0:
        return
    east, north, _, _ = normals(e, d, stream, 20)
    d.gnss_offset[0], d.gnss_offset[1] = p.gnss_offset * east, p.gnss_offset * north
    d.due[GNSS] = 1.0 / p.gnss_rate


@row
def sense(e: Record, d: Record, p: Record, stream: int) -> bool:
    """Measure the position; return whether the antenna is at the surface."""
    a, b, _, _ = normals(e, d, stream, 21)
    x, y, z = triple(d.true_position)
    expect(d, GNSS, 1.0 / p.gnss_rate, 0.0)
    d.arrives[GNSS] = NEVER  # A position arrives at once or not at all.
    if -z > p.gnss_depth:
        return False
    east, north = d.gnss_offset
    d.gnss_fix[0] = x + east + p.gnss_noise * a
    d.gnss_fix[1] = y + north + p.gnss_noise * b
    return True
