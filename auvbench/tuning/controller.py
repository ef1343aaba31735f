"""Control a study: schedule the runs of its trials on a launcher until nothing is left to do."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from optuna.trial import TrialState
from rich.console import Console
from rich.text import Text

from auvbench.analysis.formatting import amount, counted, name
from auvbench.config import schema
from auvbench.errors import TrainingError
from auvbench.runs import lock, status
from auvbench.runs.directory import RunDirectory, freeze
from auvbench.runs.progress import to_go
from auvbench.scheduling.loop import Backend, Loop, Outcome, Result
from auvbench.scheduling.views import View
from auvbench.tuning import runs
from auvbench.tuning.folder import StudyFolder
from auvbench.tuning.search import ERROR, Objective, Score, Search, Step


class StudyView(View):
    """Display of a study: active runs, counts of trials and the best trial."""

    def __init__(self, search: Search, objective: Objective, console: Console) -> None:
        super().__init__(console)
        self.search, self.objective = search, objective
        self.begun = time.monotonic()
        self.finished_before = self._finished()
        self.fresh = 0

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        if run.path in self.rows:
            super().ended(run, outcome, message)
            del self.rows[run.path]

    def reported(self, step: Step, score: Score) -> None:
        self.event(
            f"trial {step.trial}{self._at(step.rung)}: {worth(score, self.objective)} · {self.counts()}"
        )

    def confirming(self, best: int, count: int) -> None:
        self.fresh = count
        self.say(
            f"search done: trial {best} is best; {count} runs with fresh seeds compare it with the untuned settings"
        )

    def _at(self, rung: int) -> str:
        budgets = self.search.plan.budgets
        return f" at {budgets[rung]:,} steps" if len(budgets) > 1 else ""

    def _finished(self) -> int:
        return sum(trial.state.is_finished() for trial in self.search.trials)

    def counts(self) -> str:
        """Return a text such as `12 of 50 trials begun: 2 done, 1 running, 9 pruned · 3 min to go, until 17:05`."""
        trials = self.search.trials
        failed = sum(ERROR in trial.user_attrs for trial in trials)
        done, running, pruned = (
            sum(trial.state is state for trial in trials)
            for state in (TrialState.COMPLETE, TrialState.RUNNING, TrialState.PRUNED)
        )
        text = f"{len(trials)} of {counted(max(len(trials), self.search.limit), 'trial')} begun: "
        text += f"{done} done, {running} running, {pruned - failed} pruned"
        text += f", {failed} failed" if failed else ""
        finished, remaining = self._finished() - self.finished_before, self.search.limit - self._finished()
        if finished < 1 or remaining < 1 or self.fresh:
            return text
        return f"{text} · {to_go((time.monotonic() - self.begun) * remaining / finished)}"

    def best(self) -> str:
        """Return the best trial so far with its interval; '' before the first result."""
        best = self.search.best
        if best is None:
            return ""
        shown = self.search.results(best)
        at = self._at(len(shown) - 1)
        return f"best so far: trial {best.number}{at}, {worth(shown[-1], self.objective)} on validation scenarios"

    def summary(self) -> list[Text]:
        last = f"with fresh seeds: {len(self.rows)} of {self.fresh} to go" if self.fresh else self.counts()
        return [Text(self.best(), "green"), Text(last, "bold")]


def worth(score: Score, objective: Objective) -> str:
    """Return a text such as `success rate: 98.0 % [93.0, 99.4], PAR-1 steps 312`."""
    first, then = objective.measure, objective.then
    shown = f"{name(first)}: {amount(score.estimate, first)}"
    if then == first:
        return shown
    value = f"{100 * score.then:.1f} %" if then.rate else f"{score.then:.4g}"
    return f"{shown}, {name(then)} {value}"


AT_ONCE = 8
"""Number of simultaneous runs on a backend without its own limit, such as a cluster with a queue"""
HELD_FOR = 60.0
"""Time in s to wait for a run that is still locked, for example by a worker of an earlier, killed controller"""
TRIES = 3
"""Largest number of times that a run is started if its worker dies"""


@dataclass(slots=True)
class TrialRuns:
    """Runs of one trial. `done` is called when all runs are complete, `failed` when one run has failed."""

    unfinished: set[Path]
    """incomplete runs"""
    done: Callable[[], None]
    failed: Callable[[str], None]


class Controller(Loop):
    """Scheduling loop that gets its runs from a search. The backend's workers must call `runs.TARGET`."""

    view: StudyView

    def __init__(self, study: StudyFolder, search: Search, backend: Backend, view: StudyView) -> None:
        super().__init__([], backend, view)
        self.study, self.search = study, search
        self.plan = search.plan
        self.jobs: list[TrialRuns] = []
        self.locked: dict[Path, float] = {}  # monotonic time in s at which each run was found locked
        self.started: dict[Path, int] = {}
        self.stopped = ""
        self.confirmed = False

    def goes_on(self) -> bool:
        """Start runs up to the backend's limit; return whether anything is left to do."""
        self._recheck_locked()
        room = self.backend.limit or AT_ONCE
        while not self.signals and not self.stopped:
            if len(self.active) + len(self.waiting) + len(self.locked) >= room or not self._begin():
                break
        return super().goes_on() or bool(self.locked)

    def _begin(self) -> bool:
        """Begin the next step of the search or, after the search, the runs with fresh seeds; return whether anything was begun."""
        step = self.search.next()
        if step is not None:
            self._begin_step(step)
            return True
        if self.search.running or self.confirmed:
            return False
        self.confirmed = True
        return self._begin_confirmation()

    def _begin_step(self, step: Step) -> None:
        prepared = runs.prepare(
            self.plan, self.study, self.search.algo(self.search.trials[step.trial]), step.rung
        )

        def done() -> None:
            self._test(prepared, self.plan.protocol)
            score = self.view.objective.of(prepared, self.plan.protocol.name)
            self.search.report(step, score)
            self.view.reported(step, score)

        def failed(why: str) -> None:
            self.search.fail(step, why)
            self.view.say(f"trial {step.trial} failed: {why}")

        self._enter(prepared, done, failed)

    def _begin_confirmation(self) -> bool:
        """Begin the trainings of the best and the untuned settings with fresh seeds. Return False without a best trial or fresh seeds."""
        best = self.search.best
        if best is None or not self.plan.tune.fresh_seeds:
            return False
        algos = (self.search.algo(best), self.plan.base["algo"])
        configs = [config for algo in algos for config in runs.fresh(self.plan, self.study, algo)]
        frozen = [freeze(config, self.plan.command) for config in configs]
        self.view.confirming(best.number, len(frozen))
        self._enter(
            frozen,
            lambda: self._test(frozen, self.plan.fresh_protocol),
            lambda why: self.view.say(f"with fresh seeds: {why}"),
        )
        return True

    def _test(self, directories: list[RunDirectory], protocol: schema.Protocol) -> None:
        for run in directories:
            runs.test(run, protocol)

    def _enter(
        self, directories: list[RunDirectory], done: Callable[[], None], failed: Callable[[str], None]
    ) -> None:
        # Start no run twice: two trials with equal settings share their runs, and a run may continue after its trial failed.
        claimed = {path for job in self.jobs for path in job.unfinished} | self.locked.keys()
        claimed |= {run.path for run in (*self.waiting, *self.active.values())}
        fresh = {run.path: run for run in directories if run.path not in claimed}
        self.jobs.append(TrialRuns({run.path for run in directories}, done, failed))
        for run in fresh.values():
            if status.finished(run) and lock.living_holder(run.path) is None:
                self._arrived(run.path)
            else:
                self.waiting.append(run)

    def _arrived(self, path: Path) -> None:
        for job in [job for job in self.jobs if path in job.unfinished]:
            job.unfinished.discard(path)
            if not job.unfinished:
                self.jobs.remove(job)
                job.done()

    def _settle(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        # If a complete run is locked, the lock's holder is testing it.
        is_locked = outcome is Outcome.HELD or lock.living_holder(run.path) is not None
        if is_locked and outcome in (Outcome.HELD, Outcome.COMPLETE) and not self.signals:
            self.locked[run.path] = time.monotonic()
            return
        super()._settle(run, outcome, message)
        if outcome is Outcome.COMPLETE:
            self._arrived(run.path)
        elif outcome is Outcome.FAILED and not self.signals:
            self._failed(run, message)
        elif not self.signals:
            self._stop(f"{run.path}: {outcome}{f' ({message})' if message else ''}")

    def _failed(self, run: RunDirectory, message: str) -> None:
        """Fail the trial if its settings caused the error; restart a run whose worker died; stop the study for any other error."""
        error = run.manifest()["error"] or {}
        self.started[run.path] = self.started.get(run.path, 0) + 1
        if _is_divergence(str(error.get("type")), str(error.get("message"))):
            for job in [job for job in self.jobs if run.path in job.unfinished]:
                self.jobs.remove(job)
                job.failed(f"{run.id}: {message}")
        elif error.get("type") == "WorkerDied" and self.started[run.path] < TRIES:
            self.view.say(f"{run.id}: {message}; it is resumed")
            self.waiting.append(run)
        else:
            self._stop(f"{run.path}: {message}")

    def _stop(self, why: str) -> None:
        """Stop the study: start no more runs, but let active runs continue to their end."""
        if not self.stopped:
            self.stopped = why
            self.view.say(f"stopped: {why}")
        self.waiting.clear()
        self.locked.clear()

    def _recheck_locked(self) -> None:
        if self.signals:
            self.locked.clear()
        for path, since in list(self.locked.items()):
            holder = lock.living_holder(path)
            if holder is None:
                del self.locked[path]
                self.waiting.append(RunDirectory(path))
            elif time.monotonic() - since > HELD_FOR:
                self._stop(f"{path} is locked by {holder}")

    def carry_out(self) -> Result:
        """Run the study until it is complete or a signal arrives, and return its result.

        Raises:
            TrainingError: a run failed for a reason other than its settings, ended without a result, or stayed locked longer than
                `HELD_FOR`.
        """
        result = self.drive()
        if self.stopped:
            raise TrainingError(f"{self.stopped}; run the same command to continue")
        return result


def _is_divergence(kind: str, message: str) -> bool:
    """Return whether an error is due to a training's settings: a number became infinite or NaN."""
    words = ("not finite", "became", " is nan", " is inf", " is -inf")
    return kind in ("TrainingError", "ActionError") and any(word in message for word in words)
