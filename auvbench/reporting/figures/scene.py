"""What a figure is drawn from: agents in the order of the ranking, their looks, and records read once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from auvbench.analysis.evaluations import Damage, evaluation_of, protocols_of
from auvbench.analysis.records import Agent, Condition, Evaluation, Problem, Ranking, RunRecord
from auvbench.analysis.training import has_training, training
from auvbench.reporting.figures.style import Look, colour_of

FloatArray = NDArray[np.float64]

MANY = 8
"""more lines than this in one panel are a thicket"""

FEWEST_EPISODES = 10
"""of a training that is worth a line"""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """A figure before it is saved."""

    canvas: Canvas
    title: str
    caption: str


@dataclass(slots=True, eq=False)
class Scene:
    """Everything the figures of one report share."""

    agents: tuple[Agent, ...]
    """in the order of the ranking"""
    ranking: Ranking
    looks: Mapping[str, Look]
    conditions: dict[tuple[str, str], tuple[Condition, ...]] = field(default_factory=dict)
    """by label and protocol, as far as a figure has read them"""
    problems: list[Problem] = field(default_factory=list)
    """damage that came to light while drawing"""
    _training: dict[str, pd.DataFrame | None] = field(default_factory=dict)

    def top(self, k: int, among: Sequence[Agent] | None = None) -> tuple[Agent, ...]:
        """The k best-ranked agents, with the baseline in the last place if it is not among them."""
        agents = self.agents if among is None else tuple(among)
        chosen = agents[:k]
        primary = self.ranking.primary
        baseline = [agent for agent in agents if primary is not None and agent.label == primary.baseline]
        if baseline and baseline[0] not in chosen:
            return (*chosen[:-1], baseline[0])
        return chosen

    def learners(self) -> tuple[Agent, ...]:
        """Agents with training records."""
        return tuple(a for a in self.agents if any(has_training(r) for r in a.runs))

    def trained(self, agents: Sequence[Agent]) -> tuple[Agent, ...]:
        """Those with a seed whose training can be drawn."""
        return tuple(a for a in agents if any(self.training(run) is not None for run in a.runs))

    def looks_of(self, agents: Sequence[Agent]) -> dict[str, Look]:
        return {agent.label: self.looks[agent.label] for agent in agents}

    def training(self, run: RunRecord) -> pd.DataFrame | None:
        """train/episodes.csv; None where it is absent, too short for a line, or damaged, which becomes a problem."""
        if run.id not in self._training:
            frame = None
            try:
                frame = training(run)
            except Damage as damage:
                self.problem(run, damage)
            self._training[run.id] = frame if frame is not None and len(frame) >= FEWEST_EPISODES else None
        return self._training[run.id]

    def problem(self, run: RunRecord, damage: Damage) -> None:
        self.problems.append(Problem(run.id, damage.kind, str(damage)))


def scene(agents: Sequence[Agent], ranking: Ranking) -> Scene:
    """Agents that the ranking has, in its order, with their looks."""
    by_label = {agent.label: agent for agent in agents}
    ordered = tuple(by_label[row.label] for row in ranking.rows if row.label in by_label)
    return Scene(ordered, ranking, colour_of(ordered))


def shown(chosen: Sequence[Agent], of: Sequence[Agent]) -> str:
    """'' or the sentence of a caption that says what was left out."""
    if len(chosen) >= len(of):
        return ""
    return f" Shown: {len(chosen)} of {len(of)} agents, the best-ranked."


def without(wanted: Sequence[Agent], chosen: Sequence[Agent], what: str) -> str:
    """'' or the sentence of a caption that names the agents that have nothing to draw."""
    absent = [agent.label for agent in wanted if agent not in chosen]
    return f" Without usable {what}: {', '.join(absent)}." if absent else ""


def seeds_sentence(agents: Sequence[Agent], band: str = "the range over training seeds") -> str:
    """What lines and bands are, given the seeds there are."""
    if all(len(agent.runs) < 2 for agent in agents):
        return " One training seed per agent."
    return f" Lines: mean over training seeds; bands: {band}."


def wants_symlog(values: Sequence[FloatArray]) -> bool:
    """Whether rewards of different K would squeeze the smaller ones onto the axis."""
    sizes = [float(np.nanpercentile(np.abs(v), 90)) for v in values if v.size and np.isfinite(v).any()]
    return len(sizes) > 1 and max(sizes) > 10 * max(min(sizes), 1.0)


def evaluation(scene: Scene, run: RunRecord, protocol: str) -> Evaluation | None:
    """Return an evaluation, loaded before or read now; None without one or with a damaged one, which becomes a problem."""
    if protocol in run.evaluations:
        return run.evaluations[protocol]
    if protocol not in protocols_of(run):
        return None
    try:
        return evaluation_of(run, protocol)
    except Damage as damage:
        scene.problems.append(Problem(run.id, damage.kind, f"evaluation {protocol}: {damage}"))
        return None
