"""How many seeds a study needs: the spread of trainings that are there, and what it takes to resolve a difference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import name, unit
from auvbench.analysis.measures import Measure
from auvbench.analysis.model import Agent, Finding, Ranking
from auvbench.analysis.rounding import significant
from auvbench.errors import ReportError
from auvbench.statistics import power as st
from auvbench.statistics.differences import pair_spread
from auvbench.statistics.resolution import pooled

LEAST, MOST = 0.005, 0.995
"""rates that are planned for"""


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
    """in a table of several, with Holm's correction over all its pairs"""


def needs(
    model: st.Model,
    values: tuple[float, float],
    episodes: int,
    *,
    agents: int = 2,
    targets: Sequence[float] = (0.8, 0.95),
    alpha: float = 0.05,
    replications: int = 500,
    seed: int = 0,
    note: Callable[[int, int], object] = lambda episodes, seeds: None,
) -> Need:
    """Fewest training seeds that resolve two agents, by simulation with the report's test.

    Args:
        model: where trainings come from.
        values: true values of the two agents.
        episodes: test episodes of each training.
        agents: in the table; its pairs are n (n - 1) / 2.
        targets: powers.
        alpha: of the table.
        replications: simulated pairs for each number of seeds (error at 80 %: 2 points with 500), and four times
            as many as there are simulated tables.
        seed: of the simulation.
        note: called with the episodes and the number of seeds that is tried next.
    """
    tried: dict[int, np.ndarray[tuple[int], np.dtype[np.float64]]] = {}

    def at(S: int, level: float) -> float:
        if S not in tried:
            note(episodes, S)
            tried[S] = st.simulated_p(model, values, S, episodes, replications=replications, seed=seed)
        return float((tried[S] < level).mean())

    found: dict[int, float] = {}

    def in_table(S: int) -> float:
        if S not in found:
            note(episodes, S)
            found[S] = st.power(
                model,
                values,
                S,
                episodes,
                agents=agents,
                alpha=alpha,
                replications=replications // 4,
                seed=seed,
            )
        return found[S]

    alone = {target: st.seeds_needed(lambda S: at(S, alpha), target) for target in targets}
    among = {target: st.seeds_needed(in_table, target) for target in targets} if agents > 2 else {}
    return Need(episodes, alone, among)


def advice(ranking: Ranking, agents: Sequence[Agent], m: Measure) -> Finding | None:
    """How many seeds would resolve the first agent from the next that is not; None where nothing is to be said.

    By the power of the t-test with the variances that the report tests them by, at what Holm's correction asks of the
    clearest pair.
    It takes the difference seen for the true one, which it may not be: it says what that would take, no more.
    """
    if ranking.compare != "algorithms" or len(ranking.rows) < 2 or not ranking.rows[0].compared:
        return None
    first = ranking.rows[0]
    other = next((row for row in ranking.rows[1:] if row.compared and not ranking.resolved(first, row)), None)
    pair = [agent for agent in agents if other is not None and agent.label in (first.label, other.label)]
    if other is None or len(pair) != 2:
        return None
    compared = {row.label for row in ranking.rows if row.compared}
    others = [agent for agent in agents if agent.label in compared and agent not in pair]
    table = pooled(m.table([*pair, *others]))
    apart = float(abs(table.mean[0] - table.mean[1]))
    learning = [i for i, agent in enumerate(pair) if learns(agent)]
    if not np.isfinite(apart) or apart == 0 or not learning:
        return None
    spread = pair_spread(table)
    per_seed = float((table.between_seeds * table.seeds)[learning].sum())
    tested = sum(row.compared for row in ranking.rows)
    alpha = (1 - ranking.confidence) / max(tested * (tested - 1) / 2, 1)
    sharing = max(int((table.seeds > 1).sum()), 1)
    n = st.seeds_by_formula(apart, per_seed, float(spread.scenarios[0, 1]), alpha, sharing=sharing)
    points = 100 * apart
    seen = (
        f"{points:{'.2g' if points < 1 else '.1f'}} points" if m.rate else f"{significant(apart, 3)}{unit(m)}"
    )
    have = max(int(table.seeds[i]) for i in learning)
    of = "each" if len(learning) > 1 else pair[learning[0]].label
    subject = f"{first.label} and {other.label} are not resolved in {name(m)}"
    if n is None:
        text = (
            f"{subject}. Here they differ by {seen}, which not even {st.MOST_SEEDS} seeds of {of} would show."
        )
    else:
        text = f"{subject}: if they truly differ by the {seen} seen here, about {max(n, have + 1)} seeds of {of} would show it (there are {have})."
    clearest = f"the clearest of {tested * (tested - 1) // 2} pairs" if tested > 2 else "the one pair"
    statistic = (
        f"80 % power at what Holm's correction asks of {clearest}, with {first.episodes} episodes and the variances "
        "seen; auvbench plan simulates it. Adding seeds until it is resolved would find differences where there are none."
    )
    return Finding(text, statistic=statistic, run_ids=tuple(first.run_ids + other.run_ids))
