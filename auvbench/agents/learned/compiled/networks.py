"""Compute forward and backward passes of ReLU networks, several of one shape at once.

A layer may begin with batch renormalisation (Ioffe 2017), as CrossQ's layers do. The parameters of K networks
are the rows of an array (K, P): for each layer, scale and shift of its inputs (if it normalises them), then
its weights (outputs, inputs), then its biases. Running means and variances are the rows of two arrays (K, S).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.learned.compiled.product import product
from auvbench.dynamics.compiled import compiled

Floats = NDArray[np.float32]
Sizes = NDArray[np.int64]
Flags = NDArray[np.bool_]

RUNNING, BATCH, RENORM = 0, 1, 2
"""Statistics by which inputs are normalised: the running statistics; the batch's statistics, during the warm-up;
or the batch's statistics, corrected towards the running statistics.
"""
SMALL = 1e-3
"""Constant that is added to a variance before its square root is taken, as in sb3-contrib."""
R_MAX, D_MAX = 3.0, 5.0
"""Limits of the correction's factor r and summand d, as in sb3-contrib."""
STATISTICS = np.dtype(
    [
        ("centre", np.float32),  # subtracted mean
        ("inverse", np.float32),  # reciprocal of the standard deviation
        ("average", np.float32),  # batch mean
        ("share", np.float32),  # derivative of the variance in `inverse` with respect to the batch variance
        ("pull", np.float32),  # derivative of the negative subtracted mean with respect to the batch variance
    ]
)
"""Record that `normalise` stores for each input"""


@compiled(error_model="numpy")
def normalise(
    x: Floats,
    y: Floats,
    n: int,
    affine: Floats,
    mean: Floats,
    variance: Floats,
    stored: Any,
    mode: int,
    momentum: float,
) -> None:
    """Store the normalised rows of `x` (n, d) in `y` (n, d), and update the running statistics. Both arrays are flat.

    Args:
        x, y, n: inputs, outputs, number of rows.
        affine: scales (d,), then shifts (d,).
        mean, variance: running statistics (d,), updated unless `mode` is RUNNING.
        stored: (d,) records of STATISTICS, overwritten with what `normalise_gradient` needs.
        mode: RUNNING, BATCH or RENORM.
        momentum: share by which the running statistics are updated.
    """
    d = len(mean)
    small, one, half = np.float32(SMALL), np.float32(1.0), np.float32(0.5)
    if mode == RUNNING:
        stored.centre[:] = mean
        stored.inverse[:] = one / np.sqrt(variance + small)
    else:
        average, spread = np.zeros(d, np.float32), np.zeros(d, np.float32)
        for i in range(n):
            for j in range(d):
                average[j] += x[i * d + j]
        average /= np.float32(n)
        for i in range(n):
            for j in range(d):
                spread[j] += (x[i * d + j] - average[j]) ** 2
        spread /= np.float32(n - 1)
        stored.average[:] = average
        for j in range(d):
            r, shift = one, np.float32(0.0)
            if mode == RENORM:
                running = np.sqrt(variance[j] + small)
                r = np.sqrt(spread[j] + small) / running
                r = min(max(r, np.float32(1.0 / R_MAX)), np.float32(R_MAX))
                shift = min(max((average[j] - mean[j]) / running, np.float32(-D_MAX)), np.float32(D_MAX))
            own = stored[j]
            own.centre = average[j] - shift * np.sqrt(spread[j]) / r
            own.inverse = one / np.sqrt(spread[j] / (r * r) + small)
            own.share = one / (r * r)
            own.pull = np.float32(0.0)
            if shift != 0.0:
                own.pull = half * shift / (r * np.sqrt(spread[j]))
        mean += np.float32(momentum) * (average - mean)
        variance += np.float32(momentum) * (spread - variance)
    factor = affine[:d] * stored.inverse
    offset = affine[d:] - factor * stored.centre
    for i in range(n):
        for j in range(d):
            y[i * d + j] = x[i * d + j] * factor[j] + offset[j]


@compiled(error_model="numpy")
def normalise_gradient(
    x: Floats, slope: Floats, n: int, affine: Floats, stored: Any, gradient: Floats, mode: int
) -> None:
    """Replace the gradient of the outputs, the flat `slope` (n, d), by the gradient of the inputs.

    Args:
        x, n, affine, stored, mode: see `normalise`.
        slope: overwritten.
        gradient: gradient of scales (d,) and shifts (d,), overwritten; empty if it is not needed.
    """
    d = stored.shape[0]
    factor = affine[:d] * stored.inverse
    if mode == RUNNING:
        for i in range(n):
            for j in range(d):
                slope[i * d + j] *= factor[j]
        return
    shifts, scales = np.zeros(d, np.float32), np.zeros(d, np.float32)
    centre, mean = stored.centre.copy(), stored.average.copy()  # contiguous, for the loops over rows
    for i in range(n):
        for j in range(d):
            shifts[j] += slope[i * d + j]
            scales[j] += slope[i * d + j] * (x[i * d + j] - centre[j])
    scales *= stored.inverse
    if len(gradient) > 0:
        gradient[:d] = scales
        gradient[d:] = shifts
    by_mean = -factor * shifts
    by_variance = np.float32(-0.5) * factor * stored.inverse * scales * stored.share - by_mean * stored.pull
    by_mean /= np.float32(n)
    by_variance *= np.float32(2.0 / (n - 1))
    for i in range(n):
        for j in range(d):
            deviation = x[i * d + j] - mean[j]
            slope[i * d + j] = slope[i * d + j] * factor[j] + by_mean[j] + by_variance[j] * deviation


@compiled(error_model="numpy")
def forward(
    values: Floats,
    sizes: Sizes,
    normalised: Flags,
    mean: Floats,
    variance: Floats,
    x: Floats,
    mode: int,
    momentum: float,
) -> tuple[Floats, Floats, Any, Floats]:
    """Return hidden outputs, scaled inputs and stored statistics, all for `backward`, and the outputs (K, n, o).

    Args:
        values: parameters (K, P).
        sizes: widths of inputs, hidden layers, outputs.
        normalised: for each layer, whether it normalises its inputs.
        mean, variance: running statistics (K, S), updated unless `mode` is RUNNING.
        x: inputs (n, d).
        mode: RUNNING, BATCH or RENORM.
        momentum: share by which the running statistics are updated.
    """
    n, layers = len(x), len(sizes) - 1
    hidden = np.empty((len(values), n * sizes[1:-1].sum()), np.float32)
    scaled = np.empty((len(values), n * sizes[:-1][normalised].sum()), np.float32)
    stored = np.empty((len(values), mean.shape[1]), STATISTICS)
    out = np.empty((len(values), n, sizes[-1]), np.float32)
    for network in range(len(values)):
        source, place, at, before, channel = x.reshape(-1), 0, 0, 0, 0
        for layer in range(layers):
            d, o = sizes[layer], sizes[layer + 1]
            both = 2 * d  # scales and shifts
            last = layer == layers - 1
            if normalised[layer]:
                y = scaled[network, before : before + n * d]
                normalise(
                    source,
                    y,
                    n,
                    values[network, place : place + both],
                    mean[network, channel : channel + d],
                    variance[network, channel : channel + d],
                    stored[network, channel : channel + d],
                    mode,
                    momentum,
                )
                source, place, channel, before = y, place + both, channel + d, before + n * d
            target = out[network].reshape(-1) if last else hidden[network, at : at + n * o]
            product(source, d, 1, values[network, place:], 1, d, target, n, o, d)
            bias = values[network, place + o * d : place + o * d + o]
            least = np.float32(-np.inf if last else 0.0)
            for i in range(n):
                for j in range(o):
                    target[i * o + j] = max(target[i * o + j] + bias[j], least)
            source, place, at = target, place + o * d + o, at + n * o
    return hidden, scaled, stored, out


@compiled(error_model="numpy")
def backward(
    values: Floats,
    sizes: Sizes,
    normalised: Flags,
    x: Floats,
    hidden: Floats,
    scaled: Floats,
    stored: Any,
    upstream: Floats,
    gradient: Floats,
    mode: int,
    inputs: bool,
) -> Floats:
    """Return the gradient of the inputs (n, d), summed over networks, and store the gradient of the
    parameters.

    Args:
        values, sizes, normalised, x, mode: see `forward`.
        hidden, scaled, stored: results of `forward`.
        upstream: gradient of the outputs (K, n, o).
        gradient: gradient of the parameters (K, P), overwritten; (K, 0) if it is not needed.
        inputs: whether to compute the gradient of the inputs; otherwise the result is zeros.
    """
    n = len(x)
    weights = gradient.shape[1] > 0
    total = np.zeros((n, sizes[0]), np.float32)
    sums = total.reshape(-1)
    buffers = np.empty((2, n * sizes.max()), np.float32)
    for network in range(len(values)):
        place, at, before, channel = values.shape[1], hidden.shape[1], scaled.shape[1], stored.shape[1]
        d = upstream[network].reshape(-1)
        for layer in range(len(sizes) - 2, -1, -1):
            i, o = sizes[layer], sizes[layer + 1]
            place -= o * i + o
            at -= n * i
            before -= n * i if normalised[layer] else 0
            unscaled = hidden[network, at : at + n * i] if layer else x.reshape(-1)
            source = scaled[network, before : before + n * i] if normalised[layer] else unscaled
            if weights:
                product(d, 1, o, source, i, 1, gradient[network, place:], o, i, n)
                bias = gradient[network, place + o * i : place + o * i + o]
                bias[:] = 0.0
                for r in range(n):
                    for q in range(o):
                        bias[q] += d[r * o + q]
            if not (layer or inputs or normalised[layer]):
                continue
            target = buffers[layer % 2, : n * i]
            product(d, o, 1, values[network, place:], i, 1, target, n, i, o)
            if normalised[layer]:
                both = 2 * i  # scales and shifts
                place -= both
                channel -= i
                affine = gradient[network, place : place + both] if weights else gradient[network]
                statistics = stored[network, channel : channel + i]
                own = values[network, place : place + both]
                normalise_gradient(unscaled, target, n, own, statistics, affine, mode)
            if layer:
                for q in range(n * i):
                    target[q] = target[q] if unscaled[q] > 0.0 else np.float32(0.0)
            elif inputs:
                for q in range(n * i):
                    sums[q] += target[q]
            d = target
    return total
