"""Tests of all pairs that were considered, the one in use among them: p-values (tables, pairs)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from auvbench.statistics.crossed import Crossed
from auvbench.statistics.differences import pair_spread
from auvbench.statistics.resolution import log_odds, pooled, resolution
from benchmarks.statistics.moderation import moderated
from benchmarks.statistics.tables import upper
from benchmarks.statistics.worlds import FloatArray

Test = Callable[[Crossed, FloatArray], FloatArray]
"""f(tables, seeds' means (tables, n, S)) -> p (tables, pairs)"""


def t_type(table: Crossed) -> FloatArray:
    """The t-type test of every pair."""
    i, j = np.triu_indices(table.mean.shape[-1], 1)
    difference = table.mean[..., :, None] - table.mean[..., None, :]
    return pair_spread(table).take((..., i, j)).p_value(difference[..., i, j])


def arcsine(table: Crossed) -> Crossed:
    """The table on the scale 2 arcsin sqrt(rate), by the delta method as `log_odds` is."""
    share = (table.mean * table.values + 0.5) / (table.values + 1)
    slope = 1 / np.sqrt(share * (1 - share))
    return replace(
        table,
        mean=2 * np.arcsin(np.sqrt(share)),
        between_seeds=table.between_seeds * slope**2,
        residual=table.residual * slope**2,
        between_scenarios=table.between_scenarios * slope[..., :, None] * slope[..., None, :],
        rate=False,
    )


def one_by_one(table: Crossed) -> list[Crossed]:
    """The tables of a batch."""
    fields = {
        name: getattr(table, name)
        for name in Crossed.__slots__
        if isinstance(getattr(table, name), np.ndarray)
    }
    return [replace(table, **{k: v[t] for k, v in fields.items()}) for t in range(len(table.mean))]


def each_moderated(table: Crossed) -> Crossed:
    """The tables, each with variances moderated among its own agents."""
    found = [moderated(one) for one in one_by_one(table)]
    between, df = np.array([t.between_seeds for t in found]), np.array([t.seeds_df for t in found])
    return replace(table, between_seeds=between, seeds_df=df)


def permutation(table: Crossed, seeds: FloatArray) -> FloatArray:
    """Exact permutation test of the seeds' means, pair by pair: all ways to part 2 S seeds into two halves."""
    i, j = np.triu_indices(seeds.shape[1], 1)
    S = seeds.shape[2]
    both = np.concatenate([seeds[:, i], seeds[:, j]], axis=2)
    halves = np.zeros((2 * S, 0))
    for chosen in combinations(range(2 * S), S):
        sign = -np.ones((2 * S, 1))
        sign[list(chosen)] = 1
        halves = np.hstack([halves, sign])
    difference = np.abs(both @ halves)
    seen = np.abs(seeds[:, i].sum(axis=2) - seeds[:, j].sum(axis=2))
    return np.asarray((difference >= seen[..., None] - 1e-12).mean(axis=2))


ALTERNATIVES: dict[str, Test] = {
    "own variances": lambda table, seeds: t_type(table),
    "moderated (before)": lambda table, seeds: t_type(each_moderated(table)),
    "permutation": permutation,
    "log-odds, own": lambda table, seeds: t_type(log_odds(table)),
    "rates, pooled": lambda table, seeds: t_type(pooled(table)),
    "arcsine, pooled": lambda table, seeds: t_type(pooled(arcsine(table))),
    "log-odds, pooled": lambda table, seeds: t_type(pooled(log_odds(table))),
    "used": lambda table, seeds: upper(resolution(table)),
}
