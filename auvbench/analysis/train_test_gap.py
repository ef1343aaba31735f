"""Success at the end of training against success in the test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeGuard

from auvbench.analysis.conditions import UNDISTURBED
from auvbench.analysis.effects import learns
from auvbench.analysis.formatting import counted
from auvbench.analysis.records import NO_POLICY, Agent, Finding, Ranking, RunRecord
from auvbench.analysis.timing import step_limit
from auvbench.runs.progress import TELLING, WINDOW
from auvbench.statistics import wilson
from auvbench.statistics.estimate import Estimate

STRONG = 0.2
"""difference of the two rates from which it is worth a sentence"""
LENGTHS = 2
"""of the longest episode, that a training's environments must have had at least"""


@dataclass(frozen=True, slots=True)
class _Gap:
    """The trainings of one agent whose success at the end of training is not that of the test."""

    agent: Agent
    runs: tuple[RunRecord, ...]
    training: float
    """mean over these runs"""
    test: float


def train_test_gaps(ranking: Ranking, agents: Sequence[Agent]) -> list[Finding]:
    """Return a finding for trainings that looked better than their test, and one for trainings that looked worse.

    They differ where the rates are `STRONG` apart and their intervals do not meet. A disturbed test is meant to be
    harder, so there nothing is found.
    """
    if ranking.condition != UNDISTURBED:
        return []
    found = []
    for sign, word in ((1, "better"), (-1, "worse")):
        gaps = [gap for agent in agents if learns(agent) and (gap := _gap(agent, sign, ranking.confidence))]
        if gaps:
            found.append(_finding(gaps, word))
    return found


def _finding(gaps: Sequence[_Gap], word: str) -> Finding:
    worst = max(gaps, key=lambda gap: abs(gap.training - gap.test))
    seeds = f", seed {', '.join(str(run.seed) for run in worst.runs)}" if len(worst.agent.runs) > 1 else ""
    others = len(gaps) - 1
    more = f"; so do{'es' * (others == 1)} {counted(others, 'more agent')}" if others else ""
    text = (
        f"{worst.agent.label} looks {word} in training than in the test: {100 * worst.training:.0f} % against "
        f"{100 * worst.test:.0f} % success{seeds}{more}."
    )
    gap = Estimate(worst.training - worst.test, math.nan, math.nan)
    basis = f"last {min(map(_window, worst.runs))} training episodes, which explore; the test does not"
    ids = tuple(run.id for gap in gaps for run in gap.runs)
    return Finding("train_test_gap", text, tuple(gap.agent.label for gap in gaps), gap, basis, ids)


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
