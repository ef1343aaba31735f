"""The progress of a study: trials, the best so far with its interval, and the time left."""

from __future__ import annotations

import time

from optuna.trial import TrialState
from rich.console import Console, Group
from rich.text import Text

from auvbench.analysis.formatting import name, named
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling import live_table
from auvbench.scheduling.base import Job
from auvbench.scheduling.estimate import clock_after, duration
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.views import InPlace, Watch
from auvbench.tuning.scores import Objective, Score
from auvbench.tuning.search import ERROR, Search, Step


class Lines(Watch):
    """A line per result; the base of the live view."""

    def __init__(self, search: Search, objective: Objective, console: Console) -> None:
        super().__init__(console)
        self.search, self.objective = search, objective
        self.begun = time.monotonic()
        self.finished_before = self._finished()
        self.fresh = 0

    def started(self, run: RunDirectory, job: Job) -> None:
        if run.path not in self.rows:
            self.add(run)
        super().started(run, job)
        self.marked(run, job)

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        self.rows.pop(run.path, None)
        if outcome in (Outcome.FAILED, Outcome.HELD):
            self.event(f"{run.path.name}: {outcome} ({message})")

    def reported(self, step: Step, score: Score) -> None:
        self.event(
            f"trial {step.trial}{self._at(step.rung)}: {worth(score, self.objective)} · {self.counts()}"
        )

    def confirming(self, best: int, count: int) -> None:
        self.fresh = count
        self.event(
            f"search done: trial {best} is best; {count} runs with fresh seeds compare it with the untuned settings"
        )

    def _at(self, rung: int) -> str:
        budgets = self.search.plan.budgets
        return f" at {budgets[rung]:,} steps" if len(budgets) > 1 else ""

    def _finished(self) -> int:
        return sum(trial.state.is_finished() for trial in self.search.trials)

    def counts(self) -> str:
        """Return `12 of 50 trials begun: 2 done, 1 running, 9 pruned · about 3 min to go, until 17:05`."""
        trials = self.search.trials
        failed = sum(ERROR in trial.user_attrs for trial in trials)
        done, running, pruned = (
            sum(trial.state is state for trial in trials)
            for state in (TrialState.COMPLETE, TrialState.RUNNING, TrialState.PRUNED)
        )
        text = f"{len(trials)} of {max(len(trials), self.search.limit)} trials begun: "
        text += f"{done} done, {running} running, {pruned - failed} pruned"
        text += f", {failed} failed" if failed else ""
        here, left = self._finished() - self.finished_before, self.search.limit - self._finished()
        if here < 1 or left < 1 or self.fresh:
            return text
        seconds = (time.monotonic() - self.begun) * left / here
        return f"{text} · about {duration(seconds)} to go, until {clock_after(seconds)}"

    def best(self) -> str:
        """Return the best trial so far with its interval; '' before the first result."""
        best = self.search.best
        if best is None:
            return ""
        shown = self.search.results(best)
        at = self._at(len(shown) - 1)
        return f"best so far: trial {best.number}{at}, {worth(shown[-1], self.objective)} on validation scenarios"


class Table(InPlace, Lines):
    """The runs, the counts and the best trial, drawn in place."""

    def reported(self, step: Step, score: Score) -> None:
        pass

    def table(self) -> Group:
        rows = list(self.rows.values())
        room = max(3, self.console.height - 6)
        left = {row.name: None if row.pace is None else row.to_go / row.pace for row in rows}
        lines = live_table.lines(rows[:room], left, self.console.width)
        more = [Text(f"and {len(rows) - room} more", "dim")] if len(rows) > room else []
        last = f"with fresh seeds: {len(rows)} of {self.fresh} to go" if self.fresh else self.counts()
        return Group(*lines, *more, Text(self.best(), "green"), Text(last, "bold"))


def view(search: Search, objective: Objective, console: Console) -> Lines:
    """Return a live view for a terminal, and lines for any other output."""
    return (Table if console.is_terminal else Lines)(search, objective, console)


def worth(score: Score, objective: Objective) -> str:
    """Return `success rate 98.0 % [93.0, 99.4], PAR-1 steps 312`."""
    first, then = objective.measure, objective.then
    value = f"{100 * score.then:.1f} %" if then.rate else f"{score.then:.4g}"
    return f"{named(score.estimate, first)}, {name(then)} {value}"
