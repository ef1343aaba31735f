"""Define the compiled updates of `stable_baselines3.SAC`, `TD3` and `DDPG`, and of `sb3_contrib.TQC` and `CrossQ`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from numpy.typing import NDArray

from auvbench.agents.learned.compiled import memory
from auvbench.agents.learned.compiled.arithmetic import average, quantile_loss, squash, squash_gradient

Floats = NDArray[np.float32]


class Temperature:
    """Entropy coefficient: learned, or constant."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._learned = None
        if model.ent_coef_optimizer is not None:
            self._learned = memory.Trained([[model.log_ent_coef]], model.ent_coef_optimizer)

    @property
    def value(self) -> float:
        """Return the coefficient."""
        if self._learned is None:
            return float(self._model.ent_coef_tensor)
        return float(np.exp(self._learned.values[0, 0]))

    def update(self, density: Floats) -> dict[str, float]:
        """Take one gradient step on the entropy coefficient, so that the policy's entropy approaches its target.

        Return {"ent_coef_loss": loss}, or {} if the coefficient is constant.

        Args:
            density: log-densities (n,) of the policy's actions.
        """
        if self._learned is None:
            return {}
        slope = -(float(density.mean()) + self._model.target_entropy)
        loss = float(self._learned.values[0, 0]) * slope
        self._learned.gradient[0, 0] = slope
        self._learned.update()
        return {"ent_coef_loss": loss}


class Policy(memory.Networks):
    """A squashed Gaussian policy of SB3."""

    def __init__(self, actor: Any) -> None:
        super().__init__([actor.latent_pi], actor.optimizer, [actor.mu, actor.log_std])
        self._n_u: int = actor.mu.out_features

    def sample(self, observation: Floats, training: bool = False) -> Sample:
        """Draw actions for observations (n, d), with normal numbers from torch's generator, as SB3 does."""
        noise: Floats = torch.randn(len(observation), self._n_u).numpy()
        gradient, out = self.forward(observation, training)
        return Sample(self, observation, gradient, out[0], noise, *squash(out[0], noise))


@dataclass(frozen=True, slots=True)
class Sample:
    """Actions that a policy drew."""

    policy: Policy
    observation: Floats
    gradient: memory.Gradient
    out: Floats
    noise: Floats
    action: Floats
    """(n, n_u)"""
    density: Floats
    """(n,) log-densities"""

    def climb(
        self, critic: memory.Networks, objective: Callable[[Floats], tuple[float, Floats]], temperature: float
    ) -> float:
        """Update the policy once towards actions of higher value and entropy; return its loss.

        Args:
            critic: critic of observations and actions.
            objective: function of the critic's outputs (K, n, o) that returns the value to maximise and the negative
                gradient of this value.
            temperature: weight of the entropy.
        """
        n = len(self.observation)
        gradient, q = critic.forward(np.concatenate([self.observation, self.action], axis=1))
        value, slope = objective(q)
        slope = gradient(slope, False)[:, self.observation.shape[1] :]
        slope = squash_gradient(self.out, self.noise, self.action, slope, temperature / n)
        self.gradient(slope[None], True)
        self.policy.update()
        return temperature * float(self.density.mean()) - value


class Compiled:
    """Algorithm whose `train` overrides the method of SB3's class and calls `_update`.

    `_update(step, observation, action, following, reward, discount)` updates once with a batch and returns
    the losses by name; `step` counts within a call of `train`.
    """

    counts_batches = True
    """whether `train` puts SB3's modules into training mode, in which their passes update the statistics of
    normalisation layers
    """

    def train(self: Any, gradient_steps: int, batch_size: int = 64) -> None:
        """Update `gradient_steps` times, and log the means of the losses as SB3 does."""
        self.policy.set_training_mode(self.counts_batches)
        optimizers = [self.actor.optimizer, self.critic.optimizer, getattr(self, "ent_coef_optimizer", None)]
        self._update_learning_rate([optimizer for optimizer in optimizers if optimizer is not None])
        losses: list[dict[str, float]] = []
        for step in range(gradient_steps):
            self._n_updates += 1
            losses.append(self._update(step, *memory.batch(self, batch_size)))
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name in sorted({name for loss in losses for name in loss}):
            values = [loss[name] for loss in losses if name in loss]
            self.logger.record(f"train/{name}", np.mean(values))


def squared_error(q: Floats, targets: Floats, factor: float) -> tuple[float, Floats]:
    """Return the sum over critics of `factor` times their mean squared error, and its gradient.

    Args:
        q: values (K, n, 1).
        targets: target values (n, 1).
        factor: factor on each critic's error.
    """
    error = q - targets
    return factor * float(np.square(error).sum()) / len(targets), error * np.float32(
        2.0 * factor / len(targets)
    )


def least_value(q: Floats) -> tuple[float, Floats]:
    """Return the mean over rows of the smallest of the critics' values (K, n, 1), and its negative gradient."""
    chosen = np.arange(len(q))[:, None, None] == q.argmin(axis=0)
    return float(q.min(axis=0).mean()), chosen * np.float32(-1.0 / q.shape[1])


class Soft(Compiled):
    """Common part of SAC and TQC."""

    def _setup_model(self: Any) -> None:
        super()._setup_model()  # type: ignore[misc]
        critic = self.policy.critic
        self._actor = Policy(self.policy.actor)
        self._critic = memory.Networks(critic.q_networks, critic.optimizer)
        self._target = memory.Networks(self.policy.critic_target.q_networks)
        self._temperature = Temperature(self)

    def _update(
        self: Any,
        step: int,
        observation: Floats,
        action: Floats,
        following: Floats,
        reward: Floats,
        discount: Floats,
    ) -> dict[str, float]:
        drawn = self._actor.sample(observation)
        temperature = self._temperature.value
        losses = {"ent_coef": temperature, **self._temperature.update(drawn.density)}

        later = self._actor.sample(following)
        value = self._value(self._target.forward(np.concatenate([following, later.action], axis=1))[1])
        targets = reward + discount * (value - np.float32(temperature) * later.density[:, None])
        gradient, q = self._critic.forward(np.concatenate([observation, action], axis=1))
        losses["critic_loss"], slope = self._loss(q, targets)
        gradient(slope, True)
        self._critic.update()

        losses["actor_loss"] = drawn.climb(self._critic, self._objective, temperature)
        if step % self.target_update_interval == 0:
            average(self._target.values, self._critic.values, self.tau)
        return losses


class SAC(Soft, stable_baselines3.SAC):
    """Soft actor-critic (Haarnoja et al. 2018)."""

    def _value(self, q: Floats) -> Floats:
        """Return the values (n, t) for the targets, from outputs (K, n, o) of the target networks."""
        least: Floats = q.min(axis=0)
        return least

    def _loss(self, q: Floats, targets: Floats) -> tuple[float, Floats]:
        """Return the loss of the critics and its gradient, for outputs (K, n, o) and targets (n, t)."""
        return squared_error(q, targets, 0.5)

    def _objective(self, q: Floats) -> tuple[float, Floats]:
        """Return the mean value that the actor maximises, and its negative gradient, for outputs (K, n, o)."""
        return least_value(q)


class TQC(Soft, sb3_contrib.TQC):
    """Soft actor-critic with truncated quantile critics (Kuznetsov et al. 2020)."""

    def _value(self, q: Floats) -> Floats:
        critics, n, quantiles = q.shape
        quantiles_used = (quantiles - self.top_quantiles_to_drop_per_net) * critics
        together = np.moveaxis(q, 0, 1).reshape(n, -1)
        lowest: Floats = np.sort(together, axis=1)[:, :quantiles_used]
        return lowest

    def _loss(self, q: Floats, targets: Floats) -> tuple[float, Floats]:
        loss, gradient = quantile_loss(q, targets)
        return loss, gradient

    def _objective(self, q: Floats) -> tuple[float, Floats]:
        return float(q.mean()), np.full_like(q, -1.0 / q.size)


class CrossQ(Compiled, sb3_contrib.CrossQ):
    """SAC without target networks, with batch renormalisation (Bhatt et al. 2024)."""

    counts_batches = False  # `_update` itself updates the statistics of the layers

    def _setup_model(self) -> None:
        super()._setup_model()
        policy: Any = self.policy
        self._actor = Policy(policy.actor)
        self._critic = memory.Networks(policy.critic.q_networks, policy.critic.optimizer)
        self._temperature = Temperature(self)

    def _update(self, step: int, observation: Floats, *transition: Floats) -> dict[str, float]:
        temperature = self._temperature.value
        losses = {"ent_coef": temperature}
        losses["critic_loss"] = self._update_critic(temperature, observation, *transition)
        if self._n_updates % self.policy_delay == 0:
            losses |= self._update_actor(observation, temperature)
        return losses

    def _update_critic(
        self,
        temperature: float,
        observation: Floats,
        action: Floats,
        following: Floats,
        reward: Floats,
        discount: Floats,
    ) -> float:
        """Update the critics once; return their loss."""
        n = len(action)
        drawn = self._actor.sample(following)
        # One pass for present and next inputs, so that the batch's statistics include both.
        inputs = np.concatenate([observation, action], axis=1)
        next_inputs = np.concatenate([following, drawn.action], axis=1)
        gradient, q = self._critic.forward(np.concatenate([inputs, next_inputs]), training=True)
        value = q[:, n:].min(axis=0) - np.float32(temperature) * drawn.density[:, None]
        loss, slope = squared_error(q[:, :n], reward + discount * value, 0.5)
        gradient(np.concatenate([slope, np.zeros_like(slope)], axis=1), True)
        self._critic.update()
        return loss

    def _update_actor(self, observation: Floats, temperature: float) -> dict[str, float]:
        """Update actor and temperature once; return their losses."""
        drawn = self._actor.sample(observation, training=True)
        losses = self._temperature.update(drawn.density)
        losses["actor_loss"] = drawn.climb(self._critic, least_value, temperature)
        return losses


class Delayed(Compiled):
    """Common part of TD3 and DDPG."""

    def _setup_model(self: Any) -> None:
        super()._setup_model()  # type: ignore[misc]
        actor, critic = self.policy.actor, self.policy.critic
        self._actor = memory.Networks([actor.mu], actor.optimizer)
        self._critic = memory.Networks(critic.q_networks, critic.optimizer)
        self._target_actor = memory.Networks([self.policy.actor_target.mu])
        self._target_critic = memory.Networks(self.policy.critic_target.q_networks)

    def _update(self: Any, step: int, observation: Floats, *transition: Floats) -> dict[str, float]:
        losses = {"critic_loss": self._update_critic(observation, *transition)}
        if self._n_updates % self.policy_delay == 0:
            losses["actor_loss"] = self._update_actor(observation)
            average(self._target_critic.values, self._critic.values, self.tau)
            average(self._target_actor.values, self._actor.values, self.tau)
        return losses

    def _update_critic(
        self: Any, observation: Floats, action: Floats, following: Floats, reward: Floats, discount: Floats
    ) -> float:
        """Update the critics once; return their loss."""
        noise = torch.empty(action.shape).normal_(0, self.target_policy_noise).numpy()
        noise = noise.clip(-self.target_noise_clip, self.target_noise_clip)
        after = (np.tanh(self._target_actor.forward(following)[1][0]) + noise).clip(-1.0, 1.0)
        q = self._target_critic.forward(np.concatenate([following, after], axis=1))[1]
        targets = reward + discount * q.min(axis=0)
        gradient, q = self._critic.forward(np.concatenate([observation, action], axis=1))
        loss, slope = squared_error(q, targets, 1.0)
        gradient(slope, True)
        self._critic.update()
        return loss

    def _update_actor(self: Any, observation: Floats) -> float:
        """Update the actor once to maximise the first critic; return its loss."""
        actor_gradient, out = self._actor.forward(observation)
        action = np.tanh(out[0])
        gradient, q = self._critic.forward(np.concatenate([observation, action], axis=1), first=1)
        slope = gradient(np.full_like(q, -1.0 / q.size), False)[:, observation.shape[1] :]
        actor_gradient((slope * (1.0 - action * action))[None], True)
        self._actor.update()
        return -float(q.mean())


class TD3(Delayed, stable_baselines3.TD3):
    """Twin delayed deep deterministic policy gradient (Fujimoto et al. 2018)."""


class DDPG(Delayed, stable_baselines3.DDPG):
    """Deep deterministic policy gradient (Lillicrap et al. 2016)."""
