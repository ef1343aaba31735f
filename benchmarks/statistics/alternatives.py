"""Rules for the variance between seeds that were considered: p-values (tables, n, n) of tables of agents.

Each rule is applied on the two scales of `statistics.resolution`, and the larger p counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import digamma, polygamma
from scipy.stats import chi2
from scipy.stats import f as fisher

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.differences import log_odds, pair_spread, resolution
from benchmarks.statistics.worlds import FloatArray

Rule = Callable[[Crossed], tuple[FloatArray, FloatArray]]
"""f(tables) -> variance of each mean that seeds make, and its degrees of freedom, (tables, n) each"""
Test = Callable[[Crossed], FloatArray]


def own(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """Each agent's own variance."""
    return table.between_seeds, table.seeds_df


def mean_of_table(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """At least the arithmetic mean over the table, with all degrees of freedom: what reports used before."""
    several, variance, df = _seeds(table)
    total = df.sum(axis=-1, keepdims=True)
    average = (df * variance).sum(axis=-1, keepdims=True) / np.maximum(total, 1)
    return _raised(table, several & (variance < average), average, total)


def median_of_table(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """At least the median over the table, corrected by the chi-squared median, with half of all degrees of freedom."""
    several, variance, df = _seeds(table)
    safe = np.where(several, df, 1.0)
    corrected = np.where(several, variance * safe / chi2.ppf(0.5, safe), np.nan)
    middle = np.nanmedian(corrected, axis=-1, keepdims=True)
    return _raised(table, several & (variance < middle), middle, df.sum(axis=-1, keepdims=True) / 2)


def robust_prior(table: Crossed) -> tuple[FloatArray, FloatArray]:
    """Squeezed towards a prior that median and MAD of the table's log variances give; outliers keep their own.

    Smyth (2004), section 6.2, with robust moments in the spirit of Phipson et al. (2016).
    """
    several, variance, df = _seeds(table)
    d = np.where(several, df, 1.0)
    with np.errstate(divide="ignore"):
        e = np.where(several & (variance > 0), np.log(variance), np.nan) - digamma(d / 2) + np.log(d / 2)
    centre = np.nanmedian(e, axis=-1, keepdims=True)
    spread = (1.4826 * np.nanmedian(np.abs(e - centre), axis=-1, keepdims=True)) ** 2
    noise = np.nanmean(np.where(several, polygamma(1, d / 2), np.nan), axis=-1, keepdims=True)
    d0 = 2 * inverse_trigamma(np.maximum(spread - noise, 1e-2))
    prior = np.exp(centre + digamma(d0 / 2) - np.log(d0 / 2))
    outlier = variance / prior > fisher.ppf(0.95, d, d0)
    use = several & ~outlier
    squeezed = (d0 * prior + d * variance) / (d0 + d) / np.maximum(table.seeds, 1)
    return np.where(use, squeezed, table.between_seeds), np.where(use, d + d0, table.seeds_df)


def inverse_trigamma(y: FloatArray) -> FloatArray:
    """Newton's method of Smyth (2004, appendix)."""
    x = 0.5 + 1 / y
    for _ in range(10):
        value = polygamma(1, x)
        x = x + value * (1 - value / y) / polygamma(2, x)
    return np.asarray(x)


def _seeds(table: Crossed) -> tuple[np.ndarray, FloatArray, FloatArray]:
    """Who has several seeds, the variance of one seed, and its degrees of freedom; 0 for the others."""
    several = table.seeds > 1
    return several, table.between_seeds * table.seeds, np.where(several, table.seeds_df, 0.0)


def _raised(
    table: Crossed, use: np.ndarray, variance: FloatArray, df: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return (
        np.where(use, variance / table.seeds, table.between_seeds),
        np.where(use, df, table.seeds_df),
    )


def on_two_scales(rule: Rule) -> Test:
    """Return the test with a rule on the measure's own scale and on that of the log-odds by the delta method."""

    def test(table: Crossed) -> FloatArray:
        odds = log_odds(replace(table, between_odds=np.zeros_like(table.mean)))
        return np.asarray(np.fmax(*(t_type(t, rule(t)) for t in (table, odds))))

    return test


def t_type(table: Crossed, seeds: tuple[FloatArray, FloatArray]) -> FloatArray:
    """P-values (tables, n, n) with the given part of the seeds."""
    difference = table.mean[..., :, None] - table.mean[..., None, :]
    return pair_spread(table, seeds).p_value(difference)


def one_by_one(table: Crossed) -> list[Crossed]:
    """The tables of a batch."""
    fields = {
        name: getattr(table, name)
        for name in Crossed.__slots__
        if isinstance(getattr(table, name), np.ndarray)
    }
    return [replace(table, **{k: v[t] for k, v in fields.items()}) for t in range(len(table.mean))]


ALTERNATIVES: dict[str, Test] = {
    "own variances": on_two_scales(own),
    "table's mean (before)": on_two_scales(mean_of_table),
    "table's median": on_two_scales(median_of_table),
    "table's robust prior": on_two_scales(robust_prior),
    "fixed prior (used)": resolution,
}
USED = "fixed prior (used)"
