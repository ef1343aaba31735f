"""Forward and backward passes of networks with ReLU, several of one shape at once.

The parameters of K networks are the rows of an array (K, P): for each layer its weights (outputs, inputs), then its biases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.learned.compiled.product import product
from auvbench.dynamics.compiled import compiled

Floats = NDArray[np.float32]
Sizes = NDArray[np.int64]


@compiled(error_model="numpy")
def forward(values: Floats, sizes: Sizes, x: Floats) -> tuple[Floats, Floats]:
    """Return the outputs of hidden layers, flat (K, n * sum of widths), and of the networks (K, n, o), for inputs (n, d)."""
    n, layers = len(x), len(sizes) - 1
    hidden = np.empty((len(values), n * sizes[1:-1].sum()), np.float32)
    out = np.empty((len(values), n, sizes[-1]), np.float32)
    for network in range(len(values)):
        source, place, at = x.reshape(-1), 0, 0
        for layer in range(layers):
            d, o = sizes[layer], sizes[layer + 1]
            last = layer == layers - 1
            target = out[network].reshape(-1) if last else hidden[network, at : at + n * o]
            product(source, d, 1, values[network, place:], 1, d, target, n, o, d)
            bias = values[network, place + o * d : place + o * d + o]
            least = np.float32(-np.inf if last else 0.0)
            for i in range(n):
                for j in range(o):
                    target[i * o + j] = max(target[i * o + j] + bias[j], least)
            source, place, at = target, place + o * d + o, at + n * o
    return hidden, out


@compiled(error_model="numpy")
def backward(
    values: Floats,
    sizes: Sizes,
    x: Floats,
    hidden: Floats,
    upstream: Floats,
    gradient: Floats,
    inputs: bool,
) -> Floats:
    """Return the gradient of the inputs (n, d), summed over networks, and store that of the parameters.

    Args:
        values: parameters (K, P).
        sizes: widths of inputs, hidden layers, outputs.
        x: inputs (n, d) of the forward pass.
        hidden: what it returned, for these rows.
        upstream: gradient of the outputs (K, n, o).
        gradient: (K, P), overwritten; (K, 0) where it is not wanted.
        inputs: whether that of the inputs is wanted; otherwise zeros come back.
    """
    n = len(x)
    weights = gradient.shape[1] > 0
    total = np.zeros((n, sizes[0]), np.float32)
    sums = total.reshape(-1)
    widest = sizes.max()
    buffers = np.empty((2, n * widest), np.float32)
    for network in range(len(values)):
        place, at = values.shape[1], hidden.shape[1]
        d = upstream[network].reshape(-1)
        for layer in range(len(sizes) - 2, -1, -1):
            i, o = sizes[layer], sizes[layer + 1]
            place -= o * i + o
            at -= n * i
            source = hidden[network, at : at + n * i] if layer else x.reshape(-1)
            if weights:
                product(d, 1, o, source, i, 1, gradient[network, place:], o, i, n)
                bias = gradient[network, place + o * i : place + o * i + o]
                bias[:] = 0.0
                for r in range(n):
                    for q in range(o):
                        bias[q] += d[r * o + q]
            if layer == 0 and not inputs:
                continue
            target = buffers[layer % 2, : n * i]
            product(d, o, 1, values[network, place:], i, 1, target, n, i, o)
            if layer:
                for q in range(n * i):
                    target[q] = target[q] if source[q] > 0.0 else np.float32(0.0)
            else:
                for q in range(n * i):
                    sums[q] += target[q]
            d = target
    return total
