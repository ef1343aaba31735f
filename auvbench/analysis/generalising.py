"""Success at the end of training against success in the test: a policy that trains well and tests badly, or the reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

from auvbench.analysis.conditions import UNDISTURBED
from auvbench.analysis.effects import learns
from auvbench.analysis.model import NO_POLICY, Agent, Finding, Ranking, RunRecord
from auvbench.analysis.prose import counted, listed
from auvbench.runs.progress import WINDOW
from auvbench.statistics import wilson

STRONG = 0.2
"""difference of the two rates from which it is worth a sentence"""
MOST = 5
"""agents that a sentence names"""


@dataclass(frozen=True, slots=True)
class _Gap:
    """The trainings of an agent whose test tells another story."""

    agent: Agent
    runs: tuple[RunRecord, ...]
    training: float
    """mean over these runs"""
    test: float

    @property
    def text(self) -> str:
        seeds = counted(len(self.agent.runs), "seed")
        of = f"seed {self.runs[0].seed}" if len(self.runs) == 1 else f"{len(self.runs)} of {seeds}"
        where = "" if len(self.agent.runs) == 1 else f", {of}"
        return f"{self.agent.label} ({100 * self.training:.0f} % against {100 * self.test:.0f} %{where})"


def training_and_test(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """A finding for trainings that promised more than the test kept, and one for the reverse; none where they agree.

    They differ where the rates are `STRONG` apart and their intervals have no value in common. Of a disturbed
    condition nothing is said: there the test is meant to be harder.
    """
    if ranking.condition != UNDISTURBED:
        return []
    found = []
    for sign, verdict in ((1, "promises more than the test keeps"), (-1, "looks worse than the test is")):
        gaps = [gap for agent in agents if learns(agent) and (gap := _gap(agent, sign, ranking.confidence))]
        gaps.sort(key=lambda gap: -abs(gap.training - gap.test))
        if not gaps:
            continue
        text = (
            f"Training {verdict}: success in the last {WINDOW} training episodes against the test, "
            f"{listed([gap.text for gap in gaps], MOST)}."
        )
        statistic = (
            f"Rates {100 * STRONG:.0f} points apart or more, whose {100 * ranking.confidence:g} % intervals do not "
            "meet. Training adds exploration to every action, and the test takes the policy's own; so the two may "
            "differ, and the test is what is ranked."
        )
        ids = tuple(run.id for gap in gaps for run in gap.runs)
        found.append(Finding(text, statistic=statistic, run_ids=ids))
    return found


def _gap(agent: Agent, sign: int, confidence: float) -> _Gap | None:
    runs, training, test = [], [], []
    for run, outcome in zip(agent.runs, agent.outcome, strict=True):
        rate, episodes = run.manifest.get("success_rate"), run.manifest.get("episodes")
        if (
            not _is_rate(rate)
            or not isinstance(episodes, int)
            or episodes < 1
            or (outcome == NO_POLICY).any()
        ):
            continue
        n, won = min(episodes, WINDOW), int((outcome == 0).sum())
        here = wilson(round(rate * n), n, confidence)
        there = wilson(won, len(outcome), confidence)
        difference = sign * (rate - won / len(outcome))
        apart = here[0] > there[1] if sign > 0 else here[1] < there[0]
        if difference >= STRONG and bool(apart):
            runs.append(run)
            training.append(rate)
            test.append(won / len(outcome))
    if not runs:
        return None
    return _Gap(agent, tuple(runs), sum(training) / len(runs), sum(test) / len(runs))


def _is_rate(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and math.isfinite(value) and 0 <= value <= 1
