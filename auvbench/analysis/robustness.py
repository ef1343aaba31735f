"""What a protocol of several conditions says: which of them costs most, and whether the best is the same everywhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.conditions import UNDISTURBED, in_words, rates_by_condition
from auvbench.analysis.formatting import counted, difference, listed
from auvbench.analysis.measures import measure
from auvbench.analysis.model import Agent, Finding, Ranking
from auvbench.statistics import contrast, crossed, means
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray

ABLE = 0.5
"""success without a disturbance below which an agent has too little to lose"""
MOST = 6
"""conditions that a sentence names"""

Losses = dict[str, dict[str, FloatArray]]
"""by condition and agent: (seeds, episodes) success under it minus success without, scenario by scenario"""


def robustness(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """Findings of a protocol that has the undisturbed condition among others; nothing of any other protocol.

    Losses are those of agents with at least `ABLE` success undisturbed, paired by seed and scenario, averaged over
    these agents; their intervals hold for all conditions together (Bonferroni).
    """
    names = [c.name for c in ranking.conditions if c.name != UNDISTURBED]
    if len(names) == len(ranking.conditions) or not names:
        return []
    losses = _losses(ranking, agents, names)
    if not losses:
        return []
    confidence = 1 - (1 - ranking.confidence) / len(losses)
    overall = {name: _mean(losses[name], confidence) for name in losses}
    found = [_costliest(ranking, losses, overall, confidence), _harmless(overall)]
    return [finding for finding in (*found, _best_elsewhere(ranking, agents, overall)) if finding]


def _losses(ranking: Ranking, agents: Sequence[Agent], names: Sequence[str]) -> Losses:
    """Losses of the agents with something to lose, under the conditions that all of them met."""
    calm: dict[str, FloatArray] = {}
    losses: Losses = {}
    for agent in agents:
        rates = rates_by_condition(agent, ranking.protocol)
        still = rates.get(UNDISTURBED)
        if still is None or still.mean() < ABLE:
            continue
        calm[agent.label] = still
        for name in names:
            there = rates.get(name)
            if there is not None and there.shape == still.shape:
                losses.setdefault(name, {})[agent.label] = there - still
    return {name: by for name, by in losses.items() if by.keys() == calm.keys()}


def _mean(by_agent: dict[str, FloatArray], confidence: float) -> Estimate:
    table = crossed(list(by_agent.values()), bounds=(-1, 1))
    return contrast(table, np.full(len(by_agent), 1 / len(by_agent)), confidence).estimate


def _costliest(
    ranking: Ranking, losses: Losses, overall: dict[str, Estimate], confidence: float
) -> Finding | None:
    m = measure("success_rate")
    worst = min(overall, key=lambda name: overall[name].value)
    if not overall[worst].high < 0:
        return Finding(
            f"No loss of success is resolved under any of {counted(len(overall), 'condition')} of protocol "
            f"{ranking.protocol}.",
            statistic=_method(overall, len(losses[worst]), ranking),
        )
    by = losses[worst]
    each = means(crossed(list(by.values()), bounds=(-1, 1), paired=False), confidence)
    own = dict(zip(by, each, strict=True))
    of = f"averaged over {counted(len(own), 'agent')}" if len(own) > 1 else f"for {next(iter(own))}"
    text = f"Of {counted(len(overall), 'condition')}, {said(worst)} costs most success: {difference(overall[worst], m)} against the undisturbed one, {of}"
    if len(own) > 1:
        least, most = max(own, key=lambda a: own[a].value), min(own, key=lambda a: own[a].value)
        text += f"; least {least} ({difference(own[least], m)}) and most {most} ({difference(own[most], m)})"
    return Finding(f"{text}.", statistic=_method(overall, len(own), ranking))


def _method(overall: dict[str, Estimate], agents: int, ranking: Ranking) -> str:
    covers = listed(list(dict.fromkeys(e.covers for e in overall.values())))
    return (
        f"Paired by seed and scenario, {counted(agents, 'agent')} with at least {100 * ABLE:.0f} % success "
        f"undisturbed; intervals of {100 * ranking.confidence:g} % for {counted(len(overall), 'condition')} together, "
        f"which cover {covers}."
    )


def _harmless(overall: dict[str, Estimate]) -> Finding | None:
    """The conditions under which no loss is resolved, with what they may cost at most."""
    calm = [name for name, e in overall.items() if not e.high < 0]
    if not calm or len(calm) == len(overall):
        return None
    at_most = max(-overall[name].low for name in calm)
    text = f"No loss is resolved under {listed([said(name) for name in calm], MOST)}"
    return Finding(f"{text}: {100 * at_most:.1f} points at most, if any, averaged over these agents.")


def _best_elsewhere(
    ranking: Ranking, agents: Sequence[Agent], overall: dict[str, Estimate]
) -> Finding | None:
    """Whether the agents that are best undisturbed, often several with every episode, are so under the costliest condition."""
    worst = min(overall, key=lambda name: overall[name].value)
    compared = [row.label for row in ranking.rows if row.compared]
    rates = {a.label: rates_by_condition(a, ranking.protocol) for a in agents if a.label in compared}
    both = {label: r for label, r in rates.items() if UNDISTURBED in r and worst in r}
    if len(both) < 2:
        return None
    calm, there = ({a: float(r[c].mean()) for a, r in both.items()} for c in (UNDISTURBED, worst))
    best, under = ([a for a in by if by[a] == max(by.values())] for by in (calm, there))
    values = {a: f"{100 * there[a]:.1f} %" for a in both}
    have = "has" if len(best) == 1 else "have"
    if kept := [a for a in best if a in under]:
        text = f"{listed(kept)} {'has' if len(kept) == 1 else 'have'} the most success both undisturbed and under {said(worst)} ({values[kept[0]]})"
        if lost := sorted((a for a in best if a not in under), key=there.__getitem__):
            text += f"; with as much undisturbed, {listed([f'{a} has {values[a]}' for a in lost])}"
        return Finding(f"{text}.")
    first, last = max(best, key=there.__getitem__), under[0]
    m = measure("success_rate")
    table = crossed([both[last][worst], both[first][worst]], rate=True)
    found = contrast(table, np.array([1.0, -1.0]), ranking.confidence)
    sure = "" if found.p_value < 1 - ranking.confidence else ", which is not resolved"
    of = "" if len(best) == 1 else f" of {first}"
    text = (
        f"Undisturbed {listed(best)} {have} the most success, under {said(worst)} {listed(under)}: {values[last]} against "
        f"{values[first]}{of} ({difference(found.estimate, m)}{sure})."
    )
    statistic = (
        "These two were chosen by looking: rank under the condition (--condition) for a test that counts all."
    )
    return Finding(text, statistic=statistic)


def said(condition: str) -> str:
    """A condition in a sentence.

    >>> said("current=0.5"), said("dead-thruster")
    ('current 0.5 m/s', 'dead-thruster')
    """
    return " ".join(filter(None, in_words(condition)))
