"""Errors of the readings of position and yaw: a constant bias, a random walk, and independent noise at each step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import Sensor
from auvbench.dynamics.random import BIAS, DRIFT, SENSOR, normal4
from auvbench.tasks.disturbances.base import Disturbance
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row

_GAUSSIAN = 1  # block of channels in SENSOR: block 0 is the task's uniform noise


@row
def draw(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the bias."""
    z = normal4(e.seed, BIAS | stream, 0, 0, e.episode, e.environment)
    for channel in range(4):
        d.bias[channel] = p.bias[channel] * z[channel]


@row
def read(e: Record, d: Record, p: Record, stream: int, offset: Any) -> None:
    """Advance the random walk by one agent step, with increments of variance drift^2 dt, and add the errors to `offset`."""
    if p.drifts > 0 and e.steps > 0:
        z = normal4(e.seed, DRIFT | stream, 0, e.steps, e.episode, e.environment)
        for channel in range(4):
            d.drift[channel] += p.step_drift[channel] * z[channel]
    for channel in range(4):
        offset[channel] += d.bias[channel] + d.drift[channel]
    if p.noisy > 0:
        z = normal4(e.seed, SENSOR | stream, _GAUSSIAN, e.steps, e.episode, e.environment)
        for channel in range(4):
            offset[channel] += p.gaussian[channel] * z[channel]


class SensorError(Disturbance):
    """The errors of the readings of N episodes."""

    draw = staticmethod(draw)
    read = staticmethod(read)
    fields = (
        ("bias", "f8", (4,)),  # x, y, z in m, yaw in rad
        ("drift", "f8", (4,)),
    )

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.rereads = bool(self.parameters.drifts[0] or self.parameters.noisy[0])

    def own_parameters(self, settings: Sensor) -> dict[str, Any]:
        gaussian, drift = settings.gaussian.values(), settings.drift.values()
        return {
            "gaussian": gaussian,
            "bias": settings.bias.values(),
            "step_drift": [value / math.sqrt(self.task.frequency) for value in drift],
            "noisy": any(value > 0.0 for value in gaussian),
            "drifts": any(value > 0.0 for value in drift),
        }

    @staticmethod
    def misreading(settings: Sensor, seconds: float) -> NDArray[np.float64]:
        errors = [
            math.hypot(getattr(settings.gaussian, axis), getattr(settings.bias, axis))
            + getattr(settings.drift, axis) * math.sqrt(seconds)
            for axis in "xyz"
        ]
        return np.asarray(errors)
