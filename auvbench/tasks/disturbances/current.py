"""A current: a mean that may change with depth, and a fluctuation about it."""

from __future__ import annotations

import math
from typing import Any

from auvbench.config.disturbances import Current
from auvbench.dynamics.random import CURRENT, normal4, uniform4
from auvbench.simulators.base import Simulator
from auvbench.tasks.disturbances.base import Disturbance
from auvbench.tasks.records import Record
from auvbench.tasks.rows import put, row, team_of
from auvbench.vehicles.vehicle_model import VehicleModel

# Blocks of channels within the stream.
_MEAN = 0  # speed, direction
_FLUCTUATION = 1  # three normals per step


@row
def draw(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw the mean current and the stationary fluctuation."""
    share, turn, _, _ = uniform4(e.seed, CURRENT | stream, _MEAN, 0, e.episode, team_of(e.environment))
    speed = p.speed_low + (p.speed_high - p.speed_low) * share
    direction = p.direction_low + (p.direction_high - p.direction_low) * turn
    level = speed * math.cos(p.elevation)
    rise = speed * math.sin(p.elevation)
    put(d.top, (level * math.cos(direction), level * math.sin(direction), rise))
    turned = direction + p.turn
    put(
        d.bottom,
        (p.factor * level * math.cos(turned), p.factor * level * math.sin(turned), p.factor * rise),
    )
    z = normal4(e.seed, CURRENT | stream, _FLUCTUATION, 0, e.episode, team_of(e.environment))
    for axis in range(3):
        d.fluctuation[axis] = p.sigma[axis] * z[axis]


@row
def before(e: Record, d: Record, p: Record, stream: int) -> None:
    """Advance the Gauss-Markov process by one agent step, exactly discretised (Fossen 2021, section 10.3).

    V[k+1] = Vbar + (V[k] - Vbar) e^(-mu dt) + sigma sqrt(1 - e^(-2 mu dt)) N(0, 1); `fluctuation` is V - Vbar.
    """
    if e.steps > 0:  # the fluctuation drawn at the start already has the stationary distribution
        z = normal4(e.seed, CURRENT | stream, _FLUCTUATION, e.steps, e.episode, team_of(e.environment))
        for axis in range(3):
            d.fluctuation[axis] = p.decay * d.fluctuation[axis] + p.innovation * p.sigma[axis] * z[axis]


class WaterCurrent(Disturbance):
    """The current of N episodes."""

    draw = staticmethod(draw)
    before = staticmethod(before)
    fields = (
        ("top", "f8", (3,)),  # m/s, world axes: mean current at the top of the profile
        ("bottom", "f8", (3,)),  # m/s, mean current at the bottom of the profile
        ("fluctuation", "f8", (3,)),  # m/s
    )
    settings: Current

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.moves = self.settings.fluctuates

    def own_parameters(self, settings: Current) -> dict[str, Any]:
        wander, rate = settings.gauss_markov, settings.gauss_markov.mu / self.task.frequency
        directions = (0.0, 2.0 * math.pi) if settings.direction is None else (settings.direction,) * 2
        return {
            "speed_low": settings.speed,
            "speed_high": settings.speed if settings.speed_high is None else settings.speed_high,
            "direction_low": directions[0],
            "direction_high": directions[1],
            "elevation": settings.elevation,
            "sigma": [wander.sigma, wander.sigma, wander.sigma_vertical],
            "decay": math.exp(-rate),
            # 1 - e^(-2 x) without cancellation, for a process that hardly moves in a step.
            "innovation": math.sqrt(-math.expm1(-2.0 * rate)),
            "factor": settings.profile.factor,
            "turn": settings.profile.turn,
        }

    @staticmethod
    def water_speed(settings: Current, vehicle: VehicleModel) -> tuple[float, float]:
        wander, high = settings.gauss_markov, settings.speed_high
        mean = settings.speed if high is None else max(settings.speed, high)
        spread = math.hypot(wander.sigma, wander.sigma, wander.sigma_vertical)
        return max(1.0, abs(settings.profile.factor)) * mean, spread

    def give(self, simulator: Simulator) -> None:
        fluctuation = self.field["fluctuation"]
        top = self.field["top"] + fluctuation
        if not self.settings.sheared:
            simulator.set_current(top)
            return
        depths = self.settings.profile.top, self.settings.profile.bottom
        simulator.set_current(top, self.field["bottom"] + fluctuation, depths)
