"""CrossQ: the updates of `sb3_contrib.CrossQ`."""

from __future__ import annotations

from typing import Any

import numpy as np
import sb3_contrib
import torch
from numpy.typing import NDArray
from sb3_contrib.common.torch_layers import BatchRenorm1d

from auvbench.agents.learned.compiled import memory, soft
from auvbench.agents.learned.compiled.arithmetic import squash, squash_gradient
from auvbench.agents.learned.compiled.renormalised import BATCH, RENORM, RUNNING, backward, forward

Floats = NDArray[np.float32]


class Renormalised:
    """Networks of one shape with batch renormalisation, and what trains them.

    Args:
        networks: modules of each.
        head: parameters of a last layer that is not among the modules, of each.
        widths: of inputs, hidden layers, outputs.
        optimizer: SB3's.
    """

    def __init__(
        self,
        networks: list[list[torch.nn.Module]],
        head: list[torch.Tensor],
        widths: NDArray[np.int64],
        optimizer: Any,
    ) -> None:
        self._renorms: list[list[Any]] = [
            [one for one in network if isinstance(one, BatchRenorm1d)] for network in networks
        ]
        # A stand-in where no layer normalises.
        self._first: Any = next(iter(self._renorms[0]), BatchRenorm1d(1))
        self._sizes = widths
        self._normalised = np.arange(len(widths) - 1) < len(self._renorms[0])
        self.trained = memory.Trained([[*_parameters(network), *head] for network in networks], optimizer)
        self._mean = memory.rows([[one.ra_mean for one in network] for network in self._renorms]).numpy()
        self._variance = memory.rows([[one.ra_var for one in network] for network in self._renorms]).numpy()

    def forward(self, x: Floats, training: bool) -> tuple[Any, Floats]:
        """Return a function of the outputs' gradient, and the outputs (K, n, o), for inputs (n, d).

        The function takes the gradient of the outputs and whether that of the parameters is wanted; it returns that of the
        inputs.

        Args:
            x: inputs.
            training: normalise by the batch and count it; otherwise by the running statistics.
        """
        mode = RUNNING
        if training:
            mode = RENORM if int(self._first.steps) > self._first.warmup_steps else BATCH
            for one in (one for network in self._renorms for one in network):
                one.steps += 1
        network = self.trained.values, self._sizes, self._normalised
        *passed, out = forward(*network, self._mean, self._variance, x, mode, self._first.momentum)

        def gradient(upstream: Floats, weights: bool) -> Floats:
            to = self.trained.gradient if weights else self.trained.gradient[:, :0]
            total: Floats = backward(*network, x, *passed, upstream, to, mode, not weights)
            return total

        return gradient, out


def _parameters(network: list[torch.nn.Module]) -> list[torch.Tensor]:
    found: list[torch.Tensor] = []
    for module in network:
        if isinstance(module, BatchRenorm1d):
            found += [module.scale, module.bias]
        elif isinstance(module, torch.nn.Linear):
            found += [module.weight, module.bias]
    return found


class CrossQ(sb3_contrib.CrossQ):
    """SAC without target networks, with batch renormalisation (Bhatt et al. 2024)."""

    def _setup_model(self) -> None:
        super()._setup_model()
        actor: Any = self.policy.actor
        critic: Any = self.policy.critic
        self._actor = Renormalised(
            [list(actor.latent_pi)], soft.actor_head(actor), soft.actor_sizes(actor), actor.optimizer
        )
        widths = memory.sizes(memory.layers(critic.q_networks[0]))
        self._critic = Renormalised(
            [list(network) for network in critic.q_networks], [], widths, critic.optimizer
        )
        self._temperature = soft.Temperature(self)
        self._n_u: int = actor.mu.out_features

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Update the critics `gradient_steps` times, actor and temperature every `policy_delay`-th time."""
        self.policy.set_training_mode(False)  # layers count their batches here, not in SB3's passes
        optimizers = [self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer]
        self._update_learning_rate([one for one in optimizers if one is not None])
        batches = memory.Batches(self, gradient_steps, batch_size)
        losses = []
        for step in range(gradient_steps):
            self._n_updates += 1
            observation, action, following, reward, discount = batches[step]
            temperature = self._temperature.value
            loss = self._update_critic(observation, action, following, reward, discount, temperature)
            losses.append({"ent_coef": temperature, "critic_loss": loss})
            if self._n_updates % self.policy_delay == 0:
                losses[-1] |= self._update_actor(observation, temperature)
        soft.record(self, losses)

    def _update_critic(
        self,
        observation: Floats,
        action: Floats,
        following: Floats,
        reward: Floats,
        discount: Floats,
        temperature: float,
    ) -> float:
        """Update the critics once; return their loss."""
        n, n_u = action.shape
        noise = soft.normal(n, n_u)
        after, density = squash(self._actor.forward(following, False)[1][0], noise)
        # One pass for both, so that both count in the statistics of the batch.
        now, then = np.concatenate([observation, action], axis=1), np.concatenate([following, after], axis=1)
        gradient, q = self._critic.forward(np.concatenate([now, then]), True)
        targets = reward + discount * (q[:, n:].min(axis=0) - np.float32(temperature) * density[:, None])
        loss, slope = soft.squared_error(q[:, :n], targets, 0.5)
        gradient(np.concatenate([slope, np.zeros_like(slope)], axis=1), True)
        self._critic.trained.update()
        return loss

    def _update_actor(self, observation: Floats, temperature: float) -> dict[str, float]:
        """Update actor and temperature once; return their losses."""
        n_u = self._n_u
        noise = soft.normal(len(observation), n_u)
        actor_gradient, out = self._actor.forward(observation, True)
        action, density = squash(out[0], noise)
        losses = self._temperature.update(density)
        gradient, q = self._critic.forward(np.concatenate([observation, action], axis=1), False)
        value, slope = soft.least_value(q)
        losses["actor_loss"] = temperature * float(density.mean()) - value
        slope = gradient(slope, False)[:, -n_u:]
        slope = squash_gradient(out[0], noise, action, slope, temperature / len(observation))
        actor_gradient(slope[None], True)
        self._actor.trained.update()
        return losses
