"""`statistics.crossed` for many simulated tables at once; a test holds the two against each other."""

from __future__ import annotations

import numpy as np

from auvbench.statistics.crossed import Crossed
from benchmarks.statistics.worlds import FloatArray


def crossed(data: FloatArray, *, rate: bool, least: float = -np.inf, most: float = np.inf) -> Crossed:
    """The pieces of the variance of agents (tables, n, S, E) with several seeds and no value missing."""
    tables, n, S, E = data.shape
    rows, columns = data.mean(axis=3), data.mean(axis=2)
    mean = rows.mean(axis=2)
    between = rows.var(axis=2, ddof=1) / S
    square = (data**2).sum(axis=(2, 3)) - S * E * mean**2
    square -= E * ((rows - mean[..., None]) ** 2).sum(axis=2)
    square -= S * ((columns - mean[..., None]) ** 2).sum(axis=2)
    residual = np.maximum(square, 0.0) / ((S - 1) * (E - 1)) / (S * E)
    deviation = columns - mean[..., None]
    covariance = deviation @ deviation.transpose(0, 2, 1) / (E - 1) / E
    if rate:
        edge = (mean == 0) | (mean == 1)
        shrunk = (mean * S * E + 1) / (S * E + 2)
        between = np.where(edge, shrunk * (1 - shrunk) / (S * E), between)
        least, most = 0.0, 1.0

    def all_(value: float) -> FloatArray:
        return np.full((tables, n), float(value))

    return Crossed(
        mean,
        all_(S),
        between,
        residual,
        covariance,
        all_(E),
        all_(S * E),
        all_(S - 1),
        rate,
        all_(least),
        all_(most),
    )


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
