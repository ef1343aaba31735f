"""Has a study's runs carried out by a launcher, as many at once as it takes, until nothing is left to do."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from auvbench.errors import RunError, TrainingError
from auvbench.runs import lock, status
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling.base import Backend
from auvbench.scheduling.loop import Loop, Outcome, Result, View
from auvbench.tuning import folder, runs, scores
from auvbench.tuning.folder import Plan, StudyFolder
from auvbench.tuning.search import Search, Step
from auvbench.tuning.trial import test

AT_ONCE = 8
"""Runs at once on a cluster that has a queue of its own, where launcher.workers does not say"""
HELD_FOR = 60.0
"""s that a run may be held by a worker of an earlier controller, before the study stops"""
LOOK = 1.0
"""s between two looks at such a run"""
TRIES = 3
"""how often a run is started whose worker died"""


@dataclass(slots=True)
class Job:
    """Runs that belong together, and what happens when all of them are there."""

    runs: list[RunDirectory]
    done: Callable[[], None]
    failed: Callable[[str], None]
    step: Step | None = None
    left: set[Path] = field(default_factory=set)


class Controller(Loop):
    """A scheduling loop whose runs are decided while it goes on.

    Args:
        plan: of the study.
        study: its folder, held by this process.
        search: decides.
        objective: what a trial is worth.
        backend: carries runs out; its target is `trial.TARGET`.
        view: shows it.
    """

    def __init__(
        self,
        plan: Plan,
        study: StudyFolder,
        search: Search,
        objective: scores.Objective,
        backend: Backend,
        view: StudyView,
    ) -> None:
        super().__init__([], backend, view)
        self.plan, self.study, self.search, self.objective = plan, study, search, objective
        self.shown = view
        self.jobs: list[Job] = []
        self.fresh: list[list[RunDirectory]] | None = None
        self.held: dict[Path, tuple[float, float]] = {}  # since when, and when to look again
        self.started: dict[Path, int] = {}
        self.stopped: str = ""
        self.over = False

    @property
    def at_once(self) -> int:
        return self.backend.limit or AT_ONCE

    def goes_on(self) -> bool:
        self._more()
        return super().goes_on() or bool(self.held)

    def _more(self) -> None:
        """Asks for work as long as there is room for it."""
        self._look_again()
        while not self.signals and not self.stopped:
            busy = len(self.active) + len(self.waiting) + len(self.held)
            if busy >= self.at_once:
                return
            job = self._next()
            if job is None:
                return
            self._enter(job)

    def _next(self) -> Job | None:
        step = self.search.next()
        if step is not None:
            return self._of_step(step)
        if self.search.under_way or self.over:
            return None
        self.search.journal.close()
        self.over = True
        return self._confirmation()

    def _of_step(self, step: Step) -> Job:
        trial = self.search.progress[step.trial]
        made = runs.prepare(
            self.plan,
            self.study,
            self.search.algo(step.trial),
            step.rung,
            trial.first,
            self.search.ladder.budgets,
        )
        return Job(made, lambda: self._score(step, made), lambda why: self._failed(step, why), step)

    def _score(self, step: Step, made: list[RunDirectory]) -> None:
        for run in made:
            test(run, self.plan.protocol)
        found = self.objective.of(made, self.plan.protocol.name)
        self.search.report(step.trial, found.plain())
        self.shown.told(step, found)

    def _failed(self, step: Step, why: str) -> None:
        self.search.fail(step.trial, why)
        self.shown.failed(step, why)

    def _confirmation(self) -> Job | None:
        """The best settings and the untuned ones, trained with seeds that the search has not seen."""
        best = self.search.best
        if best is None or not self.plan.tune.fresh_seeds:
            return None
        groups = [
            runs.fresh(self.plan, self.study, algo)
            for algo in (self.search.algo(best), self.plan.base["algo"])
        ]
        self.fresh = groups
        every = list({run.path: run for group in groups for run in group}.values())
        self.shown.confirming(best, len(every))

        def done() -> None:
            for run in every:
                test(run, folder.fresh_protocol(self.plan))

        return Job(every, done, lambda why: self.shown.say(f"with fresh seeds: {why}"))

    def _enter(self, job: Job) -> None:
        job.left = {run.path for run in job.runs}
        self.jobs.append(job)
        # What another trial of the same settings brings, or what goes on although its trial has failed.
        claimed = {path for other in self.jobs if other is not job for path in other.left}
        claimed |= {run.path for run in (*self.waiting, *self.active.values())}
        for run in job.runs:
            if status.finished(run) and lock.living_holder(run.path) is None:
                self._arrived(run.path)
            elif run.path not in claimed:
                self.shown.add(run)
                self.waiting.append(run)

    def _arrived(self, path: Path) -> None:
        for job in list(self.jobs):
            if path in job.left:
                job.left.discard(path)
                if not job.left:
                    self.jobs.remove(job)
                    job.done()

    def _settle(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        # Who holds a complete run is testing it.
        held = outcome is Outcome.HELD or (
            outcome is Outcome.COMPLETE and lock.living_holder(run.path) is not None
        )
        if held and not self.signals and self._may_wait(run):
            return
        super()._settle(run, outcome, message)
        self.held.pop(run.path, None)
        if outcome is Outcome.COMPLETE:
            self._arrived(run.path)
        elif outcome is Outcome.FAILED and not self.signals:
            self._broken(run, message)
        elif outcome is Outcome.HELD:
            self._stop(f"{run.path}: {message}")
        elif not self.signals:
            self._stop(f"{run.path}: {outcome}{f' ({message})' if message else ''}")

    def _broken(self, run: RunDirectory, message: str) -> None:
        """A training that its own settings ruin is a bad trial; what else goes wrong says nothing of the settings."""
        if diverged(run):
            for job in [job for job in self.jobs if run.path in job.left]:
                self.jobs.remove(job)
                job.failed(f"{run.id}: {message}")
            return
        self.started[run.path] = self.started.get(run.path, 1) + 1
        if worker_died(run) and self.started[run.path] <= TRIES:
            self.shown.say(f"{run.path.name}: {message}; it is resumed")
            self.waiting.append(run)
            return
        self._stop(f"{run.path}: {message}")

    def _stop(self, why: str) -> None:
        """Nothing more is begun; what runs ends."""
        if not self.stopped:
            self.stopped = why
            self.shown.say(f"stopped: {why}")
        self.waiting.clear()

    def _may_wait(self, run: RunDirectory) -> bool:
        """A worker of a controller that was killed may live for a moment more; its run is looked at again."""
        now = time.monotonic()
        since, _ = self.held.get(run.path, (now, now))
        if now - since > HELD_FOR:
            return False
        self.held[run.path] = (since, now + LOOK)
        return True

    def _look_again(self) -> None:
        now = time.monotonic()
        queued = {run.path for run in self.waiting} | {run.path for run in self.active.values()}
        for path, (_, next_look) in list(self.held.items()):
            if self.signals or self.stopped:
                self.held.pop(path)
            elif path not in queued and now >= next_look:
                self.waiting.append(RunDirectory(path))

    def carry_out(self) -> Result:
        """Until nothing is left to do, or somebody asks to leave.

        Raises:
            TrainingError: a run failed for a reason that is not its settings; the study goes on when typed again.
        """
        result = self.drive()
        if self.stopped:
            raise TrainingError(f"{self.stopped}; what was found is kept, and the same command goes on")
        return result


class StudyView(View, Protocol):
    """Shows how a study goes on."""

    def add(self, run: RunDirectory) -> None: ...
    def told(self, step: Step, score: scores.Score) -> None: ...
    def failed(self, step: Step, why: str) -> None: ...
    def confirming(self, best: int, count: int) -> None: ...


def diverged(run: RunDirectory) -> bool:
    """Whether a training failed through its own settings: a number became infinite or none."""
    error = _error(run)
    return error.get("type") in ("TrainingError", "ActionError") and any(
        words in str(error.get("message", ""))
        for words in ("not finite", "became", " is nan", " is inf", " is -inf")
    )


def worker_died(run: RunDirectory) -> bool:
    """Whether a run's process ended without saying why: killed, for lack of memory perhaps."""
    return _error(run).get("type") == "WorkerDied"


def _error(run: RunDirectory) -> dict[str, Any]:
    try:
        error = run.manifest().get("error")
    except RunError:
        return {}
    return error if isinstance(error, dict) else {}
