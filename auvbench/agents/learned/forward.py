"""The forward pass of a policy in a test: deterministic, and the same for a row whatever the batch."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import BasePolicy

ROWS = 64
"""The pass always runs on this many rows: matrix products of another shape may round differently, and a row of a table
must not depend on how many episodes were tested together."""


class Forward:
    """A policy that looks at the present observation alone."""

    def __init__(self, policy: BasePolicy) -> None:
        self._policy = policy

    def reset(self, n: int) -> None:
        """Begins `n` episodes."""

    def __call__(self, block: int, rows: torch.Tensor) -> torch.Tensor:
        """Actions (ROWS, n_u) for the block-th observations (ROWS, d) of the batch."""
        return self._policy._predict(rows, deterministic=True)


class RecurrentForward(Forward):
    """A policy with an LSTM: each episode's row keeps the state of its own, zeros at its beginning."""

    _policy: Any

    def reset(self, n: int) -> None:
        lstm = self._policy.lstm_actor
        shape = (lstm.num_layers, ROWS, lstm.hidden_size)
        self._states = [(torch.zeros(shape), torch.zeros(shape)) for _ in range(0, n, ROWS)]
        self._begins = torch.zeros(ROWS)  # none in the midst of a batch: `reset` begins them all

    def __call__(self, block: int, rows: torch.Tensor) -> torch.Tensor:
        action, self._states[block] = self._policy._predict(
            rows, lstm_states=self._states[block], episode_starts=self._begins, deterministic=True
        )
        return torch.as_tensor(action)


def of(policy: BasePolicy) -> Forward:
    """The forward pass of a policy; `reset` must follow."""
    return RecurrentForward(policy) if hasattr(policy, "lstm_actor") else Forward(policy)
