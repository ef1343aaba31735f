"""Findings: what the data show in addition to the primary analysis, one template per kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from auvbench.analysis.effects import Effect, effects, learns
from auvbench.analysis.formatting import counted, difference, name, turned, unit
from auvbench.analysis.measures import TIMEOUT, Measure, measure
from auvbench.analysis.records import Agent, Finding, Ranking
from auvbench.statistics import contrast, holm

SHOWN = 5
"""findings that a report shows at once; the others are one click away"""
APART = 0.2
"""difference of two success rates from which a higher return misleads"""


def find(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """Return the findings, most useful first: the first of each kind, then the second of each, and so on."""
    m = measure(ranking.rank_by)
    by_label = {agent.label: agent for agent in agents}
    ordered = [by_label[row.label] for row in ranking.rows]
    kinds: list[Sequence[Finding | None]] = [
        [return_misleads(ordered, ranking.confidence)],
        resolved_effects(ranking, ordered, m),
        [seed_variance(ordered, m)],
    ]
    return [finding for row in zip_longest(*kinds) for finding in row if finding is not None]


def return_misleads(agents: Sequence[Agent], confidence: float) -> Finding | None:
    """Return a finding where a trained agent has a higher return than the most successful one and far less success.

    Of several such agents the least successful is named; the interval counts all of them (Bonferroni).
    """
    whole = [a for a in agents if learns(a) and np.isfinite(a.metrics.get("return", np.array(np.nan))).all()]
    if not whole:
        return None
    good = max(whole, key=lambda a: float(a.success.mean()))
    richer = [a for a in whole if a.metrics["return"].mean() > good.metrics["return"].mean()]
    if not richer:
        return None
    rich = min(richer, key=lambda a: float(a.success.mean()))
    table = measure("success_rate").table([rich, good])
    level = (1 - confidence) / len(richer)
    less = contrast(table, np.array([1.0, -1.0]), 1 - level).estimate
    if not (less.value <= -APART and less.high < 0):
        return None
    returns = [float(a.metrics["return"].mean()) for a in (rich, good)]
    rates = [float(a.success.mean()) for a in (rich, good)]
    waypoints = rich.runs[0].config.get("task.name", "waypoint") == "waypoint"
    verb, of = ("reaches", "of the waypoints") if waypoints else ("succeeds in", "of the episodes")
    text = (
        f"Return and success disagree: {rich.label} has a return of {returns[0]:,.0f} against {returns[1]:,.0f} of "
        f"{good.label}, but {verb} {100 * rates[0]:.0f} % {of} against {100 * rates[1]:.0f} %"
    )
    left = rich.metrics["final_distance_m"][rich.outcome == TIMEOUT]
    radius = rich.runs[0].config.get("task.goal_radius")
    if left.size and isinstance(radius, int | float) and radius < np.median(left) < 2 * radius:
        text += (
            f": it collects reward near the waypoint, {np.median(left):.1f} m from it at the median timeout (goal radius "
            f"{radius:g} m)"
        )
    ids = tuple(run.id for agent in (rich, good) for run in agent.runs)
    return Finding("return_misleads", f"{text}.", (rich.label, good.label), less, "", ids)


def resolved_effects(ranking: Ranking, agents: Sequence[Agent], m: Measure) -> list[Finding]:
    """Return the resolved effects of the factors of a grid, the largest first."""
    found = [_as_in_the_table(effect, ranking) for effect in effects(agents, m, ranking.confidence)]
    adjusted = holm([effect.p_value for effect in found])
    resolved = [e for e, p in zip(found, adjusted, strict=True) if p < 1 - ranking.confidence]
    resolved.sort(key=lambda effect: -abs(effect.difference.value))
    basis = f"Holm over {counted(len(found), 'effect')}"
    return [_effect(effect, m, basis) for effect in resolved]


def _as_in_the_table(effect: Effect, ranking: Ranking) -> Effect:
    """Return an effect of one pair with that pair's interval: a difference has one interval on a page."""
    if len(effect.pairs) == 1:
        first, second = (agent.label for agent in effect.pairs[0])
        for c in ranking.comparisons:
            if {c.first, c.second} == {first, second}:
                seen = c.difference if c.first == first else turned(c.difference)
                return replace(effect, difference=seen, p_value=c.p_value)
    return effect


def _effect(effect: Effect, m: Measure, basis: str) -> Finding:
    n = len(effect.pairs)
    cells = f"averaged over {n} matched cells" if n > 1 else "in the one matched cell"
    word = "better" if effect.difference.value * m.sign > 0 else "worse"
    change = difference(effect.difference, m)
    text = f"{effect.first} is {word} than {effect.second} in {name(m)}: {change}, {cells}."
    pairs = [agent for pair in effect.pairs for agent in pair]
    ids = tuple(dict.fromkeys(run.id for agent in pairs for run in agent.runs))
    return Finding("effect", text, tuple(agent.label for agent in pairs), effect.difference, basis, ids)


def seed_variance(agents: Sequence[Agent], m: Measure) -> Finding | None:
    """Return the agent whose trainings differ most, where seeds are most of its variance; None elsewhere."""
    several = [a for a in agents if len(a.outcome) > 1 and learns(a) and np.isfinite(m.values(a)).all()]
    if not several:
        return None
    table = m.table(several, paired=False)
    seeds = np.maximum(table.between_seeds - table.residual, 0.0)
    shares = np.divide(seeds, table.variance, out=np.zeros_like(seeds), where=table.variance > 0)
    i = int(np.argmax(np.where(shares > 0.5, seeds, -1.0)))
    if not shares[i] > 0.5:
        return None
    agent, means = several[i], m.values(several[i]).mean(axis=1)
    low, high = (f"{100 * x:.1f}" if m.rate else f"{x:.4g}" for x in (means.min(), means.max()))
    share = "> 99" if shares[i] > 0.99 else f"{100 * shares[i]:.0f}"
    text = (
        f"Trainings of {agent.label} differ most in {name(m)}: {low} to {high}{unit(m)}. {share} % of "
        "its variance is between seeds, so more seeds tell more than more episodes."
    )
    ids = tuple(run.id for run in agent.runs)
    return Finding("seed_variance", text, (agent.label,), None, "", ids)
