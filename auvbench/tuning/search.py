"""A study's next step: what to train now, given what was seen. Knows nothing of how runs are carried out."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from auvbench.config import schema
from auvbench.config.agents import learns
from auvbench.config.compose import with_algorithm
from auvbench.errors import ConfigError
from auvbench.tuning import rungs, samplers
from auvbench.tuning.folder import Plan
from auvbench.tuning.journal import Journal
from auvbench.tuning.space import with_values


@dataclass(frozen=True, slots=True)
class Step:
    """A trial is to be brought to a rung."""

    trial: int
    rung: int


def ladder_of(plan: Plan) -> rungs.Ladder:
    """The rungs of a study; what does not learn has one."""
    if not learns(plan.base["algo"]):
        return rungs.Ladder(plan.budgets[-1:], "none")
    return rungs.Ladder(plan.budgets, plan.tune.pruner, plan.tune.reduction)


def sampler_of(plan: Plan) -> samplers.Sampler:
    """How a study proposes."""
    return samplers.Sampler(
        plan.tune.sampler, plan.seed, plan.tune.startup, plan.dimensions, ladder_of(plan).budgets
    )


class Search:
    """Decides what to train next; everything it decides is in the journal before it is done.

    Args:
        plan: of the study.
        journal: open for writing.
        base: the checked configuration of a run of the study, against which proposals are checked.
    """

    def __init__(self, plan: Plan, journal: Journal, base: schema.TrainConfig | None = None) -> None:
        self.plan = plan
        self.journal = journal
        self.ladder = ladder_of(plan)
        self.sampler = sampler_of(plan)
        self.base = base
        most = samplers.check(plan.tune.sampler, plan.dimensions)
        self.trials = plan.tune.trials if most is None else min(plan.tune.trials, most)
        self.under_way: set[int] = set()

    @property
    def progress(self) -> list[rungs.Progress]:
        return self.journal.progress

    def algo(self, trial: int) -> dict[str, Any]:
        """The plain values of `algo` of a trial."""
        return with_values(self.plan.base["algo"], self.plan.dimensions, self.journal.params[trial])

    def next(self) -> Step | None:
        """What to begin now; None when there is nothing until a result comes, or at all.

        First what was begun and has no result, then who may go on, then a new trial.
        """
        for trial in self.progress:
            if not trial.closed and trial.target not in trial.scores and trial.number not in self.under_way:
                return self._begin(trial)
        promoted = self.ladder.promotion(self.progress)
        if promoted is not None:
            return self._begin(self.journal.promote(promoted))
        while len(self.progress) < self.trials:
            number = len(self.progress)
            proposed = self.sampler.propose(self.journal.params, self.progress)
            trial = self.journal.start(proposed, self.ladder.first(number))
            if why := self._impossible(number):
                self.journal.fail(number, why)
                continue
            return self._begin(trial)
        if not self.under_way and (last := self.ladder.last_resort(self.progress)) is not None:
            return self._begin(self.journal.promote(last))
        return None

    def _begin(self, trial: rungs.Progress) -> Step:
        self.under_way.add(trial.number)
        return Step(trial.number, trial.target)

    def _impossible(self, trial: int) -> str:
        if self.base is None:
            return ""
        try:
            with_algorithm(self.base, self.algo(trial))
        except ConfigError as error:
            return str(error)
        return ""

    def report(self, trial: int, result: Mapping[str, Any]) -> None:
        """A trial has reached its rung."""
        self.journal.report(trial, result)
        self.under_way.discard(trial)

    def fail(self, trial: int, why: str) -> None:
        """A trial's training came to nothing, through its own settings."""
        self.journal.fail(trial, why)
        self.under_way.discard(trial)

    def release(self, trial: int) -> None:
        """A trial was not brought to its rung, through no doing of its own; it is begun again another time."""
        with contextlib.suppress(KeyError):
            self.under_way.remove(trial)

    @property
    def best(self) -> int | None:
        """The best trial so far."""
        found = rungs.order(self.progress)
        return found[0] if found else None

    def counts(self) -> dict[str, int]:
        """Trials that reached the last rung, that wait, that are being trained, and that failed."""
        top = self.ladder.top
        failed = sum(bool(error) for error in self.journal.errors)
        done = sum(trial.scores.get(top, rungs.FAILED) > rungs.FAILED for trial in self.progress)
        running = len(self.under_way)
        return {
            "done": done,
            "running": running,
            "pruned": len(self.progress) - done - running - failed,
            "failed": failed,
        }

    def steps_expected(self) -> int:
        """Environment steps of the whole search for one seed, about: as many trials as the rule lets through."""
        ladder, spent = self.ladder, 0
        for number in range(self.trials):
            spent += ladder.budgets[ladder.first(number)]
        share = 1.0 / ladder.reduction if ladder.pruner in ("halving", "hyperband") else 0.5
        for rung in range(1, len(ladder.budgets)):
            if ladder.pruner == "none":
                break
            reached = max(1, sum(t.target >= rung > t.first for t in self.progress))
            expected = max(reached, round(self.trials * share**rung))
            spent += expected * (ladder.budgets[rung] - ladder.budgets[rung - 1])
        return spent

    def steps_done(self) -> int:
        """Environment steps behind the results so far, for one seed."""
        total = 0
        for trial in self.progress:
            reached = [rung for rung in trial.scores if trial.scores[rung] > rungs.FAILED]
            total += self.ladder.budgets[max(reached)] if reached else 0
        return total
