"""An ensemble of networks that predicts the change of a vehicle's motion in one agent step.

Each member is a probabilistic network: it returns mean and variance of a normal distribution, and learns by maximum likelihood from a
bootstrap sample of the transitions (Chua, Calandra, McAllister and Levine 2018, "Deep reinforcement learning in a handful of trials using
probabilistic dynamics models", NeurIPS, section 4; bounds of the variance: appendix A.1). The networks, their gradients and AdamW are
PyTorch's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

Floats = NDArray[np.float32]

LEAST_SCALE = 1e-3
"""smallest scale by which inputs and changes are divided"""
BOUND_WEIGHT = 0.01
"""weight, in the loss, of the distance between the variance's upper and lower bound (Chua et al. 2018, appendix A.1)"""


class Ensemble(nn.Module):
    """Networks that map inputs (n_in,) to mean and variance of changes (n_out,); all members are computed as one batch.

    Args:
        members: number of networks.
        n_in: size of an input.
        n_out: size of a change.
        widths: sizes of the hidden layers.
        seed: seed of the initial weights.
    """

    def __init__(self, members: int, n_in: int, n_out: int, widths: Sequence[int], seed: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        sizes = [n_in, *widths, 2 * n_out]
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for fan_in, fan_out in itertools.pairwise(sizes):
            weight = torch.randn(members, fan_in, fan_out, generator=generator) / math.sqrt(fan_in)
            self.weights.append(nn.Parameter(weight))
            self.biases.append(nn.Parameter(torch.zeros(members, 1, fan_out)))
        self.high = nn.Parameter(torch.full((n_out,), 0.5))
        """(n_out,) upper bound of the logarithm of the variance"""
        self.low = nn.Parameter(torch.full((n_out,), -10.0))
        """(n_out,) lower bound of the logarithm of the variance"""
        self.input_mean: Tensor
        self.input_scale: Tensor
        self.output_scale: Tensor
        self.register_buffer("input_mean", torch.zeros(n_in))
        self.register_buffer("input_scale", torch.ones(n_in))
        self.register_buffer("output_scale", torch.ones(n_out))

    @property
    def members(self) -> int:
        """Return the number of networks."""
        return int(self.weights[0].shape[0])

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and the logarithm of the variance of scaled changes, (members, n, n_out) each.

        Args:
            rows: (members, n, n_in) scaled inputs.
        """
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            rows = nn.functional.silu(torch.baddbmm(bias, rows, weight))
        mean, spread = torch.baddbmm(self.biases[-1], rows, self.weights[-1]).chunk(2, dim=2)
        return mean, bounded(spread, self.low, self.high)

    def scale_to(self, inputs: Tensor, changes: Tensor) -> None:
        """Set the scales from data: inputs (n, n_in) get mean 0 and deviation 1, changes (n, n_out) a root mean square of 1."""
        self.input_mean.copy_(inputs.mean(0))
        self.input_scale.copy_(inputs.std(0).clamp_min(LEAST_SCALE))
        self.output_scale.copy_(changes.square().mean(0).sqrt().clamp_min(LEAST_SCALE))

    def folded(self) -> list[tuple[Tensor, Tensor]]:
        """Return weights and biases of the layers. The first layer includes the inputs' scaling, the last the outputs' scaling.

        The last layer gives the mean change and the unbounded logarithm of the variance of the scaled change.
        """
        layers = [(w.detach(), b.detach()) for w, b in zip(self.weights, self.biases, strict=True)]
        weight, bias = layers[0]
        weight = weight / self.input_scale[:, None]
        layers[0] = weight.contiguous(), bias - (self.input_mean @ weight)[:, None]
        weight, bias = layers[-1]
        factor = torch.cat([self.output_scale, torch.ones_like(self.output_scale)])
        layers[-1] = (weight * factor).contiguous(), bias * factor
        return layers


def bounded(spread: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return the logarithms of variances `spread`, limited smoothly to `low` .. `high` (Chua et al. 2018, appendix A.1)."""
    spread = high - nn.functional.softplus(high - spread)
    return low + nn.functional.softplus(spread - low)


def fit(
    ensemble: Ensemble,
    optimizer: torch.optim.Optimizer,
    inputs: Floats,
    changes: Floats,
    *,
    steps: int,
    batch: int,
    generator: np.random.Generator,
) -> float:
    """Continue the training of an ensemble on transitions; return the mean loss.

    Args:
        inputs: (n, n_in).
        changes: (n, n_out).
        steps: number of gradient steps.
        batch: number of transitions per step and member.
        generator: generator of the bootstrap samples and batches.
    """
    n, members = len(inputs), ensemble.members
    x, y = torch.from_numpy(inputs), torch.from_numpy(changes)
    with torch.no_grad():
        ensemble.scale_to(x, y)
        x, y = (x - ensemble.input_mean) / ensemble.input_scale, y / ensemble.output_scale
    bootstrap = generator.integers(n, size=(members, n))
    total = 0.0
    for _ in range(steps):
        picked = generator.integers(n, size=(members, batch))
        rows = torch.from_numpy(np.take_along_axis(bootstrap, picked, axis=1))
        mean, spread = ensemble(x[rows])
        error = ((mean - y[rows]).square() * torch.exp(-spread) + spread).mean()
        loss = error + BOUND_WEIGHT * (ensemble.high - ensemble.low).sum()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        total += float(error.detach())
    return total / steps
