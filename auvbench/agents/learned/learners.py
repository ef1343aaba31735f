"""SB3's learners: made from the configuration, their policies read back as plain weights."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from auvbench.agents.base import Actions, Integers, Observations, resolve
from auvbench.agents.learned import arguments, forward, policy_loading
from auvbench.config import algorithms, schema
from auvbench.config.agents import AGENTS
from auvbench.errors import RunError
from auvbench.tasks.observation import observation_spec
from auvbench.untrusted import reading
from auvbench.vehicles.vehicle_model import VehicleModel

WEIGHTS, STATISTICS = "policy.pt", "normalisation.npz"
"""The files of a trained model."""


def make(config: schema.TrainConfig, environment: VecEnv) -> BaseAlgorithm:
    """The SB3 learner that `config.algo` describes, on an environment. One torch thread."""
    torch.set_num_threads(1)
    learner: BaseAlgorithm = resolve(AGENTS[config.algo.agent].algorithm)(
        **arguments.of_learner(config, environment)
    )
    return learner


def observed(config: schema.TrainConfig, vehicle: VehicleModel) -> int:
    """Return how many numbers a learner observes: that of a residual PID's action, too."""
    residual = isinstance(config.algo, algorithms.PPOResidual | algorithms.SACResidual)
    n_u = len(vehicle.actuators)
    return observation_spec(config.task, vehicle.actuators).size + (n_u if residual else 0)


def files(model: BaseAlgorithm, normaliser: VecNormalize) -> dict[str, bytes]:
    """What a run keeps of a trained model, by the file's name: a plain dictionary of tensors, and the statistics."""
    weights, arrays = io.BytesIO(), io.BytesIO()
    torch.save(dict(model.policy.state_dict()), weights)
    np.savez(arrays, **statistics(normaliser))  # type: ignore[arg-type]
    return {WEIGHTS: weights.getvalue(), STATISTICS: arrays.getvalue()}


def statistics(normaliser: VecNormalize) -> dict[str, NDArray[np.float64]]:
    """Running statistics of observations and returns as plain arrays; mean 0 and variance 1 where none are kept."""
    returns = normaliser.ret_rms
    observations = RunningMeanStd(shape=normaliser.observation_space.shape or ())
    if normaliser.norm_obs:
        assert isinstance(normaliser.obs_rms, RunningMeanStd)
        observations = normaliser.obs_rms
    return {
        "observation_mean": np.asarray(observations.mean, dtype=np.float64),
        "observation_variance": np.asarray(observations.var, dtype=np.float64),
        "observation_count": np.asarray(observations.count, dtype=np.float64),
        "return_mean": np.asarray(returns.mean, dtype=np.float64),
        "return_variance": np.asarray(returns.var, dtype=np.float64),
        "return_count": np.asarray(returns.count, dtype=np.float64),
        "epsilon": np.asarray(normaliser.epsilon, dtype=np.float64),
        "clip_observations": np.asarray(normaliser.clip_obs, dtype=np.float64),
    }


Scaling = tuple[NDArray[np.float64], NDArray[np.float64], float]
Network = tuple[BasePolicy, Scaling | None]
"""A policy, and mean, scale and clip of its observations"""


class FrozenPolicy:
    """A policy as it is now, in a test: deterministic, with the statistics of its observations frozen.

    Draws no random number and changes nothing of the policy, so that one that is being trained may be tested.

    Args:
        policy: the network; out of training mode.
        arrays: statistics of the observations, as `statistics` gives them.
        normalise: whether the policy was trained on normalised observations.
        n_u: actuators of the vehicle.
    """

    def __init__(
        self, policy: BasePolicy, arrays: Mapping[str, NDArray[np.float64]], normalise: bool, n_u: int
    ) -> None:
        self.policy = policy
        self._forward = forward.of(policy)
        self._normalise = normalise
        self._mean = np.array(arrays["observation_mean"])
        self._scale = np.sqrt(arrays["observation_variance"] + arrays["epsilon"])
        self._clip = float(arrays["clip_observations"])
        self._n_u = n_u

    def reset(self, episodes: Integers) -> None:
        self._forward.reset(len(episodes))

    def network(self) -> Network | None:
        """What `act` computes, where it is a function of the present observation; None of a policy that keeps a state."""
        if type(self._forward) is not forward.Forward:
            return None
        return self.policy, (self._mean, self._scale, self._clip) if self._normalise else None

    def act(self, observation: Observations) -> Actions:
        """Deterministic actions (n, n_u)."""
        if self._normalise:
            scaled = (observation - self._mean) / self._scale
            observation = np.clip(scaled, -self._clip, self._clip).astype(np.float32)
        action = np.empty((len(observation), self._n_u), dtype=np.float32)
        rows = np.zeros((forward.ROWS, observation.shape[1]), dtype=np.float32)
        with torch.no_grad():
            for start in range(0, len(observation), forward.ROWS):
                part = observation[start : start + forward.ROWS]
                rows[: len(part)] = part
                output = self._forward(start // forward.ROWS, torch.from_numpy(rows))
                action[start : start + len(part)] = output.numpy()[: len(part)]
        return np.clip(action, -1.0, 1.0)


class LearnedPolicy(FrozenPolicy):
    """A trained policy in a test: its weights and statistics read without unpickling.

    Args:
        config: of the run that trained it.
        folder: its `model/` folder.
        vehicle: that it steers.
        check: called with the name and the content of each file before anything is made of it; raises where
            that is not what was written.

    Raises:
        RunError: the files are missing, damaged, or of another network than the configuration's.
    """

    def __init__(
        self,
        config: schema.TrainConfig,
        folder: Path,
        vehicle: VehicleModel,
        check: Callable[[str, bytes], None] | None = None,
    ) -> None:
        torch.set_num_threads(1)
        policy = _policy(config, vehicle)
        weights = policy_loading.weights(
            _read(folder / WEIGHTS, check), folder / WEIGHTS, policy.state_dict()
        )
        kept = policy_loading.statistics(
            _read(folder / STATISTICS, check), folder / STATISTICS, observed(config, vehicle)
        )
        policy.load_state_dict(weights)
        policy.set_training_mode(False)
        super().__init__(policy, kept, config.train.normalise_observations, len(vehicle.actuators))


def _read(path: Path, check: Callable[[str, bytes], None] | None) -> bytes:
    try:
        data = reading.content(path, reading.WEIGHTS)
    except FileNotFoundError as error:
        raise RunError(f"{path.parent}: no trained model here ({path.name} is missing)") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if check is not None:
        check(path.name, data)
    return data


def _policy(config: schema.TrainConfig, vehicle: VehicleModel) -> BasePolicy:
    """The network of `config.algo` without an environment or a learner around it."""
    algo = config.algo
    observation_space = spaces.Box(-np.inf, np.inf, (observed(config, vehicle),), dtype=np.float32)
    action_space = spaces.Box(-1.0, 1.0, (len(vehicle.actuators),), dtype=np.float32)
    learner = resolve(AGENTS[algo.agent].algorithm)
    kind = learner.policy_aliases[arguments.policy_name(algo)]
    given = arguments.of_policy(algo)
    if algo.agent == "ddpg":
        given["n_critics"] = 1
    policy: BasePolicy = kind(observation_space, action_space, lambda _: 0.0, **given)
    return policy
