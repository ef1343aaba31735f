"""Compute means and rates over training seeds and test scenarios, with t-type intervals; typical.py compares
agents.

An agent's data are an array (seeds S, episodes E). Every trained policy is tested in the same scenarios, so
seeds and scenarios are crossed. The model is

    x[s, e] = mu + a[s] + b[e] + r[s, e],

where a is the effect of a training seed, b the difficulty of a scenario, and r the residual. The mean then
has the variance Var(a)/S + Var(b)/E + Var(r)/(S E). This variance is estimated as A + max(B - R, 0) with

    A = variance between the seeds' means / S       expected value Var(a)/S + Var(r)/(S E)
    B = variance between the scenarios' means / E   expected value Var(b)/E + Var(r)/(S E)
    R = mean square of the residuals / (S E)        expected value            Var(r)/(S E)

(two-way layout without replication: Searle, Casella & McCulloch, Variance Components, 1992, chapter 4). Seeds and
scenarios have their own quantiles of Student's t, and the squares add up (Howe 1974, JASA 69:789):

    half width² = A t(S - 1)² + max(B - R, 0) t(E - 1)²

With 2 or 3 seeds, an interval from a single quantile (Satterthwaite's degrees of freedom) is too short, and
so is every bootstrap interval (docs/statistics-appendix.md). With one seed A and R are 0: the interval is
conditional on that seed and covers only test episodes. An interval never exceeds the range of possible
values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvbench.statistics.intervals import (
    BoolArray,
    Estimate,
    FloatArray,
    Spread,
    quantile,
    score_interval,
    welch,
)

EPISODES_ONLY = "test episodes"
SEEDS_AND_EPISODES = "training seeds and test episodes"
MIXED = "test episodes, and training seeds where there are several"


def covers(seeds: FloatArray) -> str:
    """Return a text that says which uncertainty an interval covers; `seeds` are the agents' numbers of seeds."""
    if seeds.min() > 1:
        return SEEDS_AND_EPISODES
    return MIXED if seeds.max() > 1 else EPISODES_ONLY


@dataclass(frozen=True, slots=True, eq=False)
class Crossed:
    """Means of n agents and the parts of their variance; NaN for an agent without a value."""

    mean: FloatArray  # (n,) mean over an agent's values
    seeds: FloatArray  # (n,) S, number of seeds with a value
    between_seeds: FloatArray  # (n,) A of the module's docstring; 0 with one seed
    residual: FloatArray  # (n,) R of the module's docstring; 0 with one seed
    between_scenarios: FloatArray  # (n, n) covariance between agents of the scenarios' means / E; diagonal: B
    episodes: FloatArray  # (n,) number of scenarios with a value
    values: FloatArray  # (n,) number of values
    seeds_df: FloatArray  # (n,) degrees of freedom of between_seeds; infinite with one seed
    rate: bool
    least: FloatArray  # (n,) smallest value that a mean can have; infinite without a limit
    most: FloatArray  # (n,) largest value that a mean can have; infinite without a limit

    @property
    def variance(self) -> FloatArray:
        """Return the (n,) variances of the means."""
        return self.between_seeds + self.scenarios

    @property
    def scenarios(self) -> FloatArray:
        """Return, for each agent, the part of `variance` that comes from the scenarios: (n,)."""
        return np.maximum(np.diagonal(self.between_scenarios) - self.residual, 0.0)


def crossed(
    data: Sequence[FloatArray],
    *,
    rate: bool = False,
    paired: bool = True,
    bounds: tuple[ArrayLike, ArrayLike] = (-np.inf, np.inf),
) -> Crossed:
    """Return the means of agents and the parts of their variance.

    NaN means "no value". Means are over the available values. The parts of the variance assume that no value
    is missing, which is a good approximation if few are.

    For a rate, an agent with x successes in n trials, where x is 0 or n, gets the variance of the rate
    (x + 1)/(n + 2), because no failure in n trials does not prove a failure rate of zero. This variance counts as
    variance between seeds if the agent has several seeds, otherwise as variance between scenarios.

    Args:
        data: an array (S_i, E) per agent; the columns are the same E scenarios for all agents.
        rate: whether the values are 0 or 1.
        paired: whether to compute the covariances between agents; if not, they are NaN. `means` does not need them.
        bounds: smallest and largest possible value, each for all agents or (n,); ignored for a rate.

    Raises:
        ValueError: the agents have different numbers of scenarios.
    """
    if len({x.shape[1] for x in data}) > 1:
        raise ValueError(
            f"all agents must have the same number of scenarios, got {sorted({x.shape[1] for x in data})}"
        )
    n, E = len(data), data[0].shape[1]
    columns = np.full((n, E), np.nan)
    mean, between, residual = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    seeds, values = np.zeros(n), np.zeros(n)
    least, most = (
        np.broadcast_to(np.asarray(end, dtype=np.float64), (n,)) for end in ((0, 1) if rate else bounds)
    )
    for i, x in enumerate(data):
        present = np.isfinite(x)
        x, present = x[present.any(axis=1)], present[present.any(axis=1)]
        seeds[i], values[i] = len(x), present.sum()
        if len(x):
            mean[i], columns[i], between[i], residual[i] = _layout(x, present)
    covariance, episodes = _covariance(columns, paired)
    if rate:
        # With one scenario, the variance between scenarios is unknown. It is set to 0, and `limits` treats the scenario
        # as a single trial.
        single = np.flatnonzero((episodes == 1) & (seeds > 1))
        covariance[single, single] = 0.0
        for edge in np.flatnonzero((mean == 0.0) | (mean == 1.0)):
            i = int(edge)
            shrunk = (mean[i] * values[i] + 1) / (values[i] + 2)
            variance = shrunk * (1 - shrunk) / values[i]
            if seeds[i] > 1:
                between[i] = variance
            else:
                covariance[i, i] = variance
    seeds_df = np.where(seeds > 1, seeds - 1, np.inf)
    return Crossed(mean, seeds, between, residual, covariance, episodes, values, seeds_df, rate, least, most)


def _layout(x: FloatArray, present: BoolArray) -> tuple[float, FloatArray, float, float]:
    """Return the mean, the scenarios' means (E,), and A and R (see the module) of one agent's values (S, E)."""
    filled = np.where(present, x, 0.0)
    count = present.sum(axis=0)
    columns = np.divide(filled.sum(axis=0), count, out=np.full(x.shape[1], np.nan), where=count > 0)
    total = int(count.sum())
    mean = float(filled.sum() / total)
    S, E = len(x), int((count > 0).sum())
    if S == 1:
        return mean, columns, 0.0, 0.0
    rows = filled.sum(axis=1) / present.sum(axis=1)
    between = float(rows.var(ddof=1) / S)
    if E == 1:
        return mean, columns, between, 0.0
    residuals = np.where(present, x - rows[:, None] - columns[None, :] + mean, 0.0)
    return mean, columns, between, float((residuals**2).sum() / ((S - 1) * (E - 1)) / total)


def _covariance(columns: FloatArray, paired: bool) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (n, n) of the means over scenarios, and the number of scenarios (n,) behind each mean."""
    valid = np.isfinite(columns)
    weight = valid.astype(np.float64)
    episodes = weight.sum(axis=1)
    center = np.where(valid, columns, 0.0).sum(axis=1) / np.maximum(episodes, 1)
    deviation = np.where(valid, columns - center[:, None], 0.0)
    if not paired:
        with np.errstate(divide="ignore", invalid="ignore"):
            own = (deviation**2).sum(axis=1) / (episodes - 1) / episodes
        covariance = np.full((len(columns), len(columns)), np.nan)
        np.fill_diagonal(covariance, np.where(episodes < 2, np.nan, own))
        return covariance, episodes
    common = weight @ weight.T
    with np.errstate(divide="ignore", invalid="ignore"):
        covariance = (deviation @ deviation.T) / (common - 1) * common / np.outer(episodes, episodes)
    covariance[common < 2] = np.nan
    return covariance, episodes


def within(
    low: ArrayLike, value: ArrayLike, high: ArrayLike, least: ArrayLike, most: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the interval [low, high], cut to the range [least, most] but widened to contain the value."""
    return np.minimum(np.maximum(low, least), value), np.maximum(np.minimum(high, most), value)


def limits(table: Crossed, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper limit of each agent's rate or mean, at q standard errors; q is (n,) or (n, m)."""
    shape = (-1,) + (1,) * (q.ndim - 1)
    mean, variance = table.mean.reshape(shape), table.variance.reshape(shape)
    if not table.rate:
        half = q * np.sqrt(variance)
        return within(mean - half, mean, mean + half, table.least.reshape(shape), table.most.reshape(shape))
    seeds, values, episodes = (part.reshape(shape) for part in (table.seeds, table.values, table.episodes))
    # One seed: Wilson's interval with one trial per episode. Several seeds: Wilson's interval with the effective
    # number of trials, at which a binomial rate has this variance (Dean & Pagano 2015).
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = np.minimum(mean * (1 - mean) / variance, values)
    effective = np.where((mean <= 0) | (mean >= 1), values, effective)
    # A single scenario counts as one trial, for any number of seeds.
    effective = np.where(episodes == 1, np.minimum(effective, 1.0), effective)
    return score_interval(mean, np.where(seeds > 1, effective, episodes), q)


def means(table: Crossed, confidence: float = 0.95) -> list[Estimate]:
    """Return the mean of each agent with its interval, cut to the possible range.

    * Rate, one seed: Wilson's interval.
    * Rate, several seeds: Wilson's interval with the effective number of trials p (1 - p) / variance.
    * Other mean, one seed: Student's t over the episodes.
    * Other mean, several seeds: the formula of this module.

    A rate's interval never has zero width. An interval that cannot be computed (a mean of one episode) is NaN.
    """
    squares = table.between_seeds**2 / table.seeds_df
    spread = Spread(
        table.between_seeds, welch(table.between_seeds, squares), table.scenarios, table.episodes - 1
    )
    q = spread.quantile(confidence)
    if table.rate:
        q = np.where(table.seeds <= 1, quantile(confidence), q)
    low, high = limits(table, q)
    return [
        Estimate(float(m), float(a), float(b), confidence, covers(np.array([s])))
        for m, a, b, s in zip(table.mean, low, high, table.seeds, strict=True)
    ]
