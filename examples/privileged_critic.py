"""Train a policy with your own program, here PPO with a privileged critic (Pinto et al. 2018), and test it with auvbench.

Stable-Baselines3's PPO learns on auvbench's environments. The policy observes what every policy observes; the critic also observes
the current and the factors on each drawn vehicle. The program exports the policy as an ONNX file, and auvbench tests the file:

    python privileged_critic.py mine.onnx --seed 100        # a million steps: about two minutes of one core
    auvbench train algo=onnx algo.path=mine.onnx vehicle=bluerov2_realistic_inertia task=waypoint_state
    auvbench evaluate outputs protocol=models
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnvWrapper, VecNormalize

from auvbench.config.schema import SCALES
from auvbench.envs import sb3

TASK = ("vehicle=bluerov2_realistic_inertia", "task=waypoint_state", "disturbance=unknown_vehicle")
PRIVILEGED = len(SCALES) + 3  # factors of the vehicle, and the current (x, y, z) in m/s


class Privileged(VecEnvWrapper):
    """Add the numbers that only the critic observes to each observation."""

    def __init__(self, venv: sb3.AuvVecEnv) -> None:
        seen = venv.observation_space
        high = np.append(seen.high, np.full(PRIVILEGED, 10.0, dtype=np.float32))
        super().__init__(venv, Box(-high, high, dtype=np.float32))
        self.disturbances = venv.batch.disturbances
        self.privileged = np.zeros((self.num_envs, PRIVILEGED), dtype=np.float32)

    def _known(self) -> np.ndarray:
        """Return what is known of the vehicles under way."""
        scales = self.disturbances["randomisation"].state.scales
        current = self.disturbances["current"].state.top
        return np.concatenate([np.log(scales), current], axis=1).astype(np.float32)

    def reset(self) -> np.ndarray:
        observation = self.venv.reset()
        self.privileged = self._known()
        return np.concatenate([observation, self.privileged], axis=1)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observation, reward, done, infos = self.venv.step_wait()
        for i in np.flatnonzero(done):
            infos[i]["terminal_observation"] = np.append(infos[i]["terminal_observation"], self.privileged[i])
        self.privileged = self._known()
        return np.concatenate([observation, self.privileged], axis=1), reward, done, infos


class Blind(FlattenExtractor):
    """Set the privileged numbers to 0."""

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        seen = observations.clone()
        seen[:, -PRIVILEGED:] = 0.0
        return seen


class AsymmetricPolicy(ActorCriticPolicy):
    """A policy without the privileged numbers, and a critic with them."""

    def _build(self, lr_schedule: Any) -> None:
        self.pi_features_extractor = Blind(self.observation_space)
        super()._build(lr_schedule)


class Actor(torch.nn.Module):
    """The policy without the critic, for observations that are not normalised."""

    def __init__(self, policy: ActorCriticPolicy, normaliser: VecNormalize) -> None:
        super().__init__()
        self.policy, self.clip, statistics = policy, normaliser.clip_obs, normaliser.obs_rms
        self.register_buffer("mean", torch.as_tensor(statistics.mean[:-PRIVILEGED]))
        scale = np.sqrt(statistics.var[:-PRIVILEGED] + normaliser.epsilon)
        self.register_buffer("scale", torch.as_tensor(scale))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        scaled = ((observation.double() - self.mean) / self.scale).clamp(-self.clip, self.clip).float()
        seen = torch.nn.functional.pad(scaled, (0, PRIVILEGED))
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(seen)).clamp(-1.0, 1.0)


def main() -> None:
    parser = argparse.ArgumentParser(description="PPO with a privileged critic, as an ONNX file.")
    parser.add_argument("path", help="the file to write: mine.onnx")
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--steps", type=int, default=1_000_000, help="environment steps of training")
    options = parser.parse_args()
    torch.set_num_threads(1)
    # Settings of algo=ppo_robust. results/robust has the results of seeds 100 to 109.
    environment = VecNormalize(Privileged(sb3.make(32, seed=options.seed, overrides=TASK)), gamma=0.99)
    model = PPO(
        AsymmetricPolicy,
        environment,
        learning_rate=LinearSchedule(0.001, 0.0, 1.0),
        n_steps=128,
        batch_size=1024,
        policy_kwargs={"net_arch": [64, 64], "share_features_extractor": False},
        seed=options.seed,
        device="cpu",
    )
    model.learn(options.steps)
    actor = Actor(model.policy, environment).eval()
    n = environment.observation_space.shape[0] - PRIVILEGED
    torch.onnx.export(
        actor,
        (torch.zeros(3, n),),
        options.path,
        input_names=["observation"],
        output_names=["action"],
        dynamic_shapes=({0: "n"},),
        external_data=False,
        verbose=False,
    )
    print(f"wrote {options.path}")


if __name__ == "__main__":
    main()
