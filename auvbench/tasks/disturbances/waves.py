"""The waves of N episodes: each episode's key determines directions and phases, and its step count determines the time."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import Waves
from auvbench.dynamics import waves
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.layout import COMPONENT, LANES
from auvbench.dynamics.random import WAVES, uniform
from auvbench.simulators.base import Simulator, WavySimulator
from auvbench.tasks.disturbances.base import Disturbance
from auvbench.tasks.rows import team_of
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_PHASES = 4  # first channel; channel 0 is the direction
_ANGLES = _PHASES + waves.COMPONENTS
_QUANTILES = 1025


class Sea(Disturbance):
    """Waves of N episodes. They are a function of the episodes' keys and steps, so that an exact resume needs no further state."""

    runs_on = True
    settings: Waves

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.waves = waves.on(_components(self.settings, self.vehicle), self.task.n)
        self._quantiles = spread(self.settings.spreading)
        self.moves = True

    def own_parameters(self, settings: Waves) -> dict[str, Any]:
        low, high = (0.0, 2.0 * math.pi) if settings.direction is None else (settings.direction,) * 2
        return {"direction_low": low, "direction_high": high}

    @staticmethod
    def water_speed(settings: Waves, vehicle: VehicleModel) -> tuple[float, float]:
        # At the surface, a component moves the water both horizontally and vertically, each with the amplitude `speed`.
        return 0.0, math.hypot(*_components(settings, vehicle).reshape(-1).view(COMPONENT)["speed"])

    def draw_rows(self, indices: Integers) -> None:
        task = self.task
        _, parameters = self._own
        draw_rays(indices, task.rows, parameters, self._quantiles, task.stream, self.waves.rays)

    def give(self, simulator: Simulator) -> None:
        """Set the simulator's waves to the start of the next agent step."""
        self.waves.time[:] = self.task.episodes.steps * self.task.duration
        # A configuration with waves always has a WavySimulator.
        cast(WavySimulator, simulator).set_waves(self.waves)

    def restored(self) -> None:
        self.draw_rows(np.arange(self.task.n))


def _components(config: Waves, vehicle: VehicleModel) -> Floats:
    return waves.components(config.height, config.period, config.spectrum, vehicle.gravity)


def spread(exponent: float | None) -> Floats:
    """Return equally spaced quantiles in rad of a wave's angle to the main direction; the angle's density is cos^n (DNV-RP-C205, 3.5.8).

    Args:
        exponent: n; None: long crests, all angles are 0.
    """
    if exponent is None:
        return np.zeros(2)
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 20_001)
    below = np.cumsum(np.cos(angle) ** exponent)
    half = 0.5 / _QUANTILES  # leaves out the extreme quantiles 0 and 1
    return np.interp(np.linspace(half, 1.0 - half, _QUANTILES), below / below[-1], angle)


@compiled("dynamics", "tasks")
def draw_rays(
    indices: Integers, episodes: Any, parameters: Any, quantiles: Floats, test: int, rays: Floats
) -> None:
    """Draw directions and phases of new episodes into `rays` (blocks, m, 3, LANES)."""
    p = parameters[0]
    last = quantiles.shape[0] - 1
    for k in range(indices.shape[0]):
        i = indices[k]
        block, lane = i // LANES, i % LANES
        e = episodes[i]
        seed, episode, environment = e.seed, e.episode, team_of(e.environment)
        share = uniform(seed, WAVES | test, 0, 0, episode, environment)
        direction = p.direction_low + (p.direction_high - p.direction_low) * share
        for m in range(rays.shape[1]):
            place = last * uniform(seed, WAVES | test, _ANGLES + m, 0, episode, environment)
            j = min(int(place), last - 1)
            above = j + 1
            angle = direction + quantiles[j] + (place - j) * (quantiles[above] - quantiles[j])
            rays[block, m, waves.COSINE, lane] = math.cos(angle)
            rays[block, m, waves.SINE, lane] = math.sin(angle)
            rays[block, m, waves.PHASE, lane] = uniform(
                seed, WAVES | test, _PHASES + m, 0, episode, environment
            )
