"""What SB3's and sb3-contrib's constructors take, from the configuration."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3.common.noise import NormalActionNoise, VectorizedActionNoise
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from auvbench.config import algorithms, schema
from auvbench.config.schema import discount

ACTIVATIONS = {
    "tanh": torch.nn.Tanh,
    "relu": torch.nn.ReLU,
    "elu": torch.nn.ELU,
    "silu": torch.nn.SiLU,
}


def of_learner(config: schema.TrainConfig, environment: VecEnv) -> dict[str, Any]:
    """Arguments of the learner that `config.algo` describes, on an environment."""
    algo = config.algo
    return {
        "policy": policy_name(algo),
        "env": environment,
        "learning_rate": _learning_rate(algo),
        "batch_size": algo.batch_size,
        "gamma": discount(algo, config.step.frequency),
        "policy_kwargs": of_policy(algo),
        "seed": config.seed,
        "device": "cpu",
        "verbose": 0,
        **(
            _on_policy(algo)
            if isinstance(algo, algorithms.OnPolicy)
            else _off_policy(algo, environment.num_envs, environment.action_space.shape or ())
        ),
    }


def policy_name(algo: algorithms.Network) -> str:
    """What the learner's class calls the policy that it is to make."""
    return "MlpLstmPolicy" if isinstance(algo, algorithms.RecurrentPPO) else "MlpPolicy"


def of_policy(algo: algorithms.Network) -> dict[str, Any]:
    """Arguments of the policy's networks."""
    arguments: dict[str, Any] = {
        "net_arch": list(algo.net_arch),
        "activation_fn": ACTIVATIONS[algo.activation],
    }
    if isinstance(algo, algorithms.OnPolicy):
        arguments["log_std_init"] = algo.log_std_init
    if isinstance(algo, algorithms.RecurrentPPO):
        arguments |= {
            "lstm_hidden_size": algo.lstm_size,
            "n_lstm_layers": algo.lstm_layers,
            "enable_critic_lstm": algo.critic_lstm,
        }
    if isinstance(algo, algorithms.TQC):
        arguments |= {"n_quantiles": algo.n_quantiles, "n_critics": algo.n_critics}
    if isinstance(algo, algorithms.CrossQ):
        arguments |= {
            "net_arch": {"pi": list(algo.net_arch), "qf": list(algo.critic_net_arch)},
            "n_critics": algo.n_critics,
            "batch_norm_momentum": algo.batch_norm_momentum,
            "renorm_warmup_steps": algo.renorm_warmup_steps,
        }
    return arguments


def _on_policy(algo: algorithms.OnPolicy) -> dict[str, Any]:
    arguments: dict[str, Any] = {
        "n_steps": algo.n_steps,
        "gae_lambda": algo.gae_lambda,
        "normalize_advantage": algo.normalize_advantage,
    }
    names: tuple[str, ...] = ()
    if isinstance(algo, algorithms.PPO):
        names = ("n_epochs", "clip_range", "ent_coef", "vf_coef", "max_grad_norm")
    elif isinstance(algo, algorithms.TRPO):
        names = (
            *("target_kl", "cg_max_steps", "cg_damping", "line_search_shrinking_factor"),
            *("line_search_max_iter", "n_critic_updates", "sub_sampling_factor"),
        )
    return arguments | {name: getattr(algo, name) for name in names}


def _off_policy(algo: algorithms.Network, n_envs: int, action_shape: tuple[int, ...]) -> dict[str, Any]:
    assert isinstance(algo, algorithms.OffPolicy)
    arguments: dict[str, Any] = {
        "buffer_size": algo.buffer_size,
        "learning_starts": algo.learning_starts,
        "train_freq": (algo.train_freq, "step"),
        "gradient_steps": algo.gradient_steps,
    }
    if isinstance(algo, algorithms.Targets):
        arguments["tau"] = algo.tau
    if isinstance(algo, algorithms.Entropy):
        arguments["ent_coef"] = _number_or_auto(algo.ent_coef)
        arguments["target_entropy"] = _number_or_auto(algo.target_entropy)
    if isinstance(algo, algorithms.SAC):
        arguments["target_update_interval"] = algo.target_update_interval
    if isinstance(algo, algorithms.TQC):
        arguments["top_quantiles_to_drop_per_net"] = algo.top_quantiles_to_drop_per_net
    if isinstance(algo, algorithms.CrossQ | algorithms.TD3):
        arguments["policy_delay"] = algo.policy_delay
    if isinstance(algo, algorithms.TD3):
        arguments["target_policy_noise"] = algo.target_policy_noise
        arguments["target_noise_clip"] = algo.target_noise_clip
    if isinstance(algo, algorithms.DDPG | algorithms.TD3) and algo.action_noise > 0.0:
        base = NormalActionNoise(np.zeros(action_shape), np.full(action_shape, algo.action_noise))
        arguments["action_noise"] = VectorizedActionNoise(base, n_envs)
    return arguments


def _number_or_auto(value: str) -> str | float:
    return value if value.startswith("auto") else float(value)


def _learning_rate(algo: algorithms.Network) -> Any:
    if algo.learning_rate_schedule == "linear":
        return LinearSchedule(algo.learning_rate, 0.0, 1.0)
    return algo.learning_rate
