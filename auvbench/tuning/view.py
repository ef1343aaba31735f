"""What is seen of a study while it goes on: how many trials, the best so far with its interval, the time left."""

from __future__ import annotations

import time

from rich.console import Console, Group
from rich.text import Text

from auvbench.analysis import rounding
from auvbench.analysis.measures import Measure
from auvbench.runs.directory import RunDirectory
from auvbench.scheduling import live_table
from auvbench.scheduling.base import Job
from auvbench.scheduling.estimate import clock_after, duration
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.rows import Row
from auvbench.scheduling.views import InPlace, Watch
from auvbench.statistics.estimate import Estimate
from auvbench.tuning.scores import Objective, Score
from auvbench.tuning.search import Search, Step


class Lines(Watch):
    """A line per result; the base of the live view.

    Args:
        search: whose trials are shown.
        objective: what they are worth.
        console: where it is shown.
    """

    def __init__(self, search: Search, objective: Objective, console: Console) -> None:
        super().__init__(console)
        self.search, self.objective = search, objective
        self.begun = self.last = time.monotonic()
        self.steps_before = search.steps_done()
        self.results = 0
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

    def told(self, step: Step, score: Score) -> None:
        self.results, self.last = self.results + 1, time.monotonic()
        budget = self.search.ladder.budgets[step.rung]
        at = f" at {budget:,} steps" if len(self.search.ladder.budgets) > 1 else ""
        self.event(f"trial {step.trial}{at}: {worth(score, self.objective)} · {self.counts()}")

    def failed(self, step: Step, why: str) -> None:
        self.event(f"trial {step.trial} failed: {why}")

    def confirming(self, best: int, count: int) -> None:
        self.fresh = count
        self.event(
            f"search done: trial {best} is best; it and the untuned settings are trained with fresh seeds "
            f"({count} runs)"
        )

    def counts(self) -> str:
        """`12 of 50 trials begun: 2 done, 1 running, 9 pruned · 3 min 10 s to go`."""
        counts = self.search.counts()
        begun = len(self.search.progress)
        text = f"{begun} of {max(begun, self.search.trials)} trials begun: {counts['done']} done, {counts['running']} running, "
        text += f"{counts['pruned']} waiting or pruned"
        text += f", {counts['failed']} failed" if counts["failed"] else ""
        left = self.seconds_left()
        return text if left is None else f"{text} · about {duration(left)} to go, until {clock_after(left)}"

    def seconds_left(self) -> float | None:
        """Of the search, by the steps and the time until the last result; None before the first."""
        if not self.results or self.fresh:
            return None
        here = self.search.steps_done() - self.steps_before
        left = self.search.steps_expected() - self.search.steps_done()
        if here <= 0 or left <= 0:  # more were promoted than expected: nobody knows
            return None
        expected = (self.last - self.begun) * left / here
        return max(0.0, expected - (time.monotonic() - self.last))

    def best(self) -> str:
        """The best trial so far with its interval; '' before there is one."""
        number = self.search.best
        if number is None:
            return ""
        trial = self.search.progress[number]
        rung = max(trial.scores)
        result = self.search.journal.results[number][rung]
        score = Score(**{**result, "runs": tuple(result["runs"])})
        budget = self.search.ladder.budgets[rung]
        at = f" at {budget:,} steps" if len(self.search.ladder.budgets) > 1 else ""
        return f"best so far: trial {number}{at}, {worth(score, self.objective)} on validation scenarios"


class Table(InPlace, Lines):
    """What runs, the counts, the best."""

    def told(self, step: Step, score: Score) -> None:
        self.results, self.last = self.results + 1, time.monotonic()

    def table(self) -> Group:
        rows = list(self.rows.values())
        room = max(3, self.console.height - 6)
        left = {row.name: _left(row) for row in rows}
        lines = live_table.lines(rows[:room], left, self.console.width)
        more = [Text(f"and {len(rows) - room} more", "dim")] if len(rows) > room else []
        last = f"with fresh seeds: {len(rows)} of {self.fresh} to go" if self.fresh else self.counts()
        return Group(*lines, *more, Text(self.best(), "green"), Text(last, "bold"))


def view(search: Search, objective: Objective, console: Console) -> Lines:
    """The view that suits where the output goes."""
    return (Table if console.is_terminal else Lines)(search, objective, console)


def worth(score: Score, objective: Objective) -> str:
    """`success_rate 98.0 % [93.0, 99.4], par1_steps 312`."""
    return (
        f"{amount(Estimate(score.objective, score.low, score.high), objective.measure)}, "
        f"{objective.then.name} {plain(score.then, objective.then)}"
    )


def amount(of: Estimate, measure: Measure) -> str:
    """A measure with its interval, in the unit of the tables."""
    value, low, high = rounding.rounded(of, 100.0 if measure.rate else 1.0)
    unit = " %" if measure.rate else ""
    return f"{measure.name} {value}{unit}" + (f" [{low}, {high}]" if low else "")


def plain(value: float, measure: Measure) -> str:
    """A value without its interval."""
    return f"{100 * value:.1f} %" if measure.rate else f"{value:.4g}"


def _left(row: Row) -> float | None:
    return None if row.pace is None else row.to_go / row.pace
