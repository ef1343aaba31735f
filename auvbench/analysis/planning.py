"""Plan seeds and episodes: from the spread of trainings that are there to the number that resolves a difference."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.measures import Measure
from auvbench.analysis.pairwise import Tests
from auvbench.analysis.records import Agent, Needed, learns
from auvbench.errors import ReportError
from auvbench.statistics import power as st
from auvbench.statistics.differences import pair_spread, seed_variance
from auvbench.statistics.intervals import quantile

LEAST, MOST = 0.005, 0.995
"""rates that are planned for"""
POWER = 0.8
MOST_EPISODES = 100_000
"""beyond which no number of test episodes is named"""


@dataclass(frozen=True, slots=True)
class Basis:
    """What a plan is made for: where trainings come from, and the two values that are to be told apart."""

    model: st.Model
    cautious: st.Model | None
    """trainings that differ as much as the data allow at most; None where the spread was typed"""
    values: tuple[float, float]
    spread: st.SeedSpread
    agents: int
    """that the spread was taken from; 0 where it was typed"""


def from_agents(agents: Sequence[Agent], m: Measure, resolve: float) -> Basis:
    """The basis that evaluated agents give, around their median value.

    Args:
        agents: of one table.
        m: what is planned for.
        resolve: the difference, in the measure's unit (a rate from 0 to 1).

    Raises:
        ReportError: no agent has several seeds, or the difference is no smaller than the range of a rate.
    """
    several = [agent for agent in agents if learns(agent) and len(agent.outcome) > 1]
    data = [x for x in (m.values(agent) for agent in several) if np.isfinite(x).all()]
    if not data:
        raise ReportError(
            "no agent here has several training seeds and values of "
            f"{m.name}: how much trainings differ is not known; give it by --sd"
        )
    centre = float(np.median([x.mean() for x in data]))
    if m.rate:
        seeds, scenarios = st.spread_of_rates(data)
        model, cautious = st.Rates(seeds.sd, scenarios), st.Rates(seeds.upper(), scenarios)
        return Basis(model, cautious, pair_of_rates(centre, resolve), seeds, len(data))
    seeds, scenarios, rest = st.spread_of_means(data)
    usual, wide = st.Means(seeds.sd, scenarios, rest), st.Means(seeds.upper(), scenarios, rest)
    return Basis(usual, wide, (centre, centre + resolve), seeds, len(data))


def pair_of_rates(centre: float, resolve: float) -> tuple[float, float]:
    """Two rates that differ by `resolve`, the first at the centre, or as near as both fit between 0 and 1.

    Raises:
        ReportError: they cannot.
    """
    if not 0 < resolve <= MOST - LEAST:
        raise ReportError(f"a difference of {100 * resolve:g} points: must be more than 0 and at most 99")
    low = min(max(centre, LEAST), MOST - resolve)
    return low, low + resolve


@dataclass(frozen=True, slots=True)
class Need:
    """Training seeds of each agent by the power they give; None: not even `statistics.power.MOST_SEEDS`."""

    episodes: int
    alone: dict[float, int | None]
    """by power: the two agents are the whole table"""
    among: dict[float, int | None]
    """in a table of several, where each agent is compared with one baseline"""


def needs(
    model: st.Model,
    values: tuple[float, float],
    episodes: int,
    *,
    agents: int = 2,
    targets: Sequence[float] = (0.8, 0.95),
    alpha: float = 0.05,
    replications: int = 200,
    note: Callable[[int, int], object] = lambda episodes, seeds: None,
) -> Need:
    """Fewest training seeds that resolve two agents, by simulation with the report's test.

    Args:
        model: where trainings come from.
        values: true values of the two agents.
        episodes: test episodes of each training.
        agents: in the table; n - 1 are compared with the baseline, each at alpha / (n - 1).
        targets: powers.
        alpha: of the table.
        replications: simulated pairs for each number of seeds (standard error at 80 %: 3 points with 200).
        note: called with the episodes and the number of seeds that is tried next.
    """
    tried: dict[int, np.ndarray[tuple[int], np.dtype[np.float64]]] = {}

    def power(S: int, level: float) -> float:
        if S not in tried:
            note(episodes, S)
            tried[S] = st.simulated_p(model, values, S, episodes, replications=replications)
        return float((tried[S] < level).mean())

    def seeds(level: float) -> dict[float, int | None]:
        return {target: st.seeds_needed(lambda S: power(S, level), target) for target in targets}

    return Need(episodes, seeds(alpha), seeds(alpha / (agents - 1)) if agents > 2 else {})


def needed(
    agents: Sequence[Agent], tests: Tests, i: int, baseline: int, margin: float, level: float
) -> Needed | None:
    """Return how many seeds, or episodes where nothing learns, would decide an open comparison with the baseline.

    By the approximate power of the t-test: the difference seen is taken for the true one. It is decided where the
    interval excludes zero, or lies within the margin; the nearer of the two counts.

    Args:
        agents: of the table.
        tests: of all their pairs.
        i: place of the agent that is compared.
        baseline: place of the baseline.
        margin: smallest difference of interest; NaN where there is none.
        level: of the interval of this comparison.

    Returns:
        None where no difference can be computed.
    """
    table = tests.table
    apart = abs(float(table.mean[i] - table.mean[baseline]))
    goals = [distance for distance in (apart, margin - apart) if distance > 0]
    fixed = float(pair_spread(table).scenarios[i, baseline])
    if not goals or not np.isfinite(fixed):
        return None
    learning = [j for j in (i, baseline) if learns(agents[j])]
    if not learning:
        episodes = int(table.episodes[i])
        quantiles = float(quantile(1 - level, episodes - 1) + quantile(2 * POWER - 1))
        enough = math.ceil(episodes * fixed * (quantiles / max(goals)) ** 2)
        return Needed("episodes", enough if enough <= MOST_EPISODES else None)
    per_seed = float((seed_variance(table)[0] * table.seeds)[learning].sum())
    have = max(int(table.seeds[j]) for j in learning)
    found = [
        st.seeds_by_formula(distance, per_seed, fixed, level, POWER, len(learning)) for distance in goals
    ]
    count = min((n for n in found if n is not None), default=None)
    return Needed("seeds", None if count is None else max(count, have + 1))
