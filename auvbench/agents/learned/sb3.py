"""Stable-Baselines3's algorithms as learners, with normalisation, checks for NaN, and bit-identical resumption."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from auvbench.agents.base import Actions, Agent, Callbacks, Components, Integers, Observations
from auvbench.agents.learned import learners, state
from auvbench.agents.learned.trained_policy import FrozenPolicy, LearnedPolicy, Network
from auvbench.config import schema
from auvbench.config.schema import discount
from auvbench.envs.batch import Batch
from auvbench.envs.sb3 import AuvVecEnv
from auvbench.vehicles.vehicle_model import VehicleModel


class SB3Learner:
    """One of Stable-Baselines3's algorithms with the interface of `auvbench.agents.base.Learner`.

    Attributes:
        model: SB3's learner during training; None in a process that only tests.
    """

    exact_resume = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        self._config = config
        self._vehicle = vehicle
        self.model: BaseAlgorithm | None = None
        self._environment: Batch | None = None
        self._tested: Agent | None = None  # agent in the present test

    def reset(self, episodes: Integers) -> None:
        """Begin the episodes (n,) of a test. During training, the test uses the present policy."""
        if self.model is not None:
            self._tested = self._frozen(self.model)
        assert self._tested is not None, "neither trained nor loaded"
        self._tested.reset(episodes)

    def act(self, observation: Observations) -> Actions:
        """Return deterministic actions (n, n_u) with frozen statistics; draws no random number."""
        assert self._tested is not None, "reset comes first"
        if self.model is None:
            return self._tested.act(observation)
        policy = self.model.policy
        training = policy.training
        policy.set_training_mode(False)
        try:
            return self._tested.act(observation)
        finally:
            policy.set_training_mode(training)

    def _frozen(self, model: BaseAlgorithm) -> Agent:
        """Return the policy in training, frozen for a test."""
        normaliser = state.normaliser(model)
        return FrozenPolicy(
            model.policy,
            learners.statistics(normaliser),
            self._config.train.normalise_observations,
            len(self._vehicle.actuators),
        )

    def _faced(self, environment: Batch) -> Any:
        """Return the environment with SB3's interface. Its attribute `transition` is the result of the last step."""
        return AuvVecEnv(environment, detailed=False)

    def learn(self, environment: Batch, config: schema.TrainConfig, callbacks: Callbacks) -> None:
        """Train as `Learner.learn` requires. As in SB3, PPO may exceed the budget by up to one rollout.

        Raises:
            TrainingError: a weight, a loss, an observation or a reward is not finite.
        """
        train = config.train
        self._environment = environment
        face = self._faced(environment)
        normaliser = VecNormalize(
            face,
            norm_obs=train.normalise_observations,
            norm_reward=train.normalise_rewards,
            clip_obs=train.clip_observations,
            clip_reward=train.clip_rewards,
            gamma=discount(config.algo, config.step.frequency),
        )
        self.model = model = learners.make(config, normaliser)
        model.set_logger(Logger(None, [Scalars(callbacks.log)]))
        on_policy = isinstance(model, OnPolicyAlgorithm)
        with learners.diagnosed(model):
            model.learn(
                callbacks.total_steps,
                callback=Follower(lambda: face.transition, callbacks),
                # SB3 counts updates for on-policy algorithms, and episodes for off-policy algorithms.
                log_interval=1 if on_policy else 10,
            )

    def save(self, folder: Path) -> None:
        """Write policy.pt, a plain dictionary of tensors, and normalisation.npz."""
        assert self.model is not None, "nothing was trained"
        for name, data in learners.files(self.model, state.normaliser(self.model)).items():
            (folder / name).write_bytes(data)

    def load(self, folder: Path) -> None:
        """Read the files of `save` without unpickling.

        Raises:
            RunError: a file is missing, damaged, or does not fit the network of the configuration.
        """
        self._tested = LearnedPolicy(self._config, folder, self._vehicle)

    def network(self) -> Network | None:
        """Return the network of the loaded policy; None if its actions also need an LSTM's state or a controller."""
        network: Callable[[], Network | None] | None = getattr(self._tested, "network", None)
        return None if network is None else network()

    @property
    def replay(self) -> ReplayBuffer | None:
        """Return the replay buffer of an off-policy algorithm."""
        return getattr(self.model, "replay_buffer", None)

    def state(self) -> Components:
        """Return networks, optimizers, statistics, counters and generators.

        Raises:
            TrainingError: the weights are not finite, or other code has filled the replay buffer.
        """
        model = self.model
        assert model is not None, "nothing is being trained"
        learners.check_parameters(model)
        if self.replay is not None:
            state.check_replay(self.replay, model.num_timesteps)
        return state.capture(model)

    def restore(self, components: Components) -> None:
        """Restore a checkpoint in a learner whose `learn` is running.

        Raises:
            RunError: the checkpoint belongs to another kind of learner or to other networks.
        """
        assert self.model is not None, "nothing is being trained"
        state.restore(self.model, components, self._restarted())

    def _restarted(self) -> Observations | None:
        """Return the first observations (n, d), as the algorithm sees them, if a resumed run had to restart its
        episodes; else None.
        """
        return None if self._environment is None else self._environment.restarted


class Follower(BaseCallback):
    """Callback that reports the events of SB3's loop to the worker."""

    def __init__(self, transition: Callable[[], Any], callbacks: Callbacks) -> None:
        super().__init__()
        self._transition = transition
        self._callbacks = callbacks

    def _on_training_start(self) -> None:
        # SB3 has already drawn random numbers and set up its state; a checkpoint now replaces this state.
        if self._callbacks.begin():
            self.num_timesteps = self.model.num_timesteps

    def _on_rollout_start(self) -> None:
        # SB3 has stored the last transition and updated the networks, so the state is complete.
        learners.check_losses(self.model)
        if isinstance(self.model, OnPolicyAlgorithm):
            # A long rollout follows, so checking every weight costs little in comparison.
            learners.check_parameters(self.model)
        self._callbacks.checkpoint(self.model.num_timesteps)

    def _on_step(self) -> bool:
        spent = self._callbacks.step(self.num_timesteps, self._transition())
        self.model.start_time += round(spent * 1e9)  # tests must not reduce SB3's steps per second
        return True

    def _on_training_end(self) -> None:
        # If a callback stopped the training within a step, the state is incomplete, so it is not checked.
        if self.model.num_timesteps >= self.model._total_timesteps:
            learners.check_losses(self.model)


class Scalars(KVWriter):
    """Output of SB3's logger that passes every scalar to a function, except scalars that are excluded from "tensorboard"."""

    def __init__(self, log: Callable[[Mapping[str, float], int], object]) -> None:
        self._log = log

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        scalars = {
            key: float(value)
            for key, value in key_values.items()
            if isinstance(value, (bool, int, float, np.number, np.bool_))
            and "tensorboard" not in (key_excluded.get(key) or ())
        }
        self._log(scalars, step)

    def close(self) -> None:
        """Do nothing: there is no file to close."""
