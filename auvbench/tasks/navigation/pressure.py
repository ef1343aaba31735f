"""Depth: a pressure sensor's height over the surface, quantised, with the errors of density and air pressure.

The pressure of waves, which falls with depth, looks like a change of depth. The filter knows the variance of this
error, and that the readings within a quarter of a wave period share this error.
"""

from __future__ import annotations

import math

from auvbench.dynamics.layout import Vector
from auvbench.tasks.navigation.state import DEPTH, expect, normals
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row, triple


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the episode."""
    scale, offset, _, _ = normals(e, d, stream, 2)
    d.depth_scale, d.depth_offset = p.depth_density * scale, p.depth_offset * offset
    d.due[DEPTH] = 1.0 / p.depth_rate


@row
def sense(d: Record, p: Record, noise: float, waves: Vector) -> None:
    """Measure the height; `noise` is a standard normal number, `waves` the result of `dynamics.waves.pressure_head`."""
    head, d.wave_variance, frequency = waves
    d.wave_readings = max(1.0, 0.25 * p.depth_rate / frequency) if frequency > 0.0 else 0.0
    _, _, z = triple(d.true_position)
    height = z * (1.0 + d.depth_scale) + d.depth_offset + p.depth_noise * noise - head
    if p.depth_resolution > 0.0:
        height = p.depth_resolution * math.floor(height / p.depth_resolution + 0.5)
    d.height = height
    _, _, d.predicted_height = triple(d.position)
    expect(d, DEPTH, 1.0 / p.depth_rate, p.depth_delay)
