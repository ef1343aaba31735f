"""Tests of all pairs of agents: the variance between seeds is pooled upwards, and two scales must agree.

With three to five seeds per agent a test of its own variance knows two to four degrees of freedom, and is misled in
two ways that the sample does not show: an agent whose trainings differ wildly may have drawn seeds that lie close
together, and a rate near 0 or 1 is skewed, so that its mean and its spread err together. Borrowing degrees of
freedom from the other agents (moderated t-tests) finds more and errs more. Used here instead, after measuring them
all (docs/statistics.md has the table):

* **Pooled upwards.** An agent's variance between seeds is never taken to be less than the average over the agents of
  the table that have several seeds. Where the average is used it has their degrees of freedom together; where the
  agent's own is larger, that one counts, with its own.
* **Two scales.** A difference of a measure that has a least and a most is tested twice, on its own scale and on that
  of the log-odds (by the delta method at the mean), each with its variances pooled so; the larger p counts. Means are
  equal on the one if and only if they are on the other, so that the hypothesis is the same. The first scale gives
  weight to trainings that fail altogether, the second to rates near their ends.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.differences import pair_spread
from auvbench.statistics.intervals import FloatArray

BoolArray = NDArray[np.bool_]


def pooled(table: Crossed, assumed: BoolArray | None = None) -> Crossed:
    """The table with variances between seeds no smaller than their average over its agents with several seeds.

    s² of agent i is S_i A_i; the average weighs each with its S_i - 1 degrees of freedom. Arrays of the table may
    have leading axes (tables, n).

    Args:
        table: the agents.
        assumed: (n,) of whom the variance was not seen between seeds but put in its place: it too has the degrees of
            freedom of all agents together, however large it is.
    """
    several = (table.seeds > 1) & np.isfinite(table.between_seeds)
    df = np.where(several, table.seeds - 1, 0.0)
    total = df.sum(axis=-1, keepdims=True)
    own = np.where(several, table.between_seeds * table.seeds, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        average = (df * own).sum(axis=-1, keepdims=True) / total / table.seeds
    use = several & (table.between_seeds < average)
    shared = use if assumed is None else use | (several & assumed)
    return replace(
        table,
        between_seeds=np.where(use, average, table.between_seeds),
        seeds_df=np.where(shared, total, table.seeds_df),
    )


def log_odds(table: Crossed) -> Crossed:
    """The table on the scale log(f / (1 - f)), f the share of the way from the least to the most that a mean can be.

    Delta method: variances times the squared derivative 1 / (f (1 - f)), taken, as the value is, at
    (f n + 1/2) / (n + 1) for n values, so that it is finite at the ends (Anscombe 1956, Biometrika 43:461).
    """
    span = table.most - table.least
    n = table.values
    # A limit that was read off the episodes that timed out may be less than what another's episodes took.
    way = np.clip((table.mean - table.least) / span, 0.0, 1.0)
    share = (way * n + 0.5) / (n + 1)
    slope = 1 / (share * (1 - share)) / span
    return replace(
        table,
        mean=np.log(share / (1 - share)),
        between_seeds=table.between_seeds * slope**2,
        residual=table.residual * slope**2,
        between_scenarios=table.between_scenarios * slope[..., :, None] * slope[..., None, :],
        rate=False,
        least=np.full_like(table.least, -np.inf),
        most=np.full_like(table.most, np.inf),
    )


def at_an_end(table: Crossed) -> BoolArray:
    """(n,) Whose episodes all gave the least or the most: its seeds show no variance, and `crossed` assumes one.

    Five trainings that each succeed in all of 500 episodes differ in log-odds by no more than is known: the assumed
    variance, (2 logits)², is that of a failure that was not seen. Taken for one of five seeds' own, with their four
    degrees of freedom, it left 100 % unresolved from 1 %.
    """
    return np.asarray((table.mean <= table.least) | (table.mean >= table.most))


def bounded(table: Crossed) -> bool:
    """Whether every mean has a least and a most, with room between."""
    there = np.isfinite(table.mean)
    span = (table.most - table.least)[there]
    return bool(there.any() and np.isfinite(span).all() and (span > 0).all())


def resolution(table: Crossed) -> FloatArray:
    """Two-sided p-values (n, n) that the means of two agents are equal, of all pairs; 1 on the diagonal.

    `table` as `crossed.crossed` makes it, with covariances; arrays may have leading axes. Two agents with one run
    each have no seeds to differ by: theirs is the paired test over scenarios on the measure's own scale.
    """
    p = _p_values(pooled(table))
    if bounded(table):
        several = np.maximum(table.seeds[..., :, None], table.seeds[..., None, :]) > 1
        p = np.where(several, np.fmax(p, _p_values(pooled(log_odds(table), at_an_end(table)))), p)
    return p


def _p_values(table: Crossed) -> FloatArray:
    """Symmetric t-type p-values (n, n) of equal means."""
    i, j = np.triu_indices(table.mean.shape[-1], 1)
    spread = pair_spread(table)
    difference = table.mean[..., :, None] - table.mean[..., None, :]
    p = np.ones_like(difference)
    p[..., i, j] = p[..., j, i] = spread.take((..., i, j)).p_value(difference[..., i, j])
    return p
