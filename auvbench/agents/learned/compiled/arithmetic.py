"""Implement the updates' element-wise arithmetic: Adam, Polyak averaging, the squashed Gaussian, the quantile
loss.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled

Floats = NDArray[np.float32]

LOG_STD = -20.0, 2.0
"""Range to which SB3 clips the logarithm of the standard deviation."""
EPSILON = 1e-6
"""Constant that SB3 adds inside the logarithm of the squashed Gaussian's density."""


@compiled(error_model="numpy")
def adam(
    values: Floats,
    gradient: Floats,
    mean: Floats,
    square: Floats,
    step: int,
    rate: float,
    beta1: float,
    beta2: float,
    epsilon: float,
) -> None:
    """Update parameters and moments (P,) in place as `torch.optim.Adam` does (Kingma and Ba 2015); `step` counts from 1."""
    size = np.float32(rate / (1.0 - beta1**step))
    root = np.float32(1.0 / math.sqrt(1.0 - beta2**step))
    new1, keep2, new2 = np.float32(1.0 - beta1), np.float32(beta2), np.float32(1.0 - beta2)
    small = np.float32(epsilon)
    for j in range(len(values)):
        g = gradient[j]
        mean[j] += new1 * (g - mean[j])
        square[j] = keep2 * square[j] + new2 * g * g
        values[j] -= size * mean[j] / (np.sqrt(square[j]) * root + small)


@compiled(error_model="numpy")
def average(target: Floats, values: Floats, tau: float) -> None:
    """Move parameters (K, P) of target networks by a share `tau` towards the networks' parameters."""
    keep, new = np.float32(1.0 - tau), np.float32(tau)
    for k in range(len(target)):
        for j in range(target.shape[1]):
            target[k, j] = keep * target[k, j] + new * values[k, j]


@compiled(error_model="numpy")
def squash(out: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Return actions (n, n_u) and their log-densities (n,) of a Gaussian under tanh (Haarnoja et al. 2018, appendix C).

    Args:
        out: means and logarithms of standard deviations (n, 2 n_u).
        noise: standard normal (n, n_u).
    """
    n, n_u = noise.shape
    action = np.empty((n, n_u), np.float32)
    density = np.empty(n, np.float32)
    low, high, small = np.float32(LOG_STD[0]), np.float32(LOG_STD[1]), np.float32(EPSILON)
    constant, half, one = np.float32(0.5 * math.log(2.0 * math.pi)), np.float32(0.5), np.float32(1.0)
    for i in range(n):
        total = np.float32(0.0)
        for j in range(n_u):
            e, log_std = noise[i, j], min(max(out[i, n_u + j], low), high)
            a = np.tanh(out[i, j] + np.exp(log_std) * e)
            action[i, j] = a
            total -= half * e * e + log_std + constant + np.log(one - a * a + small)
        density[i] = total
    return action, density


@compiled(error_model="numpy")
def squash_gradient(
    out: Floats, noise: Floats, action: Floats, upstream: Floats, temperature: float
) -> Floats:
    """Return the gradient (n, 2 n_u) with respect to `out`, for a loss with known gradients of actions and
    log-densities.

    Args:
        out, noise, action: see `squash`.
        upstream: gradient with respect to the actions (n, n_u).
        temperature: gradient with respect to each log-density.
    """
    n, n_u = noise.shape
    gradient = np.empty((n, 2 * n_u), np.float32)
    low, high, small = np.float32(LOG_STD[0]), np.float32(LOG_STD[1]), np.float32(EPSILON)
    alpha, one, two = np.float32(temperature), np.float32(1.0), np.float32(2.0)
    for i in range(n):
        for j in range(n_u):
            a, log_std = action[i, j], out[i, n_u + j]
            slope = one - a * a
            d = slope * (upstream[i, j] + alpha * two * a / (slope + small))
            gradient[i, j] = d
            inside = low <= log_std <= high
            gradient[i, n_u + j] = d * np.exp(log_std) * noise[i, j] - alpha if inside else np.float32(0.0)
    return gradient


@compiled(error_model="numpy")
def quantile_loss(quantiles: Floats, targets: Floats) -> tuple[Any, Floats]:
    """Return the quantile Huber loss (Kuznetsov et al. 2020, eq. 10), as a mean over all pairs, and its gradient.

    Args:
        quantiles: quantiles of the critics (K, n, q).
        targets: target values (n, t).
    """
    critics, n, q = quantiles.shape
    t = targets.shape[1]
    gradient = np.empty_like(quantiles)
    loss: Any = 0.0
    share = np.float32(1.0 / (critics * n * q * t))
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    for k in range(critics):
        for i in range(n):
            for j in range(q):
                probability = np.float32((j + 0.5) / q)
                here, total, slope = quantiles[k, i, j], zero, zero
                for m in range(t):
                    delta = targets[i, m] - here
                    weight = one - probability if delta < zero else probability
                    clipped = min(max(delta, -one), one)
                    slope += weight * clipped
                    total += weight * clipped * (delta - half * clipped)
                loss += total
                gradient[k, i, j] = -share * slope
    return loss * share, gradient
