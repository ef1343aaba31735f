"""Tests of all pairs of agents, on two scales that must agree.

A rate near 0 or 1 is skewed: the mean and the spread of few seeds err together. A difference of a measure that has a
least and a most is therefore tested twice, on its own scale and on that of the log-odds, and the larger p counts. Means
are equal on one scale if and only if they are on the other, so the hypothesis is the same. The first scale gives weight
to trainings that fail altogether, the second to rates near their ends. Both use `moderation.seed_variance`. A p-value
depends on its two agents alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.differences import pair_spread
from auvbench.statistics.intervals import FloatArray, Spread
from auvbench.statistics.moderation import seed_variance

BoolArray = NDArray[np.bool_]


def resolution(table: Crossed) -> FloatArray:
    """Return two-sided p-values (n, n) that the means of two agents are equal; 1 on the diagonal.

    `table` as `crossed.crossed` makes it, with covariances; arrays may have leading axes. Two agents with one run
    each have no seeds to differ by: theirs is the paired test over scenarios on the measure's own scale.
    """
    p = _p_values(table, pair_spread(table))
    limited = bounded(table)
    twice = limited[..., :, None] & limited[..., None, :]
    twice &= np.maximum(table.seeds[..., :, None], table.seeds[..., None, :]) > 1
    if not twice.any():
        return p
    odds = log_odds(table)
    return np.where(twice, np.fmax(p, _p_values(odds, pair_spread(odds, _odds_variance(table, odds)))), p)


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


def _p_values(table: Crossed, spread: Spread) -> FloatArray:
    """Symmetric t-type p-values (n, n) of equal means."""
    i, j = np.triu_indices(table.mean.shape[-1], 1)
    difference = table.mean[..., :, None] - table.mean[..., None, :]
    p = np.ones_like(difference)
    p[..., i, j] = p[..., j, i] = spread.take((..., i, j)).p_value(difference[..., i, j])
    return p
