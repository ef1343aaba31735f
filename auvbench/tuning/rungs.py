"""Which trial goes on: pure functions of what all trials have shown so far.

A trial that does not go on is not ended but waits: when the trials after it turn out worse, it goes on after all, from
where it stopped. So a decision is never wrong for good, and a decision taken again after a kill is the same one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

LEAST = 4
"""results of a rung from which its median says something"""

FAILED = -math.inf
"""the score of a trial that failed: it counts among those of its rung, as the worst"""


@dataclass(slots=True)
class Progress:
    """What the decisions know of a trial."""

    number: int
    first: int
    """the rung at which it was looked at first"""
    target: int
    """the rung that it is to reach, or has reached"""
    scores: dict[int, float] = field(default_factory=dict)
    """by rung; higher is better"""
    closed: bool = False
    """failed, or its study was over before: it does not go on"""

    @property
    def waits(self) -> bool:
        """Whether it has reached its rung and might go on."""
        return not self.closed and self.target in self.scores


@dataclass(frozen=True, slots=True)
class Ladder:
    """The rungs of a study and who climbs them."""

    budgets: tuple[int, ...]
    """environment steps, growing"""
    pruner: str
    """halving | hyperband | median | none"""
    reduction: int = 3

    @property
    def top(self) -> int:
        return len(self.budgets) - 1

    def first(self, number: int) -> int:
        """The first rung of a trial: 0 but for Hyperband's later brackets, and the last one without pruning.

        Hyperband (Li et al. 2018, JMLR 18(185)): bracket s begins at rung s, and has ceil(R/(R-s)) eta^(R-1-s) of
        the trials, R rungs in all; they take turns in that ratio.
        """
        if self.pruner == "none":
            return self.top
        if self.pruner != "hyperband":
            return 0
        rungs = len(self.budgets)
        shares = [math.ceil(rungs / (rungs - s)) * self.reduction ** (rungs - 1 - s) for s in range(rungs)]
        given = [0] * rungs
        for _ in range(number + 1):
            bracket = min(range(rungs), key=lambda s: ((given[s] + 1) / shares[s], s))
            given[bracket] += 1
        return bracket

    def promotion(self, trials: Sequence[Progress]) -> int | None:
        """The number of the trial that goes on next, from the highest rung on which one may; None where none may."""
        for rung in range(self.top - 1, -1, -1):
            for bracket in sorted({trial.first for trial in trials}):
                own = [trial for trial in trials if trial.first == bracket]
                there = {trial.number: trial.scores[rung] for trial in own if rung in trial.scores}
                waiting = [trial.number for trial in own if trial.target == rung and trial.waits]
                allowed = [number for number in ranked(there)[: self._places(there)] if number in waiting]
                if allowed:
                    return allowed[0]
        return None

    def _places(self, there: Mapping[int, float]) -> int:
        """How many of a rung may go on.

        Halving: the best 1/eta of those that have reached it by now (asynchronous successive halving: Li et al.
        2020, MLSys, algorithm 2). Median: those that are no worse than the median (Golovin et al. 2017, KDD).
        """
        if self.pruner == "median":
            middle = median(there.values()) if len(there) >= LEAST else FAILED
            return sum(score >= middle and score > FAILED for score in there.values())
        return len(there) // self.reduction

    def last_resort(self, trials: Sequence[Progress]) -> int | None:
        """Who goes on when all trials were begun and too few for the rule: the best, unless one is at the top."""
        if any(self.top in trial.scores for trial in trials):
            return None
        for rung in range(self.top - 1, -1, -1):
            waiting = {t.number: t.scores[rung] for t in trials if t.target == rung and t.waits}
            if waiting:
                return ranked(waiting)[0]
        return None


def ranked(scores: Mapping[int, float]) -> list[int]:
    """Trial numbers, best score first; of equals the earlier one."""
    return sorted(scores, key=lambda number: (-scores[number], number))


def order(trials: Sequence[Progress]) -> list[int]:
    """All trials that have shown something, best first: by the rung that they have reached, then by their score there."""

    def place(trial: Progress) -> tuple[float, float, int]:
        highest = max(trial.scores)
        return (-highest, -trial.scores[highest], trial.number)

    shown = [t for t in trials if t.scores and max(t.scores.values()) > FAILED]
    return [trial.number for trial in sorted(shown, key=place)]
