"""Which condition of a protocol costs most success, and whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auvbench.analysis.conditions import UNDISTURBED, in_words, rates_by_condition
from auvbench.analysis.formatting import counted, difference
from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent, Finding, Ranking
from auvbench.statistics import contrast, crossed, means
from auvbench.statistics.estimate import Estimate
from auvbench.statistics.intervals import FloatArray

ABLE = 0.5
"""success without a disturbance below which an agent has too little to lose"""

Losses = Mapping[str, Mapping[str, FloatArray]]
"""by condition and agent: (seeds, episodes) success under it minus success without, scenario by scenario"""


def costliest_condition(ranking: Ranking, agents: Sequence[Agent]) -> Finding | None:
    """Return the condition that costs most success on average, with the agents that lose most and least.

    Losses are those of agents with at least `ABLE` success undisturbed, paired by seed and scenario. Their intervals
    hold for all conditions together (Bonferroni). None where no loss is resolved, or nothing was disturbed.
    """
    names = [c.name for c in ranking.conditions if c.name != UNDISTURBED]
    losses = _losses(agents, ranking.protocol, names) if len(names) < len(ranking.conditions) else {}
    if not losses:
        return None
    confidence = 1 - (1 - ranking.confidence) / len(losses)
    overall = {name: _mean(by, confidence) for name, by in losses.items()}
    worst = min(overall, key=lambda name: overall[name].value)
    if not overall[worst].high < 0:
        return None
    by = losses[worst]
    table = crossed(list(by.values()), bounds=(-1, 1), paired=False)
    own = dict(zip(by, means(table, confidence), strict=True))
    most, least = min(own, key=lambda a: own[a].value), max(own, key=lambda a: own[a].value)
    m = measure("success_rate")
    text = f"Of {counted(len(overall), 'condition')}, {' '.join(filter(None, in_words(worst)))} costs most success: "
    text += difference(overall[worst], m)
    if len(own) > 1:
        text += (
            f" on average, from {difference(own[least], m)} ({least}) to {difference(own[most], m)} ({most})"
        )
    basis = f"{counted(len(own), 'agent')} with at least {100 * ABLE:.0f} % success undisturbed; paired by scenario"
    return Finding("costliest_condition", f"{text}.", tuple(own), overall[worst], basis)


def _losses(agents: Sequence[Agent], protocol: str, names: Sequence[str]) -> Losses:
    """Return losses of the agents with something to lose, under the conditions that all of them met."""
    calm: dict[str, FloatArray] = {}
    losses: dict[str, dict[str, FloatArray]] = {}
    for agent in agents:
        rates = rates_by_condition(agent, protocol)
        still = rates.get(UNDISTURBED)
        if still is None or still.mean() < ABLE:
            continue
        calm[agent.label] = still
        for name in names:
            there = rates.get(name)
            if there is not None and there.shape == still.shape:
                losses.setdefault(name, {})[agent.label] = there - still
    return {name: by for name, by in losses.items() if by.keys() == calm.keys()}


def _mean(by_agent: Mapping[str, FloatArray], confidence: float) -> Estimate:
    table = crossed(list(by_agent.values()), bounds=(-1, 1))
    return contrast(table, np.full(len(by_agent), 1 / len(by_agent)), confidence).estimate
