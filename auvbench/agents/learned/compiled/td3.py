"""TD3 and DDPG: the updates of `stable_baselines3.TD3` and `stable_baselines3.DDPG`."""

from __future__ import annotations

from typing import Any

import numpy as np
import stable_baselines3
import torch
from numpy.typing import NDArray

from auvbench.agents.learned.compiled import memory
from auvbench.agents.learned.compiled.arithmetic import average
from auvbench.agents.learned.compiled.soft import Compiled, squared_error

Floats = NDArray[np.float32]


class Delayed(Compiled):
    """What TD3 and DDPG share."""

    def _setup_model(self: Any) -> None:
        super()._setup_model()  # type: ignore[misc]
        actor, critic = self.policy.actor, self.policy.critic
        self._actor = memory.Networks([actor.mu], actor.optimizer)
        self._critic = memory.Networks(critic.q_networks, critic.optimizer)
        self._target_actor = memory.Networks([self.policy.actor_target.mu])
        self._target_critic = memory.Networks(self.policy.critic_target.q_networks)

    def _update(self: Any, step: int, observation: Floats, *rest: Floats) -> dict[str, float]:
        losses = {"critic_loss": self._update_critic(observation, *rest)}
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
        """Update the actor once, which climbs the first critic; return its loss."""
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
