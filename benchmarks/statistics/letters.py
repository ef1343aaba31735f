"""Measure false differences among all pairs of agents with equal typical trainings."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from auvbench.statistics import mcnemar
from auvbench.statistics.typical import ALPHA, difference, sample
from benchmarks.statistics.designs import FloatArray, level
from benchmarks.statistics.worlds import World, successes

BATCH = 50
"""tables simulated at once: about 100 MB"""
RATES = (0.6, 0.9, 0.98)
SEEDS = (5, 10, 20)


@dataclass(frozen=True, slots=True)
class Design:
    """A table of agents; an agent with one seed is a controller."""

    name: str
    worlds: tuple[World, ...]
    seeds: tuple[int, ...]


def _design(name: str, *groups: tuple[int, World, int]) -> Design:
    """Return a design of groups (number of agents, their world, their seeds)."""
    worlds = tuple(world for n, world, _ in groups for _ in range(n))
    return Design(name, worlds, tuple(S for n, _, S in groups for _ in range(n)))


def equal(rate: float, S: int) -> list[Design]:
    """Return designs whose agents all have typical trainings of the same rate: every resolved pair is false."""

    def of(sd: float, tails: int = 0) -> World:
        return World(level(rate), sd, tails=tails)

    return [
        _design("8 alike, sd 0.5", (8, of(0.5), S)),
        _design("8 alike, sd 1.2", (8, of(1.2), S)),
        _design("4 of sd 0.3, 4 of sd 2", (4, of(0.3), S), (4, of(2.0), S)),
        _design("11 of sd 0.3, 1 of sd 3", (11, of(0.3), S), (1, of(3.0), S)),
        _design("4 of sd 1, 4 controllers", (4, of(1.0), S), (4, of(0.0), 1)),
        _design("4 of sd 0.5 with twice the seeds", (4, of(0.5), S), (4, of(0.5), 2 * S)),
        _design("8 of heavy tails, sd 1", (8, of(1.0, tails=3), S)),
    ]


def resolved(first: FloatArray, second: FloatArray, at: float) -> FloatArray:
    """Return whether a pair of agents (tables, S, E) is resolved at a level, in each table."""
    one, other = sample(first), sample(second)
    if max(one.n, other.n) > 1:
        low, high = difference(one, other, rate=True).ends(at)
        return np.asarray((low > 0) | (high < 0))
    x, y = first[:, 0], second[:, 0]
    return np.asarray(mcnemar((x * (1 - y)).sum(axis=1), (y * (1 - x)).sum(axis=1)) < at)


def false_letters(design: Design, replications: int, *, seed: int = 0, E: int = 200) -> float:
    """Return the share of tables with any resolved pair; the first step of Holm's procedure is Bonferroni's."""
    rng = np.random.default_rng(seed)
    pairs = list(combinations(range(len(design.worlds)), 2))
    wrong = 0
    for start in range(0, replications, BATCH):
        scenarios = rng.normal(size=(min(BATCH, replications - start), E))
        data = successes(design.worlds, design.seeds, scenarios, rng)
        found = [resolved(data[i], data[j], ALPHA / len(pairs)) for i, j in pairs]
        wrong += int(np.any(found, axis=0).sum())
    return wrong / replications
