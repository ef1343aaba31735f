"""Success at the end of training against success in the test: a policy that trains well and tests badly, or the reverse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

from auvbench.analysis.conditions import UNDISTURBED
from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import counted, listed
from auvbench.analysis.model import NO_POLICY, Agent, Finding, Ranking, RunRecord
from auvbench.analysis.timing import step_limit
from auvbench.runs.progress import TELLING, WINDOW
from auvbench.statistics import wilson

STRONG = 0.2
"""difference of the two rates from which it is worth a sentence"""
LENGTHS = 2
"""of the longest episode, that a training's environments must have had at least"""
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
        fewest = min(_window(run) for gap in gaps for run in gap.runs)
        last = (
            f"{WINDOW} training episodes" if fewest == WINDOW else f"training episodes ({fewest} to {WINDOW})"
        )
        text = (
            f"Training {verdict}: success in the last {last} against the test, "
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
        rate = run.manifest.get("success_rate")
        if not _is_rate(rate) or not _telling(run) or (outcome == NO_POLICY).any():
            continue
        n, won = _window(run), int((outcome == 0).sum())
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


def _window(run: RunRecord) -> int:
    """The training episodes that the manifest's success is of: the last `WINDOW`, or all where there were fewer."""
    episodes = run.manifest.get("episodes")
    return min(episodes, WINDOW) if isinstance(episodes, int) else 0


def _telling(run: RunRecord) -> bool:
    """Whether the last training episodes are like any other.

    Some tens must have ended, and long ones must have had the time to: of the first episodes of many environments only
    short ones have ended, which are successes or collisions and never timeouts.
    """
    if _window(run) < TELLING:
        return False
    steps, at_once = run.manifest.get("steps"), run.config.get("algo.n_envs") or 1
    return not isinstance(steps, int) or steps / float(at_once) >= LENGTHS * step_limit(run)


def _is_rate(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and math.isfinite(value) and 0 <= value <= 1
