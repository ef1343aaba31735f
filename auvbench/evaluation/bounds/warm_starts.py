"""Commands of controllers in the scenarios of a protocol: where the search starts, and upper bounds themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from auvbench.agents.base import Agent
from auvbench.agents.classical.mpc import MPCController
from auvbench.agents.classical.pid import controller
from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.evaluation.bounds.command_replay import Commands, kept
from auvbench.evaluation.rollout import roll_out
from auvbench.vehicles import sheet

CONTROLLERS = {"pid": controller, "mpc": MPCController, "mpc_tuned": MPCController}
"""By name of the algorithm."""


@dataclass
class WarmStarts:
    """The controllers of one condition.

    Args:
        config: of the condition, with its noise.
        seed: of the scenarios.
        scenarios: test or validation.
    """

    config: schema.TrainConfig
    seed: int
    scenarios: str
    agents: dict[str, Agent] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.vehicle = sheet.load(self.config.vehicle)
        for name, make in CONTROLLERS.items():
            algo = train_config(compose("train", [f"algo={name}"], folder=None)).algo
            self.agents[name] = make(replace(self.config, algo=algo), self.vehicle)

    def commands(self, episode: int) -> Mapping[str, Commands]:
        """Return the commands (T, n_u) that reached the actuators until the episode ended, by controller.

        They include the noise of the protocol: replayed without noise they do what the controller did in the test.
        """
        found = {}
        for name, agent in self.agents.items():
            rollout = roll_out(
                self.config,
                agent,
                episodes=np.array([episode]),
                seed=self.seed,
                batch=1,
                trajectories=1,
                scenarios=self.scenarios,
            )
            found[name] = kept(self.vehicle.action(np.array(rollout.trajectories[episode].command)))
        return found
