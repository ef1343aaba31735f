"""Stable-Baselines3's algorithms as learners: normalised, watched for NaN, resumed with the same bits."""

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
from auvbench.envs.sb3 import WaypointVecEnv
from auvbench.vehicles.vehicle_model import VehicleModel


class SB3Learner:
    """One of Stable-Baselines3's algorithms behind the contract of `auvbench.agents.base.Learner`.

    Attributes:
        model: SB3's learner while it trains; None in a process that only tests.
    """

    exact_resume = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        self._config = config
        self._vehicle = vehicle
        self.model: BaseAlgorithm | None = None
        self._environment: Batch | None = None
        self._tested: Agent | None = None  # in the tests of now

    def reset(self, episodes: Integers) -> None:
        """Begin episodes (n,). During training, the policy of this moment acts in them."""
        if self.model is not None:
            self._tested = self._frozen(self.model)
        assert self._tested is not None, "neither trained nor loaded"
        self._tested.reset(episodes)

    def act(self, observation: Observations) -> Actions:
        """Return deterministic actions (n, n_u) with frozen statistics; no random number is drawn."""
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
        """Return the policy that is being trained, frozen for a test."""
        normaliser = state.normaliser(model)
        return FrozenPolicy(
            model.policy,
            learners.statistics(normaliser),
            self._config.train.normalise_observations,
            len(self._vehicle.actuators),
        )

    def _faced(self, environment: Batch) -> Any:
        """Return the environment as SB3 expects it; its `transition` is the result of its last step."""
        return WaypointVecEnv(environment, detailed=False)

    def learn(self, environment: Batch, config: schema.TrainConfig, callbacks: Callbacks) -> None:
        """Train as the contract says; PPO may exceed the budget by up to a rollout, as SB3 does.

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
                log_interval=1 if on_policy else 10,  # every update; off-policy, SB3 counts episodes there
            )

    def save(self, folder: Path) -> None:
        """Write policy.pt, a plain dictionary of tensors, and normalisation.npz."""
        assert self.model is not None, "nothing was trained"
        for name, data in learners.files(self.model, state.normaliser(self.model)).items():
            (folder / name).write_bytes(data)

    def load(self, folder: Path) -> None:
        """Read both without unpickling.

        Raises:
            RunError: they are missing, damaged, or of another network than the configuration's.
        """
        self._tested = LearnedPolicy(self._config, folder, self._vehicle)

    def network(self) -> Network | None:
        """Return the loaded policy as a network by itself; None where its actions are more than that (see `FrozenPolicy`)."""
        found: Callable[[], Network | None] | None = getattr(self._tested, "network", None)
        return None if found is None else found()

    @property
    def replay(self) -> ReplayBuffer | None:
        """The replay buffer of an off-policy algorithm."""
        return getattr(self.model, "replay_buffer", None)

    def state(self) -> Components:
        """Networks, optimizers, statistics, counters, generators.

        Raises:
            TrainingError: the weights are not finite, or something else filled the replay buffer.
        """
        model = self.model
        assert model is not None, "nothing is being trained"
        learners.check_parameters(model)
        if self.replay is not None:
            state.check_replay(self.replay, model.num_timesteps)
        return state.capture(model)

    def restore(self, components: Components) -> None:
        """Put a checkpoint into the learner, which has begun `learn`.

        Raises:
            RunError: it is of another kind of learner or of other networks.
        """
        assert self.model is not None, "nothing is being trained"
        state.restore(self.model, components, self._restarted())

    def _restarted(self) -> Observations | None:
        """First observations, as the algorithm sees them, of episodes that a resumed run had to begin again."""
        return None if self._environment is None else self._environment.restarted


class Follower(BaseCallback):
    """Report to the worker what SB3's loop does."""

    def __init__(self, transition: Callable[[], Any], callbacks: Callbacks) -> None:
        super().__init__()
        self._transition = transition
        self._callbacks = callbacks

    def _on_training_start(self) -> None:
        # By now building the learner and `learn` have drawn and set up what a checkpoint replaces.
        if self._callbacks.begin():
            self.num_timesteps = self.model.num_timesteps

    def _on_rollout_start(self) -> None:
        # The last transition is stored and the networks are updated.
        learners.check_losses(self.model)
        if isinstance(self.model, OnPolicyAlgorithm):
            # A rollout of many steps follows, so checking every weight costs nothing in comparison.
            learners.check_parameters(self.model)
        self._callbacks.checkpoint(self.model.num_timesteps)

    def _on_step(self) -> bool:
        spent = self._callbacks.step(self.num_timesteps, self._transition())
        self.model.start_time += round(spent * 1e9)  # steps per second are those of training alone
        return True

    def _on_training_end(self) -> None:
        # A callback that returned False ended training in the middle of a step, where nothing is whole.
        if self.model.num_timesteps >= self.model._total_timesteps:
            learners.check_losses(self.model)


class Scalars(KVWriter):
    """An output of SB3's logger that hands every scalar which is not excluded from "tensorboard" to a function."""

    def __init__(self, log: Callable[[Mapping[str, float], int], object]) -> None:
        self._log = log

    def write(
        self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0
    ) -> None:
        kept = {
            key: float(value)
            for key, value in key_values.items()
            if isinstance(value, (bool, int, float, np.number, np.bool_))
            and "tensorboard" not in (key_excluded.get(key) or ())
        }
        self._log(kept, step)

    def close(self) -> None:
        """Do nothing: it owns no file."""
