"""Learn residuals: a limited share of a policy's action is added to a classical controller's action.

    action = clip(base + share * residual, -1, 1)

after Johannink et al. 2019 (arXiv:1812.03201) and Silver et al. 2018 (arXiv:1812.06298). The controller gets
the same noisy observation as every agent. The learner gets that observation followed by the controller's
action of this step, to which the learner's action is added. Without the controller's action, the effect of a
residual would depend on the controller's memory, such as PID's integral action, which the learner could not see. This is not an
additional sensor: the controller computes its action only from observations.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from auvbench.agents.base import Actions, Agent, Components, Integers, Observations, make
from auvbench.agents.learned.sb3 import SB3Learner
from auvbench.config import schema
from auvbench.config.algorithms.residual import PPOResidual, SACResidual
from auvbench.envs.batch import Batch, Transition
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.vehicles.vehicle_model import VehicleModel

Arrays = dict[str, NDArray[Any]]

_MEMORY = "residual"
"""name of the controller's arrays in a checkpoint"""


class Base:
    """Classical controller of N vehicles, to which a residual policy adds.

    `extend` appends the controller's action to the observation of the policy. `compose` adds a share of the policy's
    action to the controller's action.

    Raises:
        ConfigError: the controller cannot steer the vehicle, or cannot do the task.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, PPOResidual | SACResidual)
        own = dataclasses.replace(config, algo=algo.residual.base)
        self.share = algo.residual.share
        # The configuration allows only controllers that have the method `memory`.
        self._controller: Any = make(own, vehicle)
        self._beginner: Any = make(own, vehicle)
        self.action: NDArray[np.float64] = np.empty((0, len(vehicle.actuators)))
        """(n, n_u) the controller's actions of this step"""

    def reset(self, n: int) -> None:
        """Begin `n` new episodes, and forget all earlier episodes."""
        self._controller.reset(np.arange(n))
        self.action = np.zeros((n, self.action.shape[1]))

    def extend(self, observation: Observations) -> Observations:
        """Return observations (n, n_obs) with the controller's actions appended, (n, n_obs + n_u)."""
        self.action = np.clip(self._controller.act(observation), -1.0, 1.0)
        return _extended(observation, self.action)

    def begin(self, rows: Integers, observation: Observations) -> Observations:
        """Begin new episodes in the rows (k,). Return their first observations (k, n_obs) with the controller's actions
        appended, (k, n_obs + n_u).
        """
        self._beginner.reset(rows)
        self.action[rows] = np.clip(self._beginner.act(observation), -1.0, 1.0)
        fresh = self._beginner.memory()
        for name, array in self._controller.memory().items():
            array[rows] = fresh[name]
        return _extended(observation, self.action[rows])

    def compose(self, residual: Actions) -> NDArray[np.float64]:
        """Return the vehicle's actions (n, n_u) for residuals (n, n_u) in [-1, 1]."""
        bounded = np.clip(residual.astype(np.float64), -1.0, 1.0)
        return np.clip(self.action + self.share * bounded, -1.0, 1.0)

    def state_dict(self) -> Arrays:
        """Return copies of the arrays that the controller carries from step to step."""
        memory = {**self._controller.memory(), "action": self.action}
        return {name: array.copy() for name, array in memory.items()}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state from `state_dict`."""
        self.reset(len(state["action"]))
        for name, array in {**self._controller.memory(), "action": self.action}.items():
            array[...] = state[name]


def _extended(observation: Observations, action: NDArray[np.float64]) -> Observations:
    return np.concatenate([observation, action.astype(np.float32)], axis=1)


class ResidualVecEnv(VecEnvWrapper):
    """Environments for the learner of a residual: with extended observations, and with residuals as actions."""

    def __init__(self, face: AuvVecEnv, base: Base) -> None:
        space = face.observation_space
        assert isinstance(space, spaces.Box)
        assert face.action_space.shape is not None
        high = np.concatenate([space.high, np.ones(face.action_space.shape, dtype=np.float32)])
        super().__init__(face, spaces.Box(-high, high, dtype=np.float32))
        self.base = base
        self._face = face

    @property
    def transition(self) -> Transition | None:
        """Return the result of the vehicles' last step."""
        return self._face.transition

    def reset(self) -> VecEnvObs:
        observation = self.venv.reset()
        assert isinstance(observation, np.ndarray)
        return self.begin(observation)

    def begin(self, observation: Observations) -> Observations:
        """Begin all episodes; return the first observations (n, n_obs) with the controller's actions appended."""
        self.base.reset(self.num_envs)
        return self.base.extend(observation)

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self.venv.step_async(self.base.compose(actions))

    def step_wait(self) -> VecEnvStepReturn:
        observation, reward, done, infos = self.venv.step_wait()
        assert isinstance(observation, np.ndarray)
        ended = np.flatnonzero(done)
        if not len(ended):
            return self.base.extend(observation), reward, done, infos
        # First extend the last observation of each ended episode; then reset the controller for the next episode.
        last = observation.copy()
        last[ended] = [infos[i]["terminal_observation"] for i in ended]
        extended = self.base.extend(last)
        for i in ended:
            infos[i]["terminal_observation"] = extended[i].copy()
        extended[ended] = self.base.begin(ended, observation[ended])
        return extended, reward, done, infos


class ResidualAgent:
    """Controller and residual policy in a test."""

    def __init__(self, policy: Agent, base: Base) -> None:
        self.policy = policy
        self.base = base

    def reset(self, episodes: Integers) -> None:
        self.policy.reset(episodes)
        self.base.reset(len(episodes))

    def act(self, observation: Observations) -> Actions:
        """Return deterministic actions (n, n_u)."""
        extended = self.base.extend(observation)
        return self.base.compose(self.policy.act(extended))


class ResidualLearner(SB3Learner):
    """SB3 algorithm that learns an addition to a controller's action."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        super().__init__(config, vehicle)
        self._base = Base(config, vehicle)
        self._residual_environment: ResidualVecEnv | None = None

    def _faced(self, environment: Batch) -> ResidualVecEnv:
        self._residual_environment = ResidualVecEnv(AuvVecEnv(environment, detailed=False), self._base)
        return self._residual_environment

    def _frozen(self, model: BaseAlgorithm) -> Agent:
        # The test has its own controller, because the controller in training continues its episodes after the test.
        return ResidualAgent(super()._frozen(model), Base(self._config, self._vehicle))

    def load(self, folder: Path) -> None:
        super().load(folder)
        assert self._tested is not None
        self._tested = ResidualAgent(self._tested, self._base)

    def state(self) -> Components:
        components = super().state()
        components.arrays[_MEMORY] = self._base.state_dict()
        return components

    def restore(self, components: Components) -> None:
        super().restore(components)
        if super()._restarted() is None:
            self._base.load_state_dict(components.arrays[_MEMORY])

    def _restarted(self) -> Observations | None:
        observation = super()._restarted()
        if observation is None or self._residual_environment is None:
            return observation
        return self._residual_environment.begin(observation)
