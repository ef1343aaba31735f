"""Compare our test table with the original study's: the same cells and measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from auvbench.analysis.measures import measure
from auvbench.analysis.records import Agent
from auvbench.analysis.study import thesis
from auvbench.analysis.study.evidence import Evidence, cell
from auvbench.statistics import means, wilson
from auvbench.statistics.estimate import Estimate


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One number of the thesis and ours."""

    agent: str
    """the thesis's name, SAC4"""
    label: str
    """ours; empty where the cell was not run"""
    measure: str
    title: str
    thesis: float
    """rates in percent"""
    mark: str
    """'r' restored from sums, 'text' given in the text only"""
    thesis_interval: tuple[float, float] | None
    """of a rate, in percent: Wilson's for 200 episodes of one training seed"""
    ours: Estimate | None
    """rates in percent"""


def compare(agents: Sequence[Agent], confidence: float = 0.95) -> tuple[ComparisonRow, ...]:
    """Every number of the thesis's table with ours of the same algorithm, K and training frequency."""
    evidence = Evidence((), agents, confidence, 0)
    ours = {metric: _estimates(metric, agents, confidence) for metric in thesis.TABLE}
    rows = []
    for name in thesis.AGENTS:
        mine = [a for a in evidence.of(name[:3].lower()) if cell(a) == thesis.CELLS[name[3:]]]
        agent = mine[0] if len(mine) == 1 else None
        for metric, row in thesis.TABLE.items():
            if name in row:
                label = "" if agent is None else agent.label
                rows.append(_beside(name, metric, row[name], label, ours[metric].get(label), confidence))
    return tuple(rows)


def _estimates(metric: str, agents: Sequence[Agent], confidence: float) -> dict[str, Estimate]:
    """By label, rates in percent."""
    m = measure(metric)
    scale = 100.0 if m.rate else 1.0
    found = means(m.table(agents, paired=False), confidence) if agents else []
    return {
        agent.label: replace(e, value=scale * e.value, low=scale * e.low, high=scale * e.high)
        for agent, e in zip(agents, found, strict=True)
    }


def _beside(
    name: str, metric: str, reported: thesis.Reported, label: str, ours: Estimate | None, confidence: float
) -> ComparisonRow:
    interval = None
    if measure(metric).rate:
        low, high = wilson(reported.value / 100 * thesis.EPISODES, thesis.EPISODES, confidence)
        interval = (100 * float(low), 100 * float(high))
    return ComparisonRow(
        name, label, metric, thesis.TITLES[metric], reported.value, reported.mark, interval, ours
    )
