"""Prepare the input of the figures: ranked agents, their looks, and their training records, each read only once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from auvbench.analysis.conditions import of_evaluations
from auvbench.analysis.damage import Damage
from auvbench.analysis.evaluations import evaluation_of
from auvbench.analysis.recorded import training
from auvbench.analysis.records import Agent, Condition, Evaluation, Problem, Ranking, RunRecord
from auvbench.reporting.figures.looks import Look, colour_of
from auvbench.statistics.intervals import FloatArray

MANY = 8
"""largest number of lines in a panel"""
FEWEST_EPISODES = 10
"""smallest number of training episodes for which a figure shows a training"""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A figure before it is saved."""

    canvas: Canvas
    title: str
    caption: str


@dataclass(slots=True, eq=False)
class Scene:
    """Data that the figures of one report share."""

    agents: tuple[Agent, ...]
    """agents in the order of the ranking"""
    ranking: Ranking
    looks: Mapping[str, Look]
    problems: list[Problem] = field(default_factory=list)
    """damage found while drawing"""
    _training: dict[str, pd.DataFrame | None] = field(default_factory=dict)

    def top(self, k: int, among: Sequence[Agent] | None = None) -> tuple[Agent, ...]:
        """Return the k best-ranked agents (of `among` if given). The baseline replaces the last of these agents if it is not included."""
        agents = self.agents if among is None else tuple(among)
        chosen = agents[:k]
        primary = self.ranking.primary
        baseline = [agent for agent in agents if primary is not None and agent.label == primary.baseline]
        if baseline and baseline[0] not in chosen:
            return (*chosen[:-1], baseline[0])
        return chosen

    def learners(self) -> tuple[Agent, ...]:
        """Return the agents whose runs have training records, without reading the records."""
        return tuple(a for a in self.agents if any(r.source.has_training() for r in a.runs))

    def trained(self, agents: Sequence[Agent]) -> tuple[Agent, ...]:
        """Return the agents with usable training records (see `training`)."""
        return tuple(a for a in agents if any(self.training(run) is not None for run in a.runs))

    def looks_of(self, agents: Sequence[Agent]) -> dict[str, Look]:
        """Return the looks of some agents, by label."""
        return {agent.label: self.looks[agent.label] for agent in agents}

    def training(self, run: RunRecord) -> pd.DataFrame | None:
        """Return a run's training episodes; None if they are missing or damaged, or fewer than `FEWEST_EPISODES`."""
        if run.id not in self._training:
            frame = None
            try:
                frame = training(run)
            except Damage as damage:
                self.problem(run, damage)
            self._training[run.id] = frame if frame is not None and len(frame) >= FEWEST_EPISODES else None
        return self._training[run.id]

    def tested(self, agent: Agent, protocol: str) -> tuple[Condition, ...]:
        """Return an agent's results by condition, without seeds whose test scenarios differ from the first seed's."""
        evaluations = [evaluation for run in agent.runs if (evaluation := self._evaluation(run, protocol))]
        comparable = [
            evaluation for evaluation in evaluations if evaluation.fingerprint == evaluations[0].fingerprint
        ]
        return of_evaluations({agent.label: comparable}, self.ranking.confidence)

    def _evaluation(self, run: RunRecord, protocol: str) -> Evaluation | None:
        if protocol in run.evaluations:
            return run.evaluations[protocol]
        if protocol not in run.source.protocols():
            return None
        try:
            return evaluation_of(run, protocol)
        except Damage as damage:
            self.problems.append(Problem(run.id, damage.kind, f"evaluation {protocol}: {damage}"))
            return None

    def problem(self, run: RunRecord, damage: Damage) -> None:
        """Record damage of a run's file."""
        self.problems.append(Problem(run.id, damage.kind, str(damage)))


def scene(agents: Sequence[Agent], ranking: Ranking) -> Scene:
    """Return the scene of a ranking: the agents in the ranking's order, with their looks."""
    ordered = ranking.ordered(agents)
    return Scene(tuple(ordered), ranking, colour_of(ordered))


def shown(chosen: Sequence[Agent], of: Sequence[Agent]) -> str:
    """Return the caption's sentence on agents that are left out; '' if all are shown."""
    if len(chosen) >= len(of):
        return ""
    return f" Shown: {len(chosen)} of {len(of)} agents, the best-ranked."


def wants_symlog(values: Sequence[FloatArray]) -> bool:
    """Return whether the 90th percentiles of the agents' absolute returns differ by more than a factor of ten."""
    sizes = [float(np.nanpercentile(np.abs(v), 90)) for v in values if v.size and np.isfinite(v).any()]
    return len(sizes) > 1 and max(sizes) > 10 * max(min(sizes), 1.0)


ROBUST = 4
"""smallest number of seeds for which the interquartile mean differs from the mean"""

Curve = tuple[FloatArray, FloatArray]
"""x values (n,) of a curve, and y values (seeds, n); a y value is NaN if the seed has no value at this x"""


def middle(y: FloatArray) -> FloatArray:
    """Return the interquartile mean (n,) of values (seeds, n), over the seeds that have a value.

    Of k values, the floor(k/4) smallest and the floor(k/4) largest are left out (Agarwal et al. 2021, NeurIPS). For
    fewer than four values, this is the mean.
    """
    ordered = np.sort(y, axis=0)  # NaN last
    count = np.isfinite(y).sum(axis=0)
    place = np.arange(len(y))[:, None]
    inner = (place >= count // 4) & (place < count - count // 4)
    total, number = np.where(inner, ordered, 0.0).sum(axis=0), inner.sum(axis=0)
    return np.asarray(np.divide(total, number, out=np.full(y.shape[1], np.nan), where=number > 0))


def band(ax: Axes, look: Look, curve: Curve, *, dots: bool = False) -> None:
    """Draw the interquartile mean over an agent's seeds as a line, and the range of the seeds as a band.

    With `dots`, also draw a dot for each value of each seed.
    """
    x, y = curve
    present = np.isfinite(y).any(axis=0)
    if not present.any():
        return
    x, y = x[present], y[:, present]
    if len(y) > 1:
        ax.fill_between(
            x, np.nanmin(y, axis=0), np.nanmax(y, axis=0), color=look.colour, alpha=0.15, linewidth=0
        )
    if dots:
        for row in y:
            ax.plot(x, row, ".", color=look.colour, markersize=3.2, alpha=0.55, markeredgewidth=0)
    ax.plot(x, middle(y), color=look.colour, linestyle=look.linestyle)


def lines_sentence(agents: Sequence[Agent], *, dots: bool = False) -> str:
    """Return the caption's sentence on lines, bands and dots."""
    most = max(len(agent.runs) for agent in agents)
    if most < 2:
        return " One training seed per agent."
    lines = "interquartile mean over training seeds" if most >= ROBUST else "mean over training seeds"
    few = any(len(agent.runs) < ROBUST for agent in agents)
    lines += " (plain mean for agents with fewer than four seeds)" if most >= ROBUST and few else ""
    return f" Lines: {lines}; bands: their range{'; dots: the seeds' if dots else ''}."
