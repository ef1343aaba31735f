"""CrossQ: the updates of `sb3_contrib.CrossQ`."""

from __future__ import annotations

from typing import Any

import numpy as np
import sb3_contrib
from numpy.typing import NDArray

from auvbench.agents.learned.compiled import memory, soft

Floats = NDArray[np.float32]


class CrossQ(soft.Compiled, sb3_contrib.CrossQ):
    """SAC without target networks, with batch renormalisation (Bhatt et al. 2024)."""

    counts_batches = False  # layers count their batches in `_update`

    def _setup_model(self) -> None:
        super()._setup_model()
        policy: Any = self.policy
        self._actor = soft.Policy(policy.actor)
        self._critic = memory.Networks(policy.critic.q_networks, policy.critic.optimizer)
        self._temperature = soft.Temperature(self)

    def _update(self, step: int, observation: Floats, *rest: Floats) -> dict[str, float]:
        temperature = self._temperature.value
        losses = {"ent_coef": temperature}
        losses["critic_loss"] = self._update_critic(temperature, observation, *rest)
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
        # One pass for both, so that both count in the statistics of the batch.
        now = np.concatenate([observation, action], axis=1)
        then = np.concatenate([following, drawn.action], axis=1)
        gradient, q = self._critic.forward(np.concatenate([now, then]), training=True)
        value = q[:, n:].min(axis=0) - np.float32(temperature) * drawn.density[:, None]
        loss, slope = soft.squared_error(q[:, :n], reward + discount * value, 0.5)
        gradient(np.concatenate([slope, np.zeros_like(slope)], axis=1), True)
        self._critic.update()
        return loss

    def _update_actor(self, observation: Floats, temperature: float) -> dict[str, float]:
        """Update actor and temperature once; return their losses."""
        drawn = self._actor.sample(observation, training=True)
        losses = self._temperature.update(drawn.density)
        losses["actor_loss"] = drawn.climb(self._critic, soft.least_value, temperature)
        return losses
