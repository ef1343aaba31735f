"""Act randomly, uniform in [-1, 1]: the lowest baseline of every table."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.config import schema
from auvbench.dynamics.compiled import compiled
from auvbench.dynamics.random import uniform
from auvbench.vehicles.vehicle_model import VehicleModel

# Random stream of the actions, in addition to the streams in dynamics/random.py.
ACTION = 0x80


@compiled("dynamics")
def _draw(seed: int, step: int, episodes: Integers, action: NDArray[np.float64]) -> None:
    for i in range(action.shape[0]):
        for j in range(action.shape[1]):
            action[i, j] = 2.0 * uniform(seed, ACTION, j, step, episodes[i], 0) - 1.0


class RandomAgent:
    """Agent whose actions in episode e at step t are drawn from (seed, e, t), so that they are the same
    for every batch size.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        self._seed = config.seed
        self._n_u = len(vehicle.actuators)
        self._step = 0
        self._episodes: Integers = np.empty(0, dtype=np.int64)

    def reset(self, episodes: Integers) -> None:
        self._step = 0
        self._episodes = episodes

    def act(self, observation: Observations) -> Actions:
        action = np.empty((len(observation), self._n_u))
        _draw(self._seed, self._step, self._episodes, action)
        self._step += 1
        return action
