"""Heading: a compass with a constant error, hard iron (one cycle per turn), soft iron (two cycles per turn) and noise.

The electric current of the thrusters adds an error with one cycle per turn and another phase. The filter knows the amplitude of this error.
"""

from __future__ import annotations

import math

from auvbench.dynamics.layout import Quaternion
from auvbench.tasks.navigation.state import HEADING, expect, normals, uniforms
from auvbench.tasks.navigation.turns import attitude_of
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row, wrap

VOLTAGE = 16.0
"""Supply voltage at which the power of the thrusters was measured, V"""


@row
def begin(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the errors of the episode."""
    bias, hard, soft, _ = normals(e, d, stream, 3)
    hard_phase, soft_phase, thruster_phase, _ = uniforms(e, d, stream, 4)
    d.heading_bias = p.heading_bias * bias
    d.hard_iron, d.hard_iron_phase = p.heading_hard_iron * hard, 2.0 * math.pi * hard_phase
    d.soft_iron, d.soft_iron_phase = p.heading_soft_iron * soft, 2.0 * math.pi * soft_phase
    d.thruster_iron, d.thruster_phase = 0.0, 2.0 * math.pi * thruster_phase
    d.due[HEADING] = 1.0 / p.heading_rate


@row
def yaw_of(q: Quaternion) -> float:
    """Return the yaw of an attitude in rad."""
    w, x, y, z = q
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@row
def measured(d: Record, p: Record, yaw: float, noise: float) -> float:
    """Return the compass's reading in rad at a yaw in rad; `noise` is a standard normal number."""
    error = d.heading_bias + p.heading_noise * noise
    error += d.thruster_iron * math.cos(yaw + d.thruster_phase)
    error += d.hard_iron * math.cos(yaw + d.hard_iron_phase)
    error += d.soft_iron * math.cos(2.0 * yaw + d.soft_iron_phase)
    return wrap(yaw + error)


@row
def sense(d: Record, p: Record, noise: float, power: float) -> None:
    """Measure the heading; `noise` is a standard normal number, `power` the thrusters' power in W."""
    d.thruster_iron = p.heading_thrusters * power / VOLTAGE
    d.heading = measured(d, p, yaw_of(attitude_of(d.true_attitude)), noise)
    d.predicted_heading = yaw_of(attitude_of(d.attitude)) + d.bias
    expect(d, HEADING, 1.0 / p.heading_rate, p.heading_delay)
