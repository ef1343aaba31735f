"""TD3 and DDPG: the updates of `stable_baselines3.TD3` and `stable_baselines3.DDPG`."""

from __future__ import annotations

from typing import Any

import numpy as np
import stable_baselines3
import torch
from numpy.typing import NDArray

from auvbench.agents.learned.compiled import memory
from auvbench.agents.learned.compiled.arithmetic import average
from auvbench.agents.learned.compiled.networks import backward, forward
from auvbench.agents.learned.compiled.soft import record, squared_error

Floats = NDArray[np.float32]


class Delayed:
    """What TD3 and DDPG share: `train`, in front of SB3's class."""

    def _setup_model(self: Any) -> None:
        super()._setup_model()  # type: ignore[misc]
        actor, critic = self.policy.actor, self.policy.critic
        self._actor = memory.Trained([memory.parameters(actor.mu)], actor.optimizer)
        networks = [memory.parameters(network) for network in critic.q_networks]
        self._critic = memory.Trained(networks, critic.optimizer)
        target_critics = self.policy.critic_target.q_networks
        self._target_critic = memory.rows([memory.parameters(one) for one in target_critics]).numpy()
        self._target_actor = memory.rows([memory.parameters(self.policy.actor_target.mu)]).numpy()
        self._sizes = (
            memory.sizes(memory.layers(actor.mu)),
            memory.sizes(memory.layers(critic.q_networks[0])),
        )

    def train(self: Any, gradient_steps: int, batch_size: int = 100) -> None:
        """Update the critics `gradient_steps` times and the actor every `policy_delay`-th time."""
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer])
        batches = memory.Batches(self, gradient_steps, batch_size)
        losses = []
        for step in range(gradient_steps):
            self._n_updates += 1
            observation, action, following, reward, discount = batches[step]
            loss = self._update_critic(observation, action, following, reward, discount)
            losses.append({"critic_loss": loss})
            if self._n_updates % self.policy_delay == 0:
                losses[-1]["actor_loss"] = self._update_actor(observation)
                average(self._target_critic, self._critic.values, self.tau)
                average(self._target_actor, self._actor.values, self.tau)
        record(self, losses)

    def _update_critic(
        self: Any, observation: Floats, action: Floats, following: Floats, reward: Floats, discount: Floats
    ) -> float:
        """Update the critics once; return their loss."""
        actor, critic = self._sizes
        noise = torch.empty(action.shape).normal_(0, self.target_policy_noise).numpy()
        noise = noise.clip(-self.target_noise_clip, self.target_noise_clip)
        after = (np.tanh(forward(self._target_actor, actor, following)[1][0]) + noise).clip(-1.0, 1.0)
        x = np.concatenate([following, after], axis=1)
        targets = reward + discount * forward(self._target_critic, critic, x)[1].min(axis=0)
        x = np.concatenate([observation, action], axis=1)
        hidden, q = forward(self._critic.values, critic, x)
        loss, slope = squared_error(q, targets, 1.0)
        backward(self._critic.values, critic, x, hidden, slope, self._critic.gradient, False)
        self._critic.update()
        return loss

    def _update_actor(self: Any, observation: Floats) -> float:
        """Update the actor once, which climbs the first critic; return its loss."""
        actor, critic = self._sizes
        hidden, out = forward(self._actor.values, actor, observation)
        action = np.tanh(out[0])
        x, first = np.concatenate([observation, action], axis=1), self._critic.values[:1]
        activations, q = forward(first, critic, x)
        slope = backward(first, critic, x, activations, np.full_like(q, -1.0 / q.size), first[:, :0], True)
        slope = slope[:, observation.shape[1] :] * (1.0 - action * action)
        backward(self._actor.values, actor, observation, hidden, slope[None], self._actor.gradient, False)
        self._actor.update()
        return -float(q.mean())


class TD3(Delayed, stable_baselines3.TD3):
    """Twin delayed deep deterministic policy gradient (Fujimoto et al. 2018)."""


class DDPG(Delayed, stable_baselines3.DDPG):
    """Deep deterministic policy gradient (Lillicrap et al. 2016)."""
