"""The bootstrap: of one sample, and of training seeds and scenarios at once, paired between agents.

A resample of scenarios is a vector of multiplicities, so the resampled means of all agents are one product of
matrices: multiplicities (resamples, episodes) times values (episodes, seeds of all agents).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from auvbench.statistics.intervals import FloatArray

Statistic = Callable[[FloatArray, int], FloatArray]
"""f(values, axis) -> statistic along the axis, vectorised over the others"""


def mean(values: FloatArray, axis: int = -1) -> FloatArray:
    """Arithmetic mean along `axis`."""
    return np.asarray(np.mean(values, axis=axis))


def median(values: FloatArray, axis: int = -1) -> FloatArray:
    """Median along `axis`."""
    return np.asarray(np.median(values, axis=axis))


def iqm(values: FloatArray, axis: int = -1) -> FloatArray:
    """Interquartile mean: the mean of what is left when a quarter is cut off at either end.

    Agarwal et al. (2021, NeurIPS), as rliable computes it: of n values, floor(n/4) are cut at each end.

    >>> float(iqm(np.array([0.0, 1.0, 2.0, 3.0, 100.0, 3.0, 2.0, -50.0])))
    2.0
    """
    from scipy.stats import trim_mean  # half a second of imports that most reports do not need

    return np.asarray(trim_mean(values, 0.25, axis=axis))


def _resample(
    values: FloatArray, statistic: Statistic, resamples: int, rng: np.random.Generator
) -> FloatArray:
    """(resamples,) bootstrap values of the statistic of a sample (n,), in blocks of bounded memory."""
    n = len(values)
    block = max(1, 4_000_000 // max(n, 1))
    parts = [
        statistic(values[rng.integers(n, size=(min(block, resamples - start), n))], -1)
        for start in range(0, resamples, block)
    ]
    return np.concatenate(parts)


def percentile(
    values: FloatArray,
    statistic: Statistic = mean,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of one sample (n,): Efron & Tibshirani (1993), chapter 13."""
    replicates = _resample(np.asarray(values, dtype=np.float64), statistic, resamples, rng)
    tail = (1 - confidence) / 2
    low, high = np.quantile(replicates, [tail, 1 - tail])
    return float(low), float(high)


def bca(
    values: FloatArray,
    statistic: Statistic = mean,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Bias-corrected and accelerated bootstrap interval of a statistic of one sample (n,).

    Efron (1987, JASA 82:171); Efron & Tibshirani (1993), eq. 14.9 to 14.15: the percentiles are taken at
    Phi(z0 + (z0 + z) / (1 - a (z0 + z))), z0 from the share of resamples below the estimate (half of the equal
    ones), a from the jackknife. Where all resamples agree the interval is that value.
    """
    values = np.asarray(values, dtype=np.float64)
    n = len(values)
    if n < 2:
        raise ValueError("bca needs at least 2 values")
    estimate = float(statistic(values, -1))
    replicates = _resample(values, statistic, resamples, rng)
    if replicates.min() == replicates.max():
        return float(replicates[0]), float(replicates[0])
    share = ((replicates < estimate).mean() + (replicates <= estimate).mean()) / 2
    z0 = float(ndtri(np.clip(share, 0.5 / resamples, 1 - 0.5 / resamples)))
    others = np.broadcast_to(values, (n, n))[~np.eye(n, dtype=bool)].reshape(n, n - 1)
    influence = statistic(others, -1)
    influence = influence.mean() - influence
    spread = float((influence**2).sum())
    acceleration = float((influence**3).sum()) / (6 * spread**1.5) if spread > 0 else 0.0
    tail = (1 - confidence) / 2
    z = ndtri(np.array([tail, 1 - tail]))
    levels = ndtr(z0 + (z0 + z) / (1 - acceleration * (z0 + z)))
    low, high = np.quantile(replicates, levels)
    return float(low), float(high)


def multiplicities(n: int, resamples: int, rng: np.random.Generator, draws: int | None = None) -> FloatArray:
    """(resamples, n) how often each of n units is drawn in `draws` (default n) draws with replacement."""
    return rng.multinomial(n if draws is None else draws, np.full(n, 1 / n), size=resamples).astype(
        np.float64
    )


def seed_weights(
    seeds: int, resamples: int, rng: np.random.Generator, *, rescaled: bool = True
) -> FloatArray:
    """(resamples, seeds) weights of the training seeds, each row of sum 1.

    Drawing S of S seeds makes the spread of their mean too small by the factor (S - 1)/S, a third of the variance
    with three seeds. `rescaled` draws S - 1, which makes the variance right: Rao & Wu (1988, JASA 83:231) with
    m = n - 1, McCarthy & Snowden (1985). One seed has the weight 1.
    """
    if seeds == 1:
        return np.ones((resamples, 1))
    draws = seeds - 1 if rescaled else seeds
    return multiplicities(seeds, resamples, rng, draws) / draws


def paired_means(
    data: Sequence[FloatArray], scenarios: FloatArray, seeds: Sequence[FloatArray]
) -> FloatArray:
    """Resampled means (resamples, agents) of arrays (S_i, E): the same scenarios for all, each agent's own seeds.

    `scenarios` (resamples, E) are multiplicities, `seeds` one array (resamples, S_i) of weights per agent. NaN is
    "no value" and is left out of the mean.
    """
    stacked = np.concatenate(list(data))
    there = np.isfinite(stacked)
    totals = scenarios @ np.where(there, stacked, 0.0).T
    counts = (
        np.full_like(totals, scenarios.shape[1]) if there.all() else scenarios @ there.astype(np.float64).T
    )
    result = np.empty((len(scenarios), len(data)))
    start = 0
    for i, weights in enumerate(seeds):
        rows = slice(start, start + weights.shape[1])
        with np.errstate(invalid="ignore", divide="ignore"):
            result[:, i] = (weights * totals[:, rows]).sum(axis=1) / (weights * counts[:, rows]).sum(axis=1)
        start = rows.stop
    return result


def hierarchical(
    values: FloatArray,
    statistic: Statistic = mean,
    *,
    confidence: float = 0.95,
    resamples: int = 2000,
    rng: np.random.Generator,
    rescaled: bool = True,
) -> tuple[float, float]:
    """Percentile interval of a statistic of the values (S, E), resampling training seeds and then scenarios.

    The columns drawn are the same for all seeds drawn, since the seeds share the scenarios. With few seeds the
    interval is too short with any resampling (docs/statistics-appendix.md has the measured coverage): the rates and
    means of the tables use `crossed.means` instead; this is for statistics without a formula, such as the IQM.
    """
    values = np.asarray(values, dtype=np.float64)
    S, E = values.shape
    draws = max(S - 1, 1) if rescaled else S
    replicates = np.empty(resamples)
    for b in range(resamples):
        rows = rng.integers(S, size=draws)
        replicates[b] = float(statistic(values[rows][:, rng.integers(E, size=E)].reshape(-1), -1))
    tail = (1 - confidence) / 2
    low, high = np.quantile(replicates, [tail, 1 - tail])
    return float(low), float(high)
