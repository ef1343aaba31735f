"""`statistics.crossed` for many simulated tables at once; a test holds the two against each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.statistics.crossed import Crossed, between_odds
from benchmarks.statistics.worlds import FloatArray


def crossed(
    data: Sequence[FloatArray], *, rate: bool, least: float = -np.inf, most: float = np.inf
) -> Crossed:
    """Return the pieces of the variance of agents, arrays (tables, S_i, E) with no value missing."""
    if rate:
        least, most = 0.0, 1.0
    E = data[0].shape[2]
    pieces = [_layout(x) for x in data]
    mean, between, residual = (np.stack([p[k] for p in pieces], axis=1) for k in range(3))
    columns = np.stack([x.mean(axis=1) for x in data], axis=1)
    odds = np.stack([between_odds(x.mean(axis=2), E, least, most) for x in data], axis=1)
    seeds = np.broadcast_to([float(x.shape[1]) for x in data], mean.shape)
    deviation = columns - mean[..., None]
    covariance = deviation @ deviation.transpose(0, 2, 1) / (E - 1) / E
    if rate:
        edge = (mean == 0) | (mean == 1)
        shrunk = (mean * seeds * E + 1) / (seeds * E + 2)
        variance = shrunk * (1 - shrunk) / (seeds * E)
        between = np.where(edge & (seeds > 1), variance, between)
        diagonal = np.einsum("tii->ti", covariance)
        diagonal[...] = np.where(edge & (seeds == 1), variance, diagonal)

    def all_(value: float) -> FloatArray:
        return np.full(mean.shape, float(value))

    df = np.where(seeds > 1, seeds - 1, np.inf)
    ends = all_(least), all_(most)
    return Crossed(mean, seeds, between, residual, covariance, all_(E), seeds * E, df, rate, *ends, odds)


def _layout(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, A and R (tables,) of one agent's values (tables, S, E)."""
    _, S, E = x.shape
    rows, columns = x.mean(axis=2), x.mean(axis=1)
    mean = rows.mean(axis=1)
    if S == 1:
        return mean, np.zeros_like(mean), np.zeros_like(mean)
    square = (x**2).sum(axis=(1, 2)) - S * E * mean**2
    square -= E * ((rows - mean[:, None]) ** 2).sum(axis=1)
    square -= S * ((columns - mean[:, None]) ** 2).sum(axis=1)
    return mean, rows.var(axis=1, ddof=1) / S, np.maximum(square, 0.0) / ((S - 1) * (E - 1)) / (S * E)


def upper(p: FloatArray) -> FloatArray:
    """The pairs (tables, n (n - 1) / 2) of symmetric matrices (tables, n, n)."""
    i, j = np.triu_indices(p.shape[-1], 1)
    return p[..., i, j]


def holm(p: FloatArray) -> FloatArray:
    """`statistics.holm` along the last axis."""
    order = np.argsort(p, axis=-1, kind="stable")
    factors = np.arange(p.shape[-1], 0, -1)
    adjusted = np.minimum(np.maximum.accumulate(factors * np.take_along_axis(p, order, -1), axis=-1), 1.0)
    result = np.empty_like(p)
    np.put_along_axis(result, order, adjusted, -1)
    return result
