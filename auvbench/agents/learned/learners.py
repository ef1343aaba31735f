"""Create SB3's learners from the configuration, write them as plain files, and check them for NaN.

A run that continued with a NaN would waste its budget and overwrite its last good checkpoint. The checks here are of
losses and weights; the worker checks the environments' observations and rewards.
"""

from __future__ import annotations

import inspect
import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from auvbench.config import schema
from auvbench.config.algorithms.sb3 import TQC, CrossQ, Entropy, Network, OffPolicy, OnPolicy, RecurrentPPO
from auvbench.config.schema import discount
from auvbench.errors import ActionError, AuvbenchError, TrainingError
from auvbench.registry import AGENTS, resolve

WEIGHTS, STATISTICS = "policy.pt", "normalisation.npz"
"""Names of the files of a trained model."""

ACTIVATIONS = {
    "tanh": torch.nn.Tanh,
    "relu": torch.nn.ReLU,
    "elu": torch.nn.ELU,
    "silu": torch.nn.SiLU,
}


def make(config: schema.TrainConfig, environment: VecEnv) -> BaseAlgorithm:
    """Return the SB3 learner for `config.algo` on an environment; it uses one torch thread."""
    torch.set_num_threads(1)
    learner: BaseAlgorithm = algorithm(config.algo)(**arguments(config, environment))
    return learner


def algorithm(algo: Any) -> type[BaseAlgorithm]:
    """Return the algorithm's class of SB3, or its subclass with compiled updates if `algo.updates` is "compiled"."""
    module, _, name = AGENTS[algo.agent].algorithm.partition(":")
    if getattr(algo, "updates", "sb3") == "compiled":
        module = "auvbench.agents.learned.compiled"
    kind: type[BaseAlgorithm] = resolve(f"{module}:{name}")
    return kind


def arguments(config: schema.TrainConfig, environment: VecEnv) -> dict[str, Any]:
    """Return the arguments of SB3's learner.

    A key of `config.algo` that SB3 has under the same name is passed on. The other arguments are computed from the configuration.
    """
    algo: Any = config.algo
    parameters = inspect.signature(resolve(AGENTS[algo.agent].algorithm)).parameters
    options = {f.name: getattr(algo, f.name) for f in fields(algo) if f.name in parameters}
    options |= {
        "policy": policy_name(algo),
        "env": environment,
        "gamma": discount(algo, config.step.frequency),
        "policy_kwargs": policy_arguments(algo),
        "seed": config.seed,
        "device": "cpu",
        "verbose": 0,
    }
    if algo.learning_rate_schedule == "linear":
        options["learning_rate"] = LinearSchedule(algo.learning_rate, 0.0, 1.0)
    if isinstance(algo, OffPolicy):
        options["train_freq"] = (algo.train_freq, "step")
    if isinstance(algo, Entropy):
        options["ent_coef"] = _number_or_auto(algo.ent_coef)
        options["target_entropy"] = _number_or_auto(algo.target_entropy)
    if scale := options.pop("action_noise", 0.0):
        shape = environment.action_space.shape or ()
        noise = NormalActionNoise(np.zeros(shape), np.full(shape, scale))
        options["action_noise"] = VectorizedActionNoise(noise, environment.num_envs)
    return options


def _number_or_auto(value: str) -> str | float:
    return value if value.startswith("auto") else float(value)


def policy_name(algo: Network) -> str:
    """Return SB3's name of the policy."""
    return "MlpLstmPolicy" if isinstance(algo, RecurrentPPO) else "MlpPolicy"


def policy_arguments(algo: Network) -> dict[str, Any]:
    """Return the arguments of the policy's networks."""
    arguments: dict[str, Any] = {
        "net_arch": list(algo.net_arch),
        "activation_fn": ACTIVATIONS[algo.activation],
    }
    if isinstance(algo, OnPolicy):
        arguments["log_std_init"] = algo.log_std_init
    if isinstance(algo, RecurrentPPO):
        arguments |= {
            "lstm_hidden_size": algo.lstm_size,
            "n_lstm_layers": algo.lstm_layers,
            "enable_critic_lstm": algo.critic_lstm,
        }
    if isinstance(algo, TQC):
        arguments |= {"n_quantiles": algo.n_quantiles, "n_critics": algo.n_critics}
    if isinstance(algo, CrossQ):
        arguments |= {
            "net_arch": {"pi": list(algo.net_arch), "qf": list(algo.critic_net_arch)},
            "n_critics": algo.n_critics,
            "batch_norm_momentum": algo.batch_norm_momentum,
            "renorm_warmup_steps": algo.renorm_warmup_steps,
        }
    return arguments


def files(model: BaseAlgorithm, normaliser: VecNormalize) -> dict[str, bytes]:
    """Return the files of a trained model by name: a plain dictionary of tensors, and the running statistics."""
    weights, arrays = io.BytesIO(), io.BytesIO()
    # Copies, because a tensor may be a view of a larger tensor, and torch would write the whole larger tensor.
    torch.save({name: tensor.clone() for name, tensor in model.policy.state_dict().items()}, weights)
    np.savez(arrays, **statistics(normaliser))  # type: ignore[arg-type]
    return {WEIGHTS: weights.getvalue(), STATISTICS: arrays.getvalue()}


def statistics(normaliser: VecNormalize) -> dict[str, NDArray[np.float64]]:
    """Return the running statistics of observations and returns as plain arrays. If observations are not
    normalised, their mean is 0 and their variance 1.
    """
    returns = normaliser.ret_rms
    observations = RunningMeanStd(shape=normaliser.observation_space.shape or ())
    if normaliser.norm_obs:
        assert isinstance(normaliser.obs_rms, RunningMeanStd)
        observations = normaliser.obs_rms
    values = {
        "observation_mean": observations.mean,
        "observation_variance": observations.var,
        "observation_count": observations.count,
        "return_mean": returns.mean,
        "return_variance": returns.var,
        "return_count": returns.count,
        "epsilon": normaliser.epsilon,
        "clip_observations": normaliser.clip_obs,
    }
    return {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}


def check_losses(model: BaseAlgorithm) -> None:
    """Raise `TrainingError` if a number that the last update logged is not finite."""
    for key, value in model.logger.name_to_value.items():
        # explained_variance is NaN by definition if the returns do not vary.
        if key.startswith("train/") and key != "train/explained_variance" and not math.isfinite(value):
            raise TrainingError(f"step {model.num_timesteps}: {key} became {value}")


def check_parameters(model: BaseAlgorithm) -> None:
    """Raise `TrainingError` if a weight of the policy or of a target network is not finite."""
    with torch.no_grad():
        named: dict[str, torch.Tensor] = dict(model.policy.named_parameters())
        named |= {n: buffer for n, buffer in model.policy.named_buffers() if buffer.is_floating_point()}
        total = torch.stack([parameter.sum() for parameter in named.values()]).sum()
        if math.isfinite(float(total)):
            return
        for name, parameter in named.items():
            if not bool(torch.isfinite(parameter).all()):
                raise TrainingError(
                    f"step {model.num_timesteps}: the weights {name} of the policy are not finite"
                )


@contextmanager
def diagnosed(model: BaseAlgorithm) -> Iterator[None]:
    """If an error occurs and weights are not finite, raise a `TrainingError` about the weights instead.

    If a NaN appears within an update, torch's distributions raise an error of many lines before the weights
    are checked.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, AuvbenchError) and not isinstance(error, ActionError):
            raise
        try:
            check_parameters(model)
        except TrainingError as cause:
            raise cause from error
        raise
