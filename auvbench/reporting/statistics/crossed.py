"""Means and rates over training seeds and test scenarios, and differences of them, with t-type intervals.

The data of an agent are an array (seeds S, episodes E): every trained policy meets the same scenarios, so seeds
and scenarios are crossed. What may vary is taken as

    x[s, e] = mu + a[s] + b[e] + r[s, e],

a a training seed's luck, b a scenario's difficulty, r the rest; the mean then has the variance
Var(a)/S + Var(b)/E + Var(r)/(S E). It is estimated as A + max(B - R, 0) with

    A = variance between the seeds' means / S                      expects Var(a)/S + Var(r)/(S E)
    B = variance between the scenarios' means / E                  expects Var(b)/E + Var(r)/(S E)
    R = mean square of what is left after rows and columns / (S E) expects            Var(r)/(S E)

(two-way layout without replication: Searle, Casella & McCulloch, Variance Components, 1992, chapter 4). For a
weighted sum of agents A and R add up with squared weights, the seeds being independent, and B is the variance of
the weighted sum of the scenarios' means, in which b cancels as far as the agents find the same scenarios hard.
Each source has its own quantile of Student's t, and the squares add up (Howe 1974, JASA 69:789):

    half width² = A t(seeds)² + max(B - R, 0) t(scenarios)²

with S - 1 degrees of freedom for the seeds of one agent, Welch's for those of several, and E - 1 for scenarios.
One quantile with Satterthwaite's degrees of freedom for the sum was tried and covers too little with 2 or 3 seeds,
as does every bootstrap (docs/statistics.md). With one seed A and R are 0: the interval is conditional on that seed
and covers test episodes only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.reporting.model import Estimate
from auvbench.reporting.statistics.intervals import FloatArray, quantile, score_interval
from auvbench.reporting.statistics.spread import Spread, welch

EPISODES_ONLY = "test episodes"
SEEDS_AND_EPISODES = "training seeds and test episodes"
MIXED = "test episodes, and training seeds where there are several"


def covers(seeds: FloatArray) -> str:
    """What an interval covers that is made of agents with these numbers of seeds."""
    if seeds.min() > 1:
        return SEEDS_AND_EPISODES
    return MIXED if seeds.max() > 1 else EPISODES_ONLY


@dataclass(frozen=True, slots=True, eq=False)
class Crossed:
    """n agents' means and the pieces of their variance; NaN where an agent has no value."""

    mean: FloatArray  # (n,)
    seeds: FloatArray  # (n,) S, seeds with a value
    between_seeds: FloatArray  # (n,) A; 0 with one seed
    residual: FloatArray  # (n,) R; 0 with one seed
    between_scenarios: FloatArray  # (n, n) covariance of the scenarios' means / E; B on the diagonal
    episodes: FloatArray  # (n,) scenarios with a value
    values: FloatArray  # (n,) values in all
    seeds_df: FloatArray  # (n,) degrees of freedom of between_seeds; infinite with one seed
    rate: bool

    @property
    def variance(self) -> FloatArray:
        """(n,) Variance of each mean."""
        return self.between_seeds + self.scenarios

    @property
    def scenarios(self) -> FloatArray:
        """(n,) What scenarios add to `variance`."""
        return np.maximum(np.diagonal(self.between_scenarios) - self.residual, 0.0)


def crossed(data: Sequence[FloatArray], *, rate: bool = False, paired: bool = True) -> Crossed:
    """Decompose the arrays (S_i, E), one per agent, whose columns are the same E scenarios.

    NaN is "no value": means are over what is there (few missing values: the pieces of the variance are those of
    the unweighted means). `rate` says that the values are 0 or 1: an agent at exactly 0 or 1
    then gets the variance of the rate (x + 1)/(n + 2), between seeds where there are several, because no failure in
    n trials does not prove that there are none. Without `paired` the covariances of agents are left out (NaN), which `means` does
    not need.
    """
    if len({x.shape[1] for x in data}) > 1:
        raise ValueError(
            f"the agents have different numbers of scenarios: {sorted({x.shape[1] for x in data})}"
        )
    n, E = len(data), data[0].shape[1]
    columns = np.full((n, E), np.nan)
    mean, between, residual = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    seeds, values = np.zeros(n), np.zeros(n)
    for i, x in enumerate(data):
        there = np.isfinite(x)
        x, there = x[there.any(axis=1)], there[there.any(axis=1)]
        seeds[i], values[i] = len(x), there.sum()
        if len(x):
            mean[i], columns[i], between[i], residual[i] = _layout(x, there)
    covariance, episodes = _covariance(columns, paired)
    if rate:
        for edge in np.flatnonzero((mean == 0.0) | (mean == 1.0)):
            i = int(edge)
            shrunk = (mean[i] * values[i] + 1) / (values[i] + 2)
            variance = shrunk * (1 - shrunk) / values[i]
            if seeds[i] > 1:
                between[i] = variance
            else:
                covariance[i, i] = variance
    seeds_df = np.where(seeds > 1, seeds - 1, np.inf)
    return Crossed(mean, seeds, between, residual, covariance, episodes, values, seeds_df, rate)


def _layout(
    x: FloatArray, there: np.ndarray[tuple[int, ...], np.dtype[np.bool]]
) -> tuple[float, FloatArray, float, float]:
    """Mean, scenarios' means (E,), A and R of one agent's values (S, E)."""
    filled = np.where(there, x, 0.0)
    count = there.sum(axis=0)
    columns = np.divide(filled.sum(axis=0), count, out=np.full(x.shape[1], np.nan), where=count > 0)
    total = int(count.sum())
    mean = float(filled.sum() / total)
    S, E = len(x), int((count > 0).sum())
    if S == 1:
        return mean, columns, 0.0, 0.0
    rows = filled.sum(axis=1) / there.sum(axis=1)
    between = float(rows.var(ddof=1) / S)
    if E == 1:
        return mean, columns, between, 0.0
    left = np.where(there, x - rows[:, None] - columns[None, :] + mean, 0.0)
    return mean, columns, between, float((left**2).sum() / ((S - 1) * (E - 1)) / total)


def _covariance(columns: FloatArray, paired: bool) -> tuple[FloatArray, FloatArray]:
    """Covariance (n, n) of the means over scenarios, and the number of scenarios (n,) each is over."""
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


def _squares(table: Crossed) -> FloatArray:
    """(n,) A² / its degrees of freedom; 0 with one seed."""
    return np.asarray(table.between_seeds**2 / table.seeds_df, dtype=np.float64)


def _limits(table: Crossed, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Interval of each agent's rate or mean, q standard errors wide to each side; q is (n,) or (n, m)."""
    shape = (-1,) + (1,) * (q.ndim - 1)
    mean, variance = table.mean.reshape(shape), table.variance.reshape(shape)
    if not table.rate:
        return mean - q * np.sqrt(variance), mean + q * np.sqrt(variance)
    seeds, values, episodes = (part.reshape(shape) for part in (table.seeds, table.values, table.episodes))
    # One seed: Wilson's own interval. Several: as many trials as would have this variance (Dean & Pagano 2015).
    with np.errstate(divide="ignore", invalid="ignore"):
        effective = np.minimum(mean * (1 - mean) / variance, values)
    effective = np.where((mean <= 0) | (mean >= 1), values, effective)
    return score_interval(mean, np.where(seeds > 1, effective, episodes), q)


def means(table: Crossed, confidence: float = 0.95) -> list[Estimate]:
    """Mean of each agent with its interval; a rate's stays within [0, 1] and never has zero width.

    One seed and a rate: Wilson's interval. One seed and a mean: Student's t over the episodes. Several seeds: see
    the module's formula, for a rate as Wilson's interval with the effective number of trials p (1 - p) / variance.
    An interval that cannot be computed (one seed of one episode) is NaN.
    """
    spread = Spread(
        table.between_seeds, welch(table.between_seeds, _squares(table)), table.scenarios, table.episodes - 1
    )
    q = spread.quantile(confidence)
    if table.rate:
        q = np.where(table.seeds <= 1, quantile(confidence), q)
    low, high = _limits(table, q)
    return [
        Estimate(float(m), float(a), float(b), confidence, covers(np.array([s])))
        for m, a, b, s in zip(table.mean, low, high, table.seeds, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All differences row agent - column agent, (n, n) each."""

    difference: FloatArray
    low: FloatArray
    high: FloatArray
    p_value: FloatArray  # two-sided; of equal means

    def estimate(self, i: int, j: int, table: Crossed, confidence: float) -> Estimate:
        """The difference of agent i and agent j as an `Estimate`."""
        value, low, high = (float(a[i, j]) for a in (self.difference, self.low, self.high))
        return Estimate(value, low, high, confidence, covers(table.seeds[[i, j]]))


def pairs(table: Crossed, confidence: float = 0.95) -> Pairs:
    """All differences of two agents, paired by scenario, with intervals and t-type p-values.

    Means: t interval of the module's formula. Rates: the square-and-add interval, Newcombe (1998, Stat. Med.
    17:873 and 17:2635) and Zou & Donner (2008, Stat. Med. 27:1693): with limits l, u of each rate and r the
    correlation of the two estimates,
    d - sqrt((p1-l1)² - 2 r (p1-l1)(u2-p2) + (u2-p2)²), d + sqrt((u1-p1)² - 2 r (u1-p1)(p2-l2) + (p2-l2)²).
    """
    spread = pair_spread(table)
    difference = table.mean[:, None] - table.mean[None, :]
    q = spread.quantile(confidence)
    if table.rate:
        single = np.maximum(table.seeds[:, None], table.seeds[None, :]) <= 1
        low, high = _square_and_add(table, np.where(single, quantile(confidence), q), difference)
    else:
        half = q * np.sqrt(spread.seeds + spread.scenarios)
        low, high = difference - half, difference + half
    # The p-values are symmetric: half of them, by bisection, are enough.
    p = np.ones_like(difference)
    upper = np.triu_indices(len(p), 1)
    p[upper] = spread.take(upper).p_value(difference[upper])
    p.T[upper] = p[upper]
    return Pairs(difference, low, high, p)


def pair_spread(table: Crossed) -> Spread:
    """Variance of all differences (n, n)."""
    cov, diagonal = table.between_scenarios, np.diagonal(table.between_scenarios)
    noise = table.residual[:, None] + table.residual[None, :]
    scenarios = np.maximum(diagonal[:, None] + diagonal[None, :] - 2 * cov - noise, 0.0)
    between = table.between_seeds[:, None] + table.between_seeds[None, :]
    squares = _squares(table)
    fewer = np.minimum(table.episodes[:, None], table.episodes[None, :]) - 1
    return Spread(between, welch(between, squares[:, None] + squares[None, :]), scenarios, fewer)


def _square_and_add(table: Crossed, q: FloatArray, difference: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends (n, n) of the differences of rates, from each rate's own interval at the pair's quantile."""
    low, high = _limits(table, q)
    down, up = (
        table.mean[:, None] - low,
        high - table.mean[:, None],
    )  # (n, n): agent i at the quantile of (i, j)
    r = _correlation(table)
    below = np.sqrt(np.maximum(down**2 - 2 * r * down * up.T + up.T**2, 0.0))
    above = np.sqrt(np.maximum(up**2 - 2 * r * up * down.T + down.T**2, 0.0))
    return np.maximum(difference - below, -1.0), np.minimum(difference + above, 1.0)


def _correlation(table: Crossed) -> FloatArray:
    """Correlation (n, n) of the estimates of two rates; with one seed each Newcombe's, corrected for continuity.

    His psi of method 10 lowers a positive n11 n22 - n12 n21 by n/2, to 0 at most: in covariances by 1/(2 n).
    """
    covariance = table.between_scenarios.copy()
    single = np.maximum(table.seeds[:, None], table.seeds[None, :]) <= 1
    n = np.minimum(table.episodes[:, None], table.episodes[None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        corrected = np.maximum(covariance - 1 / (2 * n * (n - 1)), 0.0)
        covariance = np.where(single & (covariance > 0), corrected, covariance)
        r = covariance / np.sqrt(np.outer(table.variance, table.variance))
    return np.clip(np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0), -1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Contrast:
    """A weighted sum of agents' means with its interval and two-sided p-value of zero."""

    estimate: Estimate
    p_value: float


def contrast(table: Crossed, weights: FloatArray, confidence: float = 0.95) -> Contrast:
    """Weighted sum (n,) of the means, such as an effect averaged over matched cells, with a t interval.

    A rate's contrast has the t interval too: sums of several agents' rates are far from the edges' trouble, save
    when all rates are 0 or 1.
    """
    used = np.asarray(weights) != 0
    w = np.where(used, weights, 0.0)[used]
    between = float(w**2 @ table.between_seeds[used])
    noise = float(w**2 @ table.residual[used])
    scenarios = max(float(w @ table.between_scenarios[np.ix_(used, used)] @ w) - noise, 0.0)
    value = float(w @ table.mean[used])
    spread = Spread(
        np.array([between]),
        welch(np.array([between]), np.array([w**4 @ _squares(table)[used]])),
        np.array([scenarios]),
        np.array([table.episodes[used].min() - 1]),
    )
    half = float(spread.quantile(confidence)[0] * np.sqrt(between + scenarios))
    p = float(spread.p_value(np.array([value]))[0])
    low, high = value - half, value + half
    if table.rate and np.abs(w).sum() <= 2:  # a difference of averages of rates
        low, high = max(low, -1.0), min(high, 1.0)
    return Contrast(Estimate(value, low, high, confidence, covers(table.seeds[used])), p)
