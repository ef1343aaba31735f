"""What every agent offers, and the registry of those there are."""

from __future__ import annotations

import importlib
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Observations = NDArray[np.float32]
Actions = NDArray[np.floating]

LEARNERS: dict[str, str] = {
    "ppo": "stable_baselines3:PPO",
    "sac": "stable_baselines3:SAC",
    "ddpg": "stable_baselines3:DDPG",
    "td3": "stable_baselines3:TD3",
}
CONTROLLERS: dict[str, str] = {
    "pid": "auvbench.agents.classical.pid:controller",
    "lqr": "auvbench.agents.classical.lqr:LQRController",
    "smc": "auvbench.agents.classical.smc:SMCController",
    "mpc": "auvbench.agents.classical.mpc:MPCController",
    "random": "auvbench.agents.classical.random:RandomAgent",
}


class Agent(Protocol):
    """A controller in a test: acts on a batch of observations."""

    def reset(self, episodes: Integers) -> None:
        """Forgets everything: the given episodes (n,) begin, one per row."""

    def act(self, observation: Observations) -> Actions:
        """Actions (n, n_u) in [-1, 1] for observations (n, 4 + n_u)."""


def resolve(target: str) -> Any:
    """The object that a registry's "module:name" stands for."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def learns(agent: str) -> bool:
    """Whether an agent has anything to learn."""
    return agent in LEARNERS
