"""Show a sweep: live bars on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.progress import TaskID
from rich.text import Text

from auvbench.config.algorithms import learns
from auvbench.errors import RunError
from auvbench.runs import progress
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling.loop import Job, Outcome, Phase

WAITING = "waiting"
READ_EVERY = 1.0  # s between two reads of the runs' progress files
LONGEST = 32  # largest number of characters of a run's id next to its bar
LINES_EVERY = 60.0  # s between two plain lines about a run


@dataclass(slots=True)
class Row:
    """One run of a sweep."""

    run: RunDirectory
    total_steps: int
    """budget in steps; 0 for an agent that does not learn"""
    done: int
    """finished steps"""
    state: str = WAITING
    job: Job | None = None
    progress: Progress | None = None
    bar: TaskID | None = None

    @classmethod
    def of(cls, run: RunDirectory) -> Row:
        """Return the row of a waiting run."""
        manifest = run.manifest()
        return cls(run, manifest["total_steps"] if _learns(run) else 0, manifest["steps"])

    def read(self) -> None:
        """Read the last progress that the run wrote."""
        if (at := progress.read(self.run.path)) is not None:
            self.progress, self.done = at, at.steps


def _learns(run: RunDirectory) -> bool:
    try:
        algo = run.config()["algo"]
    except (RunError, KeyError, TypeError):
        return True  # the worker reports the error
    return not isinstance(algo, Mapping) or learns(algo, unknown=True)


class View:
    """Display of a sweep's runs.

    Args:
        console: console of the display.
        runs: runs that are known from the start.
    """

    def __init__(self, console: Console, runs: Sequence[RunDirectory] = ()) -> None:
        self.console = console
        self.rows: dict[Path, Row] = {run.path: Row.of(run) for run in runs}
        self.bars = progress.bars(console, auto_refresh=False)
        self.live: Live | None = None
        self._begun, self._before = time.monotonic(), sum(row.done for row in self.rows.values())
        self._next_read = 0.0
        self._next_lines = time.monotonic() + LINES_EVERY

    def begin(self) -> None:
        if self.console.is_terminal and not progress.in_notebook():
            self.live = Live(
                console=self.console, get_renderable=self.shown, refresh_per_second=2, transient=True
            )
            self.live.start()

    def end(self) -> None:
        if self.live is not None:
            self.live.stop()

    def shown(self) -> Group:
        """Return the summary and the bars below it; lines that do not fit are cut off at the bottom."""
        return Group(*self.summary(), self.bars)

    def say(self, text: str) -> None:
        """Print a line; live bars stay below the line."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def event(self, text: str) -> None:
        """Print a line with the time of day, unless live bars already show the event."""
        if self.live is None:
            self.say(f"{datetime.now().astimezone():%H:%M:%S} {text}")

    def started(self, run: RunDirectory, job: Job) -> None:
        row = self.rows.setdefault(run.path, Row.of(run))
        row.state, row.job = Phase.QUEUED, job
        if row.bar is None:
            total = row.total_steps or None
            # The beginning of an id describes the run, and the hash at its end identifies it.
            name = run.id if len(run.id) <= LONGEST else f"{run.id[: LONGEST - 10]}…{run.id[-9:]}"
            row.bar = self.bars.add_task(name, total=total, completed=row.done, now=row.state)
        if job.mark:  # a cluster's job may run longer than this process, so the user needs the job's name
            self.event(f"{run.id}: {Phase.QUEUED} as {job}")

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        row = self.rows[run.path]
        if row.state != phase:  # the job has its identity now, e.g. a process id
            self.event(f"{run.id}: {phase} as {row.job}")
        row.state = phase

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        row = self.rows[run.path]
        row.state = outcome
        row.read()
        if row.bar is not None:
            self.bars.remove_task(row.bar)
            row.bar = None
        text = f"{run.id}: {outcome}{f' ({message})' if message else ''}"
        if outcome in (Outcome.FAILED, Outcome.HELD) and self.live is not None:
            self.say(text)
        elif outcome is not Outcome.NOT_STARTED:
            self.event(text)

    def refresh(self) -> None:
        """Show the progress of active runs about once a second in the bars; without live bars, print it once a minute."""
        if (now := time.monotonic()) < self._next_read:
            return
        self._next_read = now + READ_EVERY
        running = [row for row in self.rows.values() if row.state == Phase.RUNNING]
        for row in running:
            row.read()
            if row.bar is not None:
                self.bars.update(row.bar, completed=row.done, now=str(row.progress or row.state))
        if now < self._next_lines:
            return
        self._next_lines = now + LINES_EVERY
        for row in running:
            if row.progress is not None:
                self.event(f"{row.run.id}: {row.done:,} of {row.total_steps:,} steps, {row.progress}")
        self.event(self.counts())

    def remaining(self) -> float | None:
        """Return the estimated seconds until the sweep ends, from its pace so far; None before the first steps."""
        rows = [row for row in self.rows.values() if row.state in (WAITING, Phase.QUEUED, Phase.RUNNING)]
        remaining_steps = sum(max(0, row.total_steps - row.done) for row in rows)
        done = sum(row.done for row in self.rows.values()) - self._before
        if remaining_steps == 0 or done <= 0:
            return None if remaining_steps else 0.0
        return (time.monotonic() - self._begun) * remaining_steps / done

    def counts(self) -> str:
        """Return `12 of 45 complete, 2 failed, 2 running · 3 h 10 min to go, until 17:05`."""
        count = Counter(str(row.state) for row in self.rows.values())
        parts = [f"{count.pop(Outcome.COMPLETE, 0)} of {len(self.rows)} complete"]
        parts += [f"{number} {state}" for state, number in sorted(count.items())]
        seconds = self.remaining()
        if seconds == 0:
            return ", ".join(parts)
        return f"{', '.join(parts)} · {'estimating the time to go' if seconds is None else progress.to_go(seconds)}"

    def summary(self) -> list[Text]:
        """Return the lines above the bars."""
        return [Text(self.counts(), "bold")]
