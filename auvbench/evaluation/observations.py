"""Observations on which a policy's file is tried: of real episodes, and from the edges of what can be observed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Agent, Observations
from auvbench.config import schema
from auvbench.config.simulators import Fossen
from auvbench.envs.spaces import observation_bounds
from auvbench.evaluation.rollout import batch_of
from auvbench.vehicles import sheet

EPISODES = 64
SEED = 0
CORNERS = 256


def of_episodes(
    config: schema.TrainConfig, agent: Agent, steps: int, scenarios: str = "test"
) -> Observations:
    """What an agent observes in the first `steps` steps of `EPISODES` episodes, (steps EPISODES, 4 + n_u).

    On the embedded simulator, whatever that of the configuration.

    Raises:
        ActionError: the agent's actions are none.
    """
    embedded = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
    batch = batch_of(scenarios, embedded, EPISODES, SEED)
    batch.task.assign(np.arange(EPISODES))
    observation = batch.reset()
    agent.reset(np.arange(EPISODES))
    seen = []
    for _ in range(steps):
        seen.append(observation.copy())
        observation = batch.step(agent.act(observation)).observation
    return np.concatenate(seen)


def of_edges(config: schema.TrainConfig) -> Observations:
    """The middle of the observation space, its bounds one by one and all at once, and random places between, (m, 4 + n_u)."""
    high = observation_bounds(config, sheet.load(config.vehicle)).astype(np.float64)
    n = len(high)
    rng = np.random.default_rng(0)
    corners = rng.choice([-1.0, 1.0], size=(CORNERS, n))
    between = rng.uniform(-1.0, 1.0, size=(CORNERS, n))
    singles = np.concatenate([np.eye(n), -np.eye(n)])
    points: NDArray[np.float64] = np.concatenate([np.zeros((1, n)), singles, corners, between])
    return (points * high).astype(np.float32)
