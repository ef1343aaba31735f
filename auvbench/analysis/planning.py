"""Plan seeds and episodes: from the spread of existing trainings to the number that resolves a difference."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.measures import Measure
from auvbench.analysis.records import Agent, Needed, learns
from auvbench.analysis.typical import Typical
from auvbench.errors import ReportError
from auvbench.statistics import power as st
from auvbench.statistics.intervals import FloatArray, quantile

LEAST, MOST = 0.005, 0.995
"""smallest and largest success rate in a plan"""
POWER = 0.8
MOST_EPISODES = 100_000
"""largest number of test episodes in a plan"""


@dataclass(frozen=True, slots=True)
class Basis:
    """Basis of a plan: the distribution of trainings, and the two typical values whose difference is to be resolved."""

    model: st.Model
    cautious: st.Model | None
    """distribution with the upper confidence limit of the spread; None if the user gave the spread"""
    values: tuple[float, float]
    spread: st.SeedSpread
    agents: int
    """number of agents that the spread comes from; 0 if the user gave the spread"""
    against_controller: bool = True
    """whether one of the two agents is a controller, like the usual baseline"""


def from_agents(agents: Sequence[Agent], m: Measure, resolve: float) -> Basis:
    """Return the basis from the spread of tested agents; the first value is the median of the agents' typical values.

    Args:
        agents: agents of one table.
        m: measure to plan for.
        resolve: difference to resolve in the measure's unit (a rate from 0 to 1).

    Raises:
        ReportError: no agent has several seeds and episodes, or the difference of two rates is not between 0 and 0.99.
    """
    several = [agent for agent in agents if learns(agent) and len(agent.outcome) > 1]
    data = [x for x in (m.values(agent) for agent in several) if x.shape[1] > 1 and np.isfinite(x).all()]
    if not data:
        raise ReportError(
            f"no agent has several training seeds and several test episodes, all with a value of {m.name}, "
            "so the spread of trainings is unknown; give it with --sd"
        )
    centre = float(np.median([np.median(x.mean(axis=1)) for x in data]))
    if m.rate:
        seeds, scenarios = st.spread_of_rates(data)
        model, cautious = st.Rates(seeds.sd, scenarios), st.Rates(seeds.upper(), scenarios)
        return Basis(model, cautious, pair_of_rates(centre, resolve), seeds, len(data))
    seeds, scenarios, residual = st.spread_of_means(data)
    usual, wide = st.Means(seeds.sd, scenarios, residual), st.Means(seeds.upper(), scenarios, residual)
    return Basis(usual, wide, (centre, centre + resolve), seeds, len(data))


def pair_of_rates(centre: float, resolve: float) -> tuple[float, float]:
    """Return two rates between `LEAST` and `MOST` that differ by `resolve`, the first as close to `centre` as possible.

    Raises:
        ReportError: the difference is not positive, or is larger than `MOST` - `LEAST`.
    """
    if not 0 < resolve <= MOST - LEAST:
        raise ReportError(
            f"the difference to resolve must be more than 0 and at most 99 points, got {100 * resolve:g}"
        )
    low = min(max(centre, LEAST), MOST - resolve)
    return low, low + resolve


@dataclass(frozen=True, slots=True)
class Need:
    """Number of training seeds that each agent needs, by power; None: more than `statistics.power.MOST_SEEDS`."""

    episodes: int
    alone: dict[float, int | None]
    """Number of seeds by power, for a table of only two agents"""
    among: dict[float, int | None]
    """number of seeds by power, for a table in which several agents are compared with one baseline; empty for two agents"""


def needs(
    model: st.Model,
    values: tuple[float, float],
    episodes: int,
    *,
    agents: int = 2,
    targets: Sequence[float] = (0.8, 0.95),
    alpha: float = 0.05,
    replications: int = 200,
    against_controller: bool = True,
    note: Callable[[int, int], object] = lambda episodes, seeds: None,
) -> Need:
    """Return the fewest training seeds that resolve two agents, by simulation with the report's interval.

    Args:
        model: distribution of trainings.
        values: true values of the two agents; for learners, of their typical trainings.
        episodes: test episodes of each training.
        agents: number of agents in the table; n - 1 are compared with the baseline, each at alpha / (n - 1).
        targets: required powers.
        alpha: error rate of the table.
        replications: simulated pairs for each number of seeds (standard error at 80 %: 3 points with 200).
        against_controller: whether one of the two agents is a controller.
        note: function that shows the progress; called with the number of episodes and the next number of seeds.
    """
    levels = (alpha, alpha / max(agents - 1, 1))
    tried: dict[int, FloatArray] = {}

    def power(S: int, level: float) -> float:
        if S not in tried:
            note(episodes, S)
            tried[S] = st.simulated_power(
                model,
                values,
                S,
                episodes,
                levels,
                against_controller=against_controller,
                replications=replications,
            )
        return float(tried[S][levels.index(level)])

    def seeds(level: float) -> dict[float, int | None]:
        return {target: st.seeds_needed(lambda S: power(S, level), target) for target in targets}

    return Need(episodes, seeds(alpha), seeds(alpha / (agents - 1)) if agents > 2 else {})


def needed(typical: Typical, i: int, baseline: int, margin: float, level: float) -> Needed | None:
    """Return how many trainings would decide an open comparison with the baseline with 80 % power.

    To simulate a number of trainings, draw this number from the existing trainings with replacement, and compute the
    report's interval for the drawn trainings. For two controllers, the result is a number of episodes, and the
    observed difference is assumed to be the true difference.

    Args:
        typical: agents of the table.
        i: index of the compared agent.
        baseline: index of the baseline.
        margin: smallest difference of interest; NaN without one.
        level: error rate of this comparison's interval.

    Returns:
        None if no difference can be computed.
    """
    error, episodes = typical.error(i, baseline)
    apart = abs(float(typical.value[i] - typical.value[baseline]))
    if not math.isfinite(error) or not math.isfinite(apart):
        return None
    gains = [typical.gains(place, 0.0) for place in (i, baseline)]
    have = max(map(len, gains))
    if have > 1:
        t = float(quantile(1 - level, episodes - 1))
        count = st.trainings_that_decide(gains[0], gains[1], error, t, level, margin, power=POWER, above=have)
        return Needed("trainings", count)
    goals = [distance for distance in (apart, margin - apart) if distance > 0]
    if not goals:
        return None
    quantiles = float(quantile(1 - level, episodes - 1) + quantile(2 * POWER - 1))
    enough = math.ceil(episodes * (error * quantiles / max(goals)) ** 2)
    return Needed("episodes", enough if enough <= MOST_EPISODES else None)
