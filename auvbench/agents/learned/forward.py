"""The forward pass of a policy in a test: deterministic, and independent of the batch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from stable_baselines3.common.policies import BasePolicy

ROWS = 64
"""The pass always runs on this many rows: matrix products of another shape may round differently, and a row of a table
must not depend on how many episodes were tested together."""

ALIGNED = 16
"""Numbers from one row to the next are a multiple of this. Of rows that begin anywhere, matrix products with fewer than
twelve columns sum every other row in another order (MKL with AVX-512 on AMD EPYC), so that an episode's place in the
batch would be seen in its actions."""


@contextmanager
def aligned(layers: list[torch.nn.Linear]) -> Iterator[None]:
    """Gives the layers their rows as views of longer ones."""
    hooks = [layer.register_forward_pre_hook(_spaced) for layer in layers]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()


def _spaced(layer: torch.nn.Module, inputs: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, ...]:
    (rows,) = inputs
    width = rows.shape[-1]
    return (torch.nn.functional.pad(rows, (0, -width % ALIGNED))[..., :width],)


class Forward:
    """A policy that looks at the present observation alone."""

    def __init__(self, policy: BasePolicy) -> None:
        self._policy = policy
        self._uneven = [
            layer
            for layer in policy.modules()
            if isinstance(layer, torch.nn.Linear) and layer.in_features % ALIGNED
        ]

    def reset(self, n: int) -> None:
        """Begins `n` episodes."""

    def __call__(self, block: int, rows: torch.Tensor) -> torch.Tensor:
        """Actions (ROWS, n_u) for the block-th observations (ROWS, d) of the batch."""
        with aligned(self._uneven):
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
        with aligned(self._uneven):
            action, self._states[block] = self._policy._predict(
                rows, lstm_states=self._states[block], episode_starts=self._begins, deterministic=True
            )
        return torch.as_tensor(action)


def of(policy: BasePolicy) -> Forward:
    """The forward pass of a policy; `reset` must follow."""
    return RecurrentForward(policy) if hasattr(policy, "lstm_actor") else Forward(policy)
