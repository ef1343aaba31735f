"""How the PID controller drives there without noise: one more place to begin the search, and a bound by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.pid import controller
from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.evaluation.bounds.trial import Commands, kept, silent
from auvbench.evaluation.rollout import batch_of


def drive(
    config: schema.TrainConfig, episodes: NDArray[np.int64], seed: int, scenarios: str
) -> Sequence[Commands]:
    """Commands (T, n_u) of each episode (n,), to its end."""
    pid = train_config(compose("train", ["algo=pid"], folder=None)).algo
    config = replace(silent(config), algo=pid)
    batch = batch_of(scenarios, config, len(episodes), seed)
    agent = controller(config, batch.vehicle)
    batch.task.assign(episodes)
    observation = batch.reset()
    agent.reset(episodes)
    given: list[NDArray[np.int8]] = []
    length = np.zeros(len(episodes), dtype=np.int64)
    while not length.all():
        action = agent.act(observation)
        given.append(kept(np.asarray(action, dtype=np.float64)))
        transition = batch.step(given[-1] / 127.0)
        observation = transition.observation
        ended = transition.ended[length[transition.ended] == 0]
        length[ended] = len(given)
    all_given = np.array(given)
    return [all_given[: length[i], i] for i in range(len(episodes))]
