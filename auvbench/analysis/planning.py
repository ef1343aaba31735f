"""Plan seeds and episodes: from the spread of trainings that are there to the number that resolves a difference."""

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
"""rates that are planned for"""
POWER = 0.8
MOST_EPISODES = 100_000
"""beyond which no number of test episodes is named"""


@dataclass(frozen=True, slots=True)
class Basis:
    """What a plan is made for: where trainings come from, and the two typical values that are to be told apart."""

    model: st.Model
    cautious: st.Model | None
    """trainings that differ as much as the data allow at most; None where the spread was typed"""
    values: tuple[float, float]
    spread: st.SeedSpread
    agents: int
    """that the spread was taken from; 0 where it was typed"""
    against_controller: bool = True
    """whether one of the two is a controller, as the usual baseline is"""


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
    centre = float(np.median([np.median(x.mean(axis=1)) for x in data]))
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
    against_controller: bool = True,
    note: Callable[[int, int], object] = lambda episodes, seeds: None,
) -> Need:
    """Fewest training seeds that resolve two agents, by simulation with the report's interval.

    Args:
        model: where trainings come from.
        values: true values of the two agents, of learners those of the typical trainings.
        episodes: test episodes of each training.
        agents: in the table; n - 1 are compared with the baseline, each at alpha / (n - 1).
        targets: powers.
        alpha: of the table.
        replications: simulated pairs for each number of seeds (standard error at 80 %: 3 points with 200).
        against_controller: whether one of the two is a controller.
        note: called with the episodes and the number of seeds that is tried next.
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
    """Return how many trainings, or episodes where nothing learns, would decide an open comparison with the baseline.

    Further trainings are taken to be like those that were made: they are drawn from these, with the report's own interval and 80 %
    power. Of two controllers, the difference seen is taken for the true one.

    Args:
        typical: the agents of the table.
        i: place of the agent that is compared.
        baseline: place of the baseline.
        margin: smallest difference of interest; NaN where there is none.
        level: of the interval of this comparison.

    Returns:
        None where no difference can be computed.
    """
    error, episodes = typical.error(i, baseline)
    apart = abs(float(typical.value[i] - typical.value[baseline]))
    if not math.isfinite(error) or not math.isfinite(apart):
        return None
    gains = [typical.gains(place, 0.0) for place in (i, baseline)]
    have = max(map(len, gains))
    if have > 1:
        t = float(quantile(1 - level, episodes - 1))
        found = st.trainings_that_decide(gains[0], gains[1], error, t, level, margin, power=POWER, above=have)
        return Needed("trainings", found)
    goals = [distance for distance in (apart, margin - apart) if distance > 0]
    if not goals:
        return None
    quantiles = float(quantile(1 - level, episodes - 1) + quantile(2 * POWER - 1))
    enough = math.ceil(episodes * (error * quantiles / max(goals)) ** 2)
    return Needed("episodes", enough if enough <= MOST_EPISODES else None)
