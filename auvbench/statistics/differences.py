"""Differences of agents' rates and means, paired by scenario: intervals and p-values; McNemar's test and Holm's correction.

The variance is that of crossed.py, and what makes a scenario hard for both agents cancels. The part of the training seeds is
an agent's own variance, squeezed towards a fixed prior. Few seeds may agree by chance, so a test of their own variance alone
finds little and errs where trainings differ wildly. limma squeezes each variance towards a prior that it estimates from the
other rows of the table (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3:3; Phipson et al. 2016, Ann. Appl. Stat. 10:946). Then a
verdict depends on rows that it does not name. Here the prior is declared once, in units of each agent's own spread of
episodes, so dropping a row changes no p-value. docs/statistics-appendix.md has the measurements behind the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, gammaln

from auvbench.statistics.crossed import Crossed, covers, limits, within
from auvbench.statistics.intervals import BoolArray, Estimate, FloatArray, Spread, quantile, welch

RATIO_OF_RATES = 0.13
"""prior standard deviation between trainings, in residual standard deviations of an episode: success and other rates"""
RATIO_OF_MEANS = 0.2
"""the same for all other measures"""
PRIOR_DF = 3.0
"""degrees of freedom of the prior in the squeezed variance"""


def freedom(df: FloatArray) -> FloatArray:
    """Return the degrees of freedom of a squeezed variance.

    The prior adds the harmonic d d0 / (d + d0), always less than either: two seeds borrow less than ten. limma's full
    d0 leads to false verdicts where rows differ in their true variances.
    """
    return np.asarray(np.where(np.isinf(df), df, df + PRIOR_DF / (1 + PRIOR_DF / np.where(df > 0, df, 1.0))))


def seed_variance(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """Return what training seeds add to the variance of each mean (n,), and its degrees of freedom (n,).

    With d degrees of freedom, own variance s² and prior s0² it is max(s², (d0 s0² + d s²) / (d0 + d)) / S: an outlier
    keeps its own, and so does a row without residual, which gives the prior no unit. Rows of one seed stay at 0. The
    table's arrays may have leading axes.
    """
    several = table.seeds > 1
    ratio = RATIO_OF_RATES if table.rate else RATIO_OF_MEANS
    df = np.where(several, table.seeds_df, 1.0)
    # The residual is over S E values: times E it is the variance of an episode over S.
    prior = ratio**2 * table.residual * table.episodes
    squeezed = (PRIOR_DF * prior + df * table.between_seeds) / (PRIOR_DF + df)
    between = np.where(several, np.fmax(squeezed, table.between_seeds), table.between_seeds)
    return between, np.where(several & (prior > 0), freedom(df), table.seeds_df)


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All differences row agent - column agent, (n, n) each."""

    difference: FloatArray
    low: FloatArray
    high: FloatArray

    def estimate(self, i: int, j: int, table: Crossed, confidence: float) -> Estimate:
        """The difference of agent i and agent j as an `Estimate`."""
        value, low, high = (float(a[i, j]) for a in (self.difference, self.low, self.high))
        return Estimate(value, low, high, confidence, covers(table.seeds[[i, j]]))


def pairs(table: Crossed, confidence: float = 0.95) -> Pairs:
    """Return all differences of two agents, paired by scenario, with intervals.

    Means: t interval of the module's formula. Rates: `_of_rates`. Each interval by itself has the confidence.
    """
    spread = pair_spread(table)
    difference = table.mean[:, None] - table.mean[None, :]
    q = spread.quantile(confidence)
    half = q * np.sqrt(spread.seeds + spread.scenarios)
    low, high = difference - half, difference + half
    if table.rate:
        low, high = _of_rates(table, q, confidence, (low, high))
    least, most = table.least[:, None] - table.most[None, :], table.most[:, None] - table.least[None, :]
    low, high = within(low, difference, high, least, most)
    return Pairs(difference, low, high)


def _of_rates(
    table: Crossed, q: FloatArray, confidence: float, t: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the ends (n, n) of the differences of rates, `t` being those of the t interval.

    Square-and-add, Newcombe (1998, Stat. Med. 17:873 and 17:2635) and Zou & Donner (2008, Stat. Med. 27:1693): with
    limits l, u of each rate and r the correlation of the two estimates,
    d - sqrt((p1-l1)² - 2 r (p1-l1)(u2-p2) + (u2-p2)²), d + sqrt((u1-p1)² - 2 r (u1-p1)(p2-l2) + (p2-l2)²).
    The limits of an agent with several seeds are those of its own interval, extended to p ± q sd where the squeezed
    variance is larger: as an effective number of trials p (1 - p) / variance it would be less than one trial for a
    rate near its end. Where an agent has several seeds, the ends are extended to the t interval as far as the two
    rates' limits allow, l1 - u2 to u1 - l2: a rate at 1 has no u - p, so square-and-add excludes 0 however
    uncertain the other's seeds are. So the interval contains 0 where the t interval does.
    """
    single = np.maximum(table.seeds[:, None], table.seeds[None, :]) <= 1
    q = np.where(single, quantile(confidence), q)
    low, high = limits(table, q)  # (n, n): agent i at the quantile of (i, j)
    mean, several = table.mean[:, None], table.seeds[:, None] > 1
    reach = q * np.sqrt(seed_variance(table)[0] + table.scenarios)[:, None]
    low = np.where(several, np.maximum(np.minimum(low, mean - reach), 0.0), low)
    high = np.where(several, np.minimum(np.maximum(high, mean + reach), 1.0), high)
    down, up, r = mean - low, high - mean, _correlation(table)
    below = np.sqrt(np.maximum(down**2 - 2 * r * down * up.T + up.T**2, 0.0))
    above = np.sqrt(np.maximum(up**2 - 2 * r * up * down.T + down.T**2, 0.0))
    least, most = mean - mean.T - below, mean - mean.T + above
    farther = (
        np.minimum(least, np.maximum(t[0], low - high.T)),
        np.maximum(most, np.minimum(t[1], high - low.T)),
    )
    return np.where(single, least, farther[0]), np.where(single, most, farther[1])


def pair_spread(table: Crossed, seeds: tuple[FloatArray, FloatArray] | None = None) -> Spread:
    """Return the variance of all differences (n, n); the table's arrays may have leading axes.

    `seeds` is the part of the training seeds (n,) with its degrees of freedom, `seed_variance(table)` if it is absent.
    """
    between, df = seed_variance(table) if seeds is None else seeds
    cov, diagonal = table.between_scenarios, np.diagonal(table.between_scenarios, axis1=-2, axis2=-1)
    scenarios = np.maximum(_sums(diagonal) - 2 * cov - _sums(table.residual), 0.0)
    fewer = np.minimum(table.episodes[..., :, None], table.episodes[..., None, :]) - 1
    both = _sums(between)
    return Spread(both, welch(both, _sums(between**2 / df)), scenarios, fewer)


def _sums(x: FloatArray) -> FloatArray:
    """(n, n) x[i] + x[j]."""
    return np.asarray(x[..., :, None] + x[..., None, :], dtype=np.float64)


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


def contrast(table: Crossed, weights: FloatArray, confidence: float = 0.95) -> tuple[Estimate, float]:
    """Return a weighted sum of the means, such as an effect averaged over matched cells, and its p-value of zero.

    `weights` are (n,). The t interval ends where the sum of what is possible does. A rate's contrast has the t interval too:
    sums of several agents' rates are seldom near an end.
    """
    used = np.asarray(weights) != 0
    w = np.where(used, weights, 0.0)[used]
    seeds, df = (part[used] for part in seed_variance(table))
    between = float(w**2 @ seeds)
    noise = float(w**2 @ table.residual[used])
    scenarios = max(float(w @ table.between_scenarios[np.ix_(used, used)] @ w) - noise, 0.0)
    value = float(w @ table.mean[used])
    spread = Spread(
        np.array([between]),
        welch(np.array([between]), np.array([w**4 @ (seeds**2 / df)])),
        np.array([scenarios]),
        np.array([table.episodes[used].min() - 1]),
    )
    half = float(spread.quantile(confidence)[0] * np.sqrt(between + scenarios))
    p = float(spread.p_value(np.array([value]))[0])
    ends = np.array([w * table.least[used], w * table.most[used]])
    least, most = ends.min(axis=0).sum(), ends.max(axis=0).sum()
    low, high = (float(end) for end in within(value - half, value, value + half, least, most))
    return Estimate(value, low, high, confidence, covers(table.seeds[used])), p


def resolution(table: Crossed) -> FloatArray:
    """Return two-sided p-values (n, n) that the means of two agents are equal; 1 on the diagonal.

    A rate near 0 or 1 is skewed: the mean and the spread of few seeds err together. A difference of a measure that has a least
    and a most is therefore tested twice, on its own scale and on that of the log-odds, and the larger p counts. Means are
    equal on one scale if and only if they are on the other. The first scale gives weight to trainings that fail altogether, the
    second to rates near their ends.

    `table` as `crossed.crossed` makes it, with covariances; arrays may have leading axes. Two agents with one run
    each have no seeds to differ by: theirs is the paired test over scenarios on the measure's own scale.
    """
    p = t_test(table, pair_spread(table))
    limited = bounded(table)
    twice = limited[..., :, None] & limited[..., None, :]
    twice &= np.maximum(table.seeds[..., :, None], table.seeds[..., None, :]) > 1
    if not twice.any():
        return p
    odds = log_odds(table)
    return np.where(twice, np.fmax(p, t_test(odds, pair_spread(odds, _odds_variance(table, odds)))), p)


def log_odds(table: Crossed) -> Crossed:
    """Return the table on the scale log(f / (1 - f)), f the share of the way from the least to the most of a mean.

    Delta method: variances times the squared derivative 1 / (f (1 - f)), taken, as the value is, at
    (f n + 1/2) / (n + 1) for n values, so that it is finite at the ends (Anscombe 1956, Biometrika 43:461). The
    variance between seeds is at least that of the seeds' own log-odds: seeds near an end hide their spread in the mean.
    """
    share, span = _share(table)
    slope = 1 / (share * (1 - share)) / span
    return replace(
        table,
        mean=np.log(share / (1 - share)),
        between_seeds=np.fmax(table.between_seeds * slope**2, table.between_odds),
        residual=table.residual * slope**2,
        between_scenarios=table.between_scenarios * slope[..., :, None] * slope[..., None, :],
        least=np.full_like(table.least, -np.inf),
        most=np.full_like(table.most, np.inf),
    )


def bounded(table: Crossed) -> BoolArray:
    """Return (n,) whether the mean has a least and a most, with room between."""
    span = table.most - table.least
    return np.asarray(np.isfinite(span) & (span > 0))


def _share(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """Shares (n,) of the way from the least to the most, and that way; 1/2 and 1 where there is none."""
    limited = bounded(table)
    least = np.where(limited, table.least, 0.0)
    span = np.where(limited, table.most, 1.0) - least
    # A limit that was read off the episodes that timed out may be less than what another's episodes took.
    way = np.where(limited, np.clip((table.mean - least) / span, 0.0, 1.0), 0.5)
    return (way * table.values + 0.5) / (table.values + 1), span


def _odds_variance(table: Crossed, odds: Crossed) -> tuple[FloatArray, FloatArray]:
    """The variance (n,) that seeds add to a mean's log-odds, with its degrees of freedom (n,).

    Log-odds of a mean over seeds whose log-odds are normal with variance s² are their mean + (1 - 2 f) s² / 2, to the
    second order, so the uncertainty of s², 2 s⁴ / df, counts too: Cox's method for the mean of a log-normal (Land
    1972, Technometrics 14:145; Zhou & Gao 1997, Stat. Med. 16:783), which is the case f = 0.
    """
    between, df = seed_variance(odds)
    share, _ = _share(table)
    several = table.seeds > 1
    skew = (1 - 2 * share) ** 2 * (between * table.seeds) ** 2 / (2 * np.where(several, df, 1.0))
    # At an end no seed shows its spread. `crossed` assumes a variance there, which no seeds estimated.
    end = (table.mean <= table.least) | (table.mean >= table.most)
    return np.where(several & ~end, between + skew, between), np.where(several & end, np.inf, df)


def t_test(table: Crossed, spread: Spread) -> FloatArray:
    """Symmetric t-type p-values (n, n) of equal means."""
    i, j = np.triu_indices(table.mean.shape[-1], 1)
    difference = table.mean[..., :, None] - table.mean[..., None, :]
    p = np.ones_like(difference)
    p[..., i, j] = p[..., j, i] = spread.take((..., i, j)).p_value(difference[..., i, j])
    return p


def mcnemar(b: ArrayLike, c: ArrayLike) -> FloatArray:
    """Return McNemar's two-sided mid-p from the discordant counts b (only the first) and c (only the second).

    Twice the lower tail of Binomial(b + c, 1/2) at min(b, c), less the probability of min(b, c) itself; it keeps its level
    better than the exact test, which is too cautious (Fagerland, Lydersen & Laake 2013, BMC Med. Res. Methodol. 13:91).

    >>> f"{float(mcnemar(1, 7)):.4f}"
    '0.0391'
    """
    b, c = np.asarray(b, dtype=np.float64), np.asarray(c, dtype=np.float64)
    n, k = b + c, np.minimum(b, c)
    point = np.exp(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1) - n * np.log(2.0))
    return np.asarray(np.where(b == c, 1.0, 2 * bdtr(k, n.astype(np.int64), 0.5) - point))


def holm(p: ArrayLike) -> FloatArray:
    """Holm's (1979, Scand. J. Stat. 6:65) step-down adjusted p-values; NaN is no test and stays NaN.

    >>> holm([0.01, 0.04, 0.03, 0.005]).tolist()
    [0.03, 0.06, 0.06, 0.02]
    """
    p = np.asarray(p, dtype=np.float64)
    adjusted = np.full_like(p, np.nan)
    there = np.flatnonzero(np.isfinite(p))
    order = there[np.argsort(p[there], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted
