"""Find results in addition to the primary analysis, with one template per kind of finding, and compute the
effects of a grid's factors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, zip_longest
from typing import Any

import numpy as np

from auvbench.analysis.formatting import counted, difference, name, turned, unit
from auvbench.analysis.labels import OBSERVATION, in_words, observed, part, sort_key
from auvbench.analysis.measures import TIMEOUT, Measure, measure
from auvbench.analysis.records import Agent, Finding, Ranking, learns, run_ids, task_of
from auvbench.analysis.typical import Typical
from auvbench.registry import TASKS
from auvbench.statistics import holm
from auvbench.statistics.intervals import Estimate
from auvbench.statistics.typical import trainings_needed

SHOWN = 5
"""number of findings that a report shows at once; a click shows the others"""
APART = 0.2
"""smallest loss of success rate for which a higher return counts as misleading"""


def find(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """Return the findings, most useful first: the first of each kind, then the second of each, and so on."""
    m = measure(ranking.rank_by)
    ordered = ranking.ordered(agents)
    kinds: list[Sequence[Finding | None]] = [
        [return_misleads(ordered, ranking.confidence)],
        resolved_effects(ranking, ordered, m),
        [seed_variance(ordered, m)],
    ]
    return [finding for row in zip_longest(*kinds) for finding in row if finding is not None]


def return_misleads(agents: Sequence[Agent], confidence: float) -> Finding | None:
    """Return a finding if a trained agent has a higher return than the most successful agent but far less
    success.

    If there are several agents with a higher return, the finding names the least successful of them, and the
    interval is corrected for their number (Bonferroni).
    """
    with_return = [
        a for a in agents if learns(a) and np.isfinite(a.metrics.get("return", np.array(np.nan))).all()
    ]
    if not with_return:
        return None
    good = max(with_return, key=_typical_success)
    richer = [a for a in with_return if _typical_return(a) > _typical_return(good)]
    if not richer:
        return None
    rich = min(richer, key=_typical_success)
    typical = Typical([rich, good], measure("success_rate"))
    less = typical.difference(0, 1, (1 - confidence) / len(richer))
    if not (less.value <= -APART and less.high < 0):
        return None
    returns = [_typical_return(agent) for agent in (rich, good)]
    rates = typical.value
    task = TASKS.get(task_of(rich.runs[0]))
    reached = task.reached if task else ""
    verb, of = ("reaches", f"of the {reached}") if reached else ("succeeds in", "of the episodes")
    text = (
        f"Return and success disagree: the typical training of {rich.label} has a return of {returns[0]:,.0f} against "
        f"{returns[1]:,.0f} of {good.label}, but {verb} {100 * rates[0]:.0f} % {of} against {100 * rates[1]:.0f} %"
    )
    distances = rich.metrics["final_distance_m"][rich.outcome == TIMEOUT]
    radius = rich.runs[0].config.get("task.goal_radius")
    if distances.size and isinstance(radius, int | float) and radius < np.median(distances) < 2 * radius:
        text += (
            f": it collects reward near the waypoint, {np.median(distances):.1f} m from it at the median timeout (goal radius "
            f"{radius:g} m)"
        )
    return Finding(
        "return_misleads", f"{text}.", (rich.label, good.label), less, run_ids=run_ids((rich, good))
    )


def _typical_success(agent: Agent) -> float:
    return float(np.median(agent.success.mean(axis=1)))


def _typical_return(agent: Agent) -> float:
    return float(np.median(agent.metrics["return"].mean(axis=1)))


def resolved_effects(ranking: Ranking, agents: Sequence[Agent], m: Measure) -> list[Finding]:
    """Return the resolved effects of a grid's factors, the largest first."""
    listed_effects = [_as_in_the_table(effect, ranking) for effect in effects(agents, m, ranking.confidence)]
    adjusted = holm([effect.p_value for effect in listed_effects])
    resolved = [e for e, p in zip(listed_effects, adjusted, strict=True) if p < 1 - ranking.confidence]
    resolved.sort(key=lambda effect: -abs(effect.difference.value))
    basis = f"Holm over {counted(len(listed_effects), 'effect')}"
    needed = trainings_needed(max(len(listed_effects), 1), 1 - ranking.confidence)
    return [_effect(effect, m, basis, needed) for effect in resolved]


def _as_in_the_table(effect: Effect, ranking: Ranking) -> Effect:
    """Return an effect. If it has a single pair of agents, replace its difference and p-value by the ranking's for this pair.

    A page would otherwise show two different intervals for the pair.
    """
    if len(effect.pairs) == 1:
        first, second = (agent.label for agent in effect.pairs[0])
        for c in ranking.comparisons:
            if {c.first, c.second} == {first, second}:
                estimate = c.difference if c.first == first else turned(c.difference)
                return replace(effect, difference=estimate, p_value=c.p_value)
    return effect


def _effect(effect: Effect, m: Measure, basis: str, needed: int) -> Finding:
    n = len(effect.pairs)
    cells = f"averaged over {n} matched cells" if n > 1 else "in the one matched cell"
    word = "better" if effect.difference.value * m.sign > 0 else "worse"
    text = (
        f"The typical training of {effect.first} is {word} than that of {effect.second} in {name(m)}: "
        f"{difference(effect.difference, m)}, {cells}. {effect.agree} of {effect.trainings} trainings of {effect.first} are "
        f"{word} than the typical one of {effect.second}."
    )
    if effect.fewest < needed:
        text += f" Fewer than {needed} trainings: holds if trainings cluster around the typical one."
    labels = tuple(agent.label for pair in effect.pairs for agent in pair)
    return Finding("effect", text, labels, effect.difference, basis, run_ids(*effect.pairs))


def seed_variance(agents: Sequence[Agent], m: Measure) -> Finding | None:
    """Return a finding on the agent with the largest variance between seeds; None if no agent qualifies.

    An agent qualifies if the variance between seeds is more than half of the variance of the agent's mean.
    """
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
        f"Seeds make the mean of {agent.label} in {name(m)} the most uncertain: its trainings have values from {low} to "
        f"{high}{unit(m)}. "
        f"{share} % of its variance is between seeds, so more seeds tell more than more episodes."
    )
    return Finding("seed_variance", text, (agent.label,), run_ids=run_ids([agent]))


@dataclass(frozen=True, slots=True)
class Effect:
    """Effect of a factor: typical value at the first level minus typical value at the second level, averaged over matched cells."""

    factor: str
    first: str
    second: str
    pairs: tuple[tuple[Agent, Agent], ...]
    difference: Estimate
    p_value: float
    agree: int
    """Number of trainings at the first level that differ from the second level's typical training in the effect's direction"""
    trainings: int
    """number of trainings at the first level"""
    fewest: int
    """smallest number of trainings of any agent in the pairs"""


def matched(agents: Sequence[Agent], factor: str, first: Any, second: Any) -> list[tuple[Agent, Agent]]:
    """Return pairs of agents that have the two levels of a factor and are equal in all other keys.

    null is a level if the configuration has the key (`task.time_limit: null`), but a missing key is not.
    """
    cells: dict[tuple[tuple[str, Any], ...], dict[Any, Agent]] = {}
    for agent in agents:
        if not _says(agent, factor):
            continue
        other_keys = tuple(sorted((k, v) for k, v in agent.key.items() if k != factor))
        cells.setdefault(other_keys, {})[agent.key.get(factor)] = agent
    pairs = [(cell[first], cell[second]) for cell in cells.values() if first in cell and second in cell]
    return sorted(pairs, key=lambda pair: pair[0].label)


def _says(agent: Agent, factor: str) -> bool:
    """Return whether the agent's configuration has the factor: True for `task.time_limit: null`, False for `algo.tau` of PPO."""
    config = agent.runs[0].config
    return agent.key.get(factor) is not None or factor in config or f"{factor}.name" in config


def mean_difference(
    pairs: Sequence[tuple[Agent, Agent]], m: Measure, confidence: float
) -> tuple[Estimate, float]:
    """Return the difference of typical trainings (first - second), averaged over the pairs, and the p-value of this mean.

    The pairs are fixed (the cells of this grid); trainings and scenarios are random.
    """
    agents = list({id(agent): agent for pair in pairs for agent in pair}.values())
    sides = [sum((first is agent) - (second is agent) for first, second in pairs) for agent in agents]
    weights = {i: side / len(pairs) for i, side in enumerate(sides) if side}
    typical = Typical(agents, m)
    return typical.contrast(weights, 1 - confidence), typical.p_of(weights)


def _effect_of(
    factor: str, levels: tuple[str, str], pairs: Sequence[tuple[Agent, Agent]], m: Measure, confidence: float
) -> Effect:
    estimate, p = mean_difference(pairs, m, confidence)
    agree, trainings, fewest = 0, 0, []
    for pair in pairs:
        typical = Typical(pair, m)
        gains = typical.gains(0, float(typical.value[1]))
        agree += int((gains * m.sign * estimate.value > 0).sum())
        trainings += len(gains)
        fewest.append(typical.fewest((0, 1)))
    return Effect(factor, *levels, tuple(pairs), estimate, p, agree, trainings, min(fewest))


def effects(agents: Sequence[Agent], m: Measure, confidence: float = 0.95) -> list[Effect]:
    """Return the effects of each factor that varies among the agents with several training seeds.

    The compared levels of a factor depend on their number and kind:

    * up to three levels: all pairs;
    * more levels, numbers: the largest against the smallest;
    * more levels, names: all pairs with at least two matched cells. The table of comparisons already has the
      pairs with one matched cell.

    An effect that cannot be tested (no values, a single episode, fewer than five trainings) is left out. Agents
    with one training seed do not count: a difference between two policies is not an effect of a factor.
    """
    learners = [agent for agent in agents if learns(agent) and len(agent.outcome) > 1]
    result = []
    for factor in learners[0].key if learners else ():
        levels = {agent.key.get(factor) for agent in learners if _says(agent, factor)}
        ordered = sorted(levels, key=sort_key)
        few = len(ordered) <= 3
        names = not all(isinstance(level, int | float) for level in ordered)
        chosen = list(combinations(ordered, 2)) if few or names else [(ordered[0], ordered[-1])]
        for second, first in chosen:
            pairs = matched(learners, factor, first, second)
            if len(pairs) >= (1 if few or not names else 2):
                level_labels = _level(factor, first, ordered), _level(factor, second, ordered)
                effect = _effect_of(factor, level_labels, pairs, m, confidence)
                if np.isfinite(effect.p_value):
                    result.append(effect)
    return result


def _level(factor: str, level: Any, levels: Sequence[Any]) -> str:
    if factor == OBSERVATION:
        what, blocks = observed(level, levels)
        if not blocks:
            return "policies with all observations"
        return f"policies {'with' if what == 'observed' else 'without'} {blocks.replace('_', ' ')}"
    text = part(factor, level)
    return f"policies trained with {text}" if in_words(factor, level) else text
