"""SB3's learners: made from the configuration, their policies read back as plain weights."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from auvbench.agents.base import LEARNERS, Actions, Integers, Observations, resolve
from auvbench.agents.learned import trained
from auvbench.config import algorithms, schema
from auvbench.config.clock import discount
from auvbench.errors import RunError
from auvbench.untrusted import archives, reading

ACTIVATIONS = {
    "tanh": torch.nn.Tanh,
    "relu": torch.nn.ReLU,
    "elu": torch.nn.ELU,
    "silu": torch.nn.SiLU,
}

WEIGHTS, STATISTICS = "policy.pt", "normalisation.npz"
"""The files of a trained model."""

# The policy's forward pass always runs on this many rows: matrix products of another shape may round
# differently, and a row of a table must not depend on how many episodes were tested together.
FORWARD_ROWS = 64


def make(config: schema.TrainConfig, environment: VecEnv) -> BaseAlgorithm:
    """The SB3 learner that `config.algo` describes, on an environment. One torch thread."""
    torch.set_num_threads(1)
    algo = config.algo
    arguments: dict[str, Any] = {
        "policy": "MlpPolicy",
        "env": environment,
        "learning_rate": _learning_rate(algo),
        "batch_size": algo.batch_size,
        "gamma": discount(algo, config.step.frequency),
        "policy_kwargs": _policy_arguments(algo),
        "seed": config.seed,
        "device": "cpu",
        "verbose": 0,
    }
    if isinstance(algo, algorithms.PPO):
        arguments |= {
            "n_steps": algo.n_steps,
            "n_epochs": algo.n_epochs,
            "gae_lambda": algo.gae_lambda,
            "clip_range": algo.clip_range,
            "normalize_advantage": algo.normalize_advantage,
            "ent_coef": algo.ent_coef,
            "vf_coef": algo.vf_coef,
            "max_grad_norm": algo.max_grad_norm,
        }
    else:
        assert isinstance(algo, algorithms.OffPolicy)
        arguments |= {
            "buffer_size": algo.buffer_size,
            "learning_starts": algo.learning_starts,
            "tau": algo.tau,
            "train_freq": (algo.train_freq, "step"),
            "gradient_steps": algo.gradient_steps,
        }
        arguments |= _off_policy_arguments(algo, environment)
    learner: BaseAlgorithm = resolve(LEARNERS[algo.agent])(**arguments)
    return learner


def _off_policy_arguments(algo: algorithms.OffPolicy, environment: VecEnv) -> dict[str, Any]:
    if isinstance(algo, algorithms.SAC):
        return {
            "ent_coef": _number_or_auto(algo.ent_coef),
            "target_entropy": _number_or_auto(algo.target_entropy),
            "target_update_interval": algo.target_update_interval,
        }
    assert isinstance(algo, algorithms.DDPG | algorithms.TD3)
    assert environment.action_space.shape is not None
    n_u = environment.action_space.shape[0]
    arguments: dict[str, Any] = {}
    if algo.action_noise > 0.0:
        base = NormalActionNoise(np.zeros(n_u), np.full(n_u, algo.action_noise))
        arguments["action_noise"] = VectorizedActionNoise(base, environment.num_envs)
    if isinstance(algo, algorithms.TD3):
        arguments |= {
            "policy_delay": algo.policy_delay,
            "target_policy_noise": algo.target_policy_noise,
            "target_noise_clip": algo.target_noise_clip,
        }
    return arguments


def _number_or_auto(value: str) -> str | float:
    return value if value.startswith("auto") else float(value)


def _learning_rate(algo: algorithms.Network) -> Any:
    if algo.learning_rate_schedule == "linear":
        return LinearSchedule(algo.learning_rate, 0.0, 1.0)
    return algo.learning_rate


def _policy_arguments(algo: algorithms.Network) -> dict[str, Any]:
    arguments: dict[str, Any] = {
        "net_arch": list(algo.net_arch),
        "activation_fn": ACTIVATIONS[algo.activation],
    }
    if isinstance(algo, algorithms.PPO):
        arguments["log_std_init"] = algo.log_std_init
    return arguments


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
        self._normalise = normalise
        self._mean = np.array(arrays["observation_mean"])
        self._scale = np.sqrt(arrays["observation_variance"] + arrays["epsilon"])
        self._clip = float(arrays["clip_observations"])
        self._n_u = n_u

    def reset(self, episodes: Integers) -> None:
        """Nothing to forget."""

    def act(self, observation: Observations) -> Actions:
        """Deterministic actions (n, n_u)."""
        if self._normalise:
            scaled = (observation - self._mean) / self._scale
            observation = np.clip(scaled, -self._clip, self._clip).astype(np.float32)
        action = np.empty((len(observation), self._n_u), dtype=np.float32)
        rows = np.zeros((FORWARD_ROWS, observation.shape[1]), dtype=np.float32)
        with torch.no_grad():
            for start in range(0, len(observation), FORWARD_ROWS):
                part = observation[start : start + FORWARD_ROWS]
                rows[: len(part)] = part
                output = self.policy._predict(torch.from_numpy(rows), deterministic=True)
                action[start : start + len(part)] = output.numpy()[: len(part)]
        return np.clip(action, -1.0, 1.0)


class LearnedPolicy(FrozenPolicy):
    """A trained policy in a test: its weights and statistics read without unpickling.

    Args:
        config: of the run that trained it.
        folder: its `model/` folder.
        n_u: actuators of the vehicle.
        check: called with the name and the content of each file before anything is made of it; raises where
            that is not what was written.

    Raises:
        RunError: the files are missing, damaged, or of another network than the configuration's.
    """

    def __init__(
        self,
        config: schema.TrainConfig,
        folder: Path,
        n_u: int,
        check: Callable[[str, bytes], None] | None = None,
    ) -> None:
        torch.set_num_threads(1)
        policy = _policy(config, n_u)
        weights = trained.weights(_read(folder / WEIGHTS, check), folder / WEIGHTS, policy.state_dict())
        kept = trained.statistics(_read(folder / STATISTICS, check), folder / STATISTICS, 4 + n_u)
        policy.load_state_dict(weights)
        policy.set_training_mode(False)
        super().__init__(policy, kept, config.train.normalise_observations, n_u)


def _read(path: Path, check: Callable[[str, bytes], None] | None) -> bytes:
    try:
        data = reading.content(path, archives.FILE)
    except FileNotFoundError as error:
        raise RunError(f"{path.parent}: no trained model here ({path.name} is missing)") from error
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if check is not None:
        check(path.name, data)
    return data


def _policy(config: schema.TrainConfig, n_u: int) -> BasePolicy:
    """The network of `config.algo` without an environment or a learner around it."""
    algo = config.algo
    observation_space = spaces.Box(-np.inf, np.inf, (4 + n_u,), dtype=np.float32)
    action_space = spaces.Box(-1.0, 1.0, (n_u,), dtype=np.float32)
    learner = resolve(LEARNERS[algo.agent])
    kind = learner.policy_aliases["MlpPolicy"]
    arguments = _policy_arguments(algo)
    if algo.agent == "ddpg":
        arguments["n_critics"] = 1
    policy: BasePolicy = kind(observation_space, action_space, lambda _: 0.0, **arguments)
    return policy
