"""Which comparisons are evidence at all: of agents with several seeds, equal budgets, one of which learned something."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.effects import learns, matched, mean_difference
from auvbench.analysis.formatting import counted, difference
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent
from auvbench.analysis.study.evidence import cell
from auvbench.analysis.study.verdict import OPEN, Levels, Part, by_interval, more_seeds, runs_of
from auvbench.analysis.timing import budget_of

LEARNED = 0.15
"""test success above which a run learned something: ten runs of 3000 and 5000 steps reached 0.2 to 8.4 %"""

Group = tuple[Agent, ...]


def learned(agent: Agent) -> bool:
    """Whether the best run of an agent succeeds more than an untrained one may."""
    return bool(agent.success.mean(axis=1).max() > LEARNED)


def budget(agent: Agent) -> int | None:
    """Training steps that an agent's runs were given; None where they differ."""
    steps = {budget_of(run) for run in agent.runs}
    return steps.pop() if len(steps) == 1 else None


def informative(groups: Sequence[Group]) -> tuple[list[Group], list[str]]:
    """The groups of agents to be compared that are evidence, and in words why others are not.

    Nothing follows from agents that learned nothing, for the factor does not matter there: a group is left out
    if none of its agents learned. One that did and one that did not is evidence: leaving it out would choose by the
    result.
    """
    kept: list[Group] = []
    left = {"one training seed": 0, "unequal training budgets": 0, "nothing learned by any of its agents": 0}
    for group in groups:
        trained = [agent for agent in group if learns(agent)]
        budgets = {budget(agent) for agent in trained}
        if any(len(agent.outcome) < 2 for agent in trained):
            left["one training seed"] += 1
        elif len(budgets) > 1 or None in budgets:
            left["unequal training budgets"] += 1
        elif not any(learned(agent) for agent in group):
            left["nothing learned by any of its agents"] += 1
        else:
            kept.append(group)
    return kept, [f"{counted(n, 'cell')} left out: {why}" for why, n in left.items() if n]


def extremes(agents: Sequence[Agent]) -> tuple[list[tuple[Agent, Agent]], float, float]:
    """Pairs (largest K, smallest K) of agents equal in all else, and these two K; none where K does not vary."""
    ks = sorted({cell(agent)[0] for agent in agents if np.isfinite(cell(agent)[0])})
    if len(ks) < 2:
        return [], np.nan, np.nan
    return matched(agents, "reward.k", ks[-1], ks[0]), ks[0], ks[-1]


def averaged(
    pairs: Sequence[Group],
    metric: str,
    what: str,
    levels: Levels,
    absent: str,
    above: float = 0.0,
    *,
    less: bool = False,
) -> Part:
    """A part that claims first - second > a bound (`less`: below it) in a measure, averaged over matched cells."""
    if not pairs:
        return Part(OPEN, missing=absent)
    kept, left = informative(pairs)
    if not kept:
        return Part(OPEN, missing="; ".join([f"{absent} that are evidence", *left]), run_ids=runs_of(pairs))
    m = measure(metric)
    two = [(group[0], group[1]) for group in kept]
    verdict = by_interval(lambda c: mean_difference(two, m, c)[0], levels, above, less=less)
    shown = difference(mean_difference(two, m, levels.holds)[0], m)
    statistic = "; ".join([f"{what} {shown} over {counted(len(kept), 'matched cell')}", *left])
    missing = more_seeds([agent for pair in kept for agent in pair]) if verdict == OPEN else ""
    return Part(verdict, statistic, missing, runs_of(kept))
