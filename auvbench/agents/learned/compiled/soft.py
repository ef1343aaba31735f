"""SAC and TQC: the updates of `stable_baselines3.SAC` and `sb3_contrib.TQC`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from numpy.typing import NDArray

from auvbench.agents.learned.compiled import memory
from auvbench.agents.learned.compiled.arithmetic import average, quantile_loss, squash, squash_gradient
from auvbench.agents.learned.compiled.networks import backward, forward

Floats = NDArray[np.float32]


class Temperature:
    """The entropy coefficient: learned, or a constant."""

    def __init__(self, model: Any) -> None:
        self._model = model
        self._learned = None
        if model.ent_coef_optimizer is not None:
            self._learned = memory.Trained([[model.log_ent_coef]], model.ent_coef_optimizer)

    @property
    def value(self) -> float:
        """The coefficient."""
        if self._learned is None:
            return float(self._model.ent_coef_tensor)
        return float(np.exp(self._learned.values[0, 0]))

    def update(self, density: Floats) -> dict[str, float]:
        """Move it towards the target entropy for actions of log-densities (n,); return its loss by name."""
        if self._learned is None:
            return {}
        slope = -(float(density.mean()) + self._model.target_entropy)
        loss = float(self._learned.values[0, 0]) * slope
        self._learned.gradient[0, 0] = slope
        self._learned.update()
        return {"ent_coef_loss": loss}


def actor_layers(actor: Any) -> list[torch.nn.Linear]:
    """Return the linear layers of a squashed Gaussian policy; the last one stands for means and deviations."""
    return [*memory.layers(actor.latent_pi), actor.mu]


def actor_sizes(actor: Any) -> NDArray[np.int64]:
    """Return the widths of a squashed Gaussian policy with both its outputs."""
    widths = memory.sizes(actor_layers(actor))
    widths[-1] *= 2
    return widths


def actor_head(actor: Any) -> list[torch.Tensor]:
    """Return the parameters of means and deviations in the order of one layer with both."""
    return [actor.mu.weight, actor.log_std.weight, actor.mu.bias, actor.log_std.bias]


def normal(n: int, n_u: int) -> Floats:
    """Return standard normal numbers (n, n_u) of torch's generator, from which SB3 draws."""
    drawn: Floats = torch.randn(n, n_u).numpy()
    return drawn


def record(model: Any, losses: Sequence[Mapping[str, float]]) -> None:
    """Log the means of what updates returned, as SB3 does."""
    model.logger.record("train/n_updates", model._n_updates, exclude="tensorboard")
    for name in sorted({name for one in losses for name in one}):
        values = [one[name] for one in losses if name in one]
        model.logger.record(f"train/{name}", np.mean(values))


def squared_error(q: Floats, targets: Floats, factor: float) -> tuple[float, Floats]:
    """Return the sum over critics of `factor` times their mean squared error, and its gradient.

    Args:
        q: values (K, n, 1).
        targets: (n, 1).
        factor: of each critic's error.
    """
    error = q - targets
    return factor * float(np.square(error).sum()) / len(targets), error * np.float32(
        2.0 * factor / len(targets)
    )


def least_value(q: Floats) -> tuple[float, Floats]:
    """Return the mean over rows of the least of the critics' values (K, n, 1), and minus its gradient."""
    chosen = np.arange(len(q))[:, None, None] == q.argmin(axis=0)
    return float(q.min(axis=0).mean()), chosen * np.float32(-1.0 / q.shape[1])


class Soft:
    """What SAC and TQC share: `train`, in front of SB3's class."""

    def _setup_model(self: Any) -> None:
        super()._setup_model()  # type: ignore[misc]
        actor, critic, target = self.policy.actor, self.policy.critic, self.policy.critic_target
        self._actor = memory.Trained(
            [[*memory.parameters(actor.latent_pi), *actor_head(actor)]], actor.optimizer
        )
        networks = [memory.parameters(network) for network in critic.q_networks]
        self._critic = memory.Trained(networks, critic.optimizer)
        self._target = memory.rows([memory.parameters(network) for network in target.q_networks]).numpy()
        self._temperature = Temperature(self)
        self._sizes = actor_sizes(actor), memory.sizes(memory.layers(critic.q_networks[0]))

    def train(self: Any, gradient_steps: int, batch_size: int = 64) -> None:
        """Update networks and temperature `gradient_steps` times."""
        self.policy.set_training_mode(True)
        optimizers = [self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer]
        self._update_learning_rate([one for one in optimizers if one is not None])
        batches = memory.Batches(self, gradient_steps, batch_size)
        losses = []
        for step in range(gradient_steps):
            losses.append(self._update(*batches[step]))
            if step % self.target_update_interval == 0:
                average(self._target, self._critic.values, self.tau)
        self._n_updates += gradient_steps
        record(self, losses)

    def _update(
        self: Any, observation: Floats, action: Floats, following: Floats, reward: Floats, discount: Floats
    ) -> dict[str, float]:
        """Update once; return temperature and losses."""
        n, n_u = action.shape
        actor, critic = self._sizes
        noise, later = normal(n, n_u), normal(n, n_u)
        hidden, out = forward(self._actor.values, actor, observation)
        chosen, density = squash(out[0], noise)
        temperature = self._temperature.value
        losses = {"ent_coef": temperature, **self._temperature.update(density)}

        following_action, following_density = squash(
            forward(self._actor.values, actor, following)[1][0], later
        )
        x = np.concatenate([following, following_action], axis=1)
        value = self._value(forward(self._target, critic, x)[1])
        targets = reward + discount * (value - np.float32(temperature) * following_density[:, None])
        x = np.concatenate([observation, action], axis=1)
        activations, q = forward(self._critic.values, critic, x)
        losses["critic_loss"], slope = self._loss(q, targets)
        backward(self._critic.values, critic, x, activations, slope, self._critic.gradient, False)
        self._critic.update()

        x = np.concatenate([observation, chosen], axis=1)
        activations, q = forward(self._critic.values, critic, x)
        value, slope = self._objective(q)
        losses["actor_loss"] = temperature * float(density.mean()) - value
        slope = backward(
            self._critic.values, critic, x, activations, slope, self._critic.gradient[:, :0], True
        )
        slope = squash_gradient(out[0], noise, chosen, slope[:, -n_u:], temperature / n)
        backward(self._actor.values, actor, observation, hidden, slope[None], self._actor.gradient, False)
        self._actor.update()
        return losses


class SAC(Soft, stable_baselines3.SAC):
    """Soft actor-critic (Haarnoja et al. 2018)."""

    def _value(self, q: Floats) -> Floats:
        """Return the values (n, t) that targets are made of, from outputs (K, n, o) of the target networks."""
        least: Floats = q.min(axis=0)
        return least

    def _loss(self, q: Floats, targets: Floats) -> tuple[float, Floats]:
        """Return the loss of the critics and its gradient, for outputs (K, n, o) and targets (n, t)."""
        return squared_error(q, targets, 0.5)

    def _objective(self, q: Floats) -> tuple[float, Floats]:
        """Return the mean value that the actor climbs, and minus its gradient, for outputs (K, n, o)."""
        return least_value(q)


class TQC(Soft, sb3_contrib.TQC):
    """Soft actor-critic with truncated quantile critics (Kuznetsov et al. 2020)."""

    def _value(self, q: Floats) -> Floats:
        critics, n, quantiles = q.shape
        kept = (quantiles - self.top_quantiles_to_drop_per_net) * critics
        together = np.moveaxis(q, 0, 1).reshape(n, -1)
        lowest: Floats = np.sort(together, axis=1)[:, :kept]
        return lowest

    def _loss(self, q: Floats, targets: Floats) -> tuple[float, Floats]:
        loss, gradient = quantile_loss(q, targets)
        return loss, gradient

    def _objective(self, q: Floats) -> tuple[float, Floats]:
        return float(q.mean()), np.full_like(q, -1.0 / q.size)
