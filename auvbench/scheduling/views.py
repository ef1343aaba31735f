"""What is seen of a sweep: a live table on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from statistics import fmean

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from auvbench.config.agents import learns
from auvbench.errors import RunError
from auvbench.runs import progress
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress, telling
from auvbench.scheduling.loop import Job, Outcome, Phase

WAITING = "waiting"
STYLES: dict[str, str] = {
    Phase.RUNNING: "cyan",
    Phase.QUEUED: "yellow",
    Outcome.COMPLETE: "green",
    Outcome.FAILED: "red",
    Outcome.INTERRUPTED: "yellow",
    Outcome.HELD: "magenta",
}
READ_EVERY = 1.0  # s between two looks at the runs' progress files
LINES_EVERY = 60.0  # s between two plain lines about a run


@dataclass(slots=True)
class Row:
    """One run of a sweep."""

    run: RunDirectory
    algo: str
    total_steps: int
    """0 for an agent that does not learn"""
    steps: int
    """before this sweep"""
    state: str = WAITING
    job: Job | None = None
    progress: Progress | None = None

    @classmethod
    def of(cls, run: RunDirectory) -> Row:
        """Return the row of a run that waits."""
        manifest = run.manifest()
        return cls(run, manifest["algo"], manifest["total_steps"] if _learns(run) else 0, manifest["steps"])

    @property
    def done(self) -> int:
        """Return the steps that lie behind."""
        return self.steps if self.progress is None else self.progress.steps

    @property
    def rate(self) -> float | None:
        """Return the measured steps per second; None before there are any."""
        return self.progress.steps_per_s or None if self.progress is not None else None


def _learns(run: RunDirectory) -> bool:
    try:
        algo = run.config()["algo"]
    except (RunError, KeyError, TypeError):
        return True  # the worker reports the error
    return not isinstance(algo, Mapping) or learns(algo, unknown=True)


def seconds_left(rows: Sequence[Row]) -> list[float | None]:
    """Return the seconds to go of each row, by its own rate or the mean of its algorithm's; None without a rate."""
    rates: dict[str, list[float]] = {}
    for row in rows:
        if row.rate is not None:
            rates.setdefault(row.algo, []).append(row.rate)
    found: list[float | None] = []
    for row in rows:
        rate = row.rate or (fmean(rates[row.algo]) if row.algo in rates else None)
        left = max(0, row.total_steps - row.done)
        found.append(0.0 if left == 0 else None if rate is None else left / rate)
    return found


class View:
    """Shows the runs of a sweep.

    Args:
        console: where they are shown.
        runs: those that are known from the start.
        slots: most runs at once; None without a limit.
    """

    def __init__(self, console: Console, runs: Sequence[RunDirectory] = (), slots: int | None = None) -> None:
        self.console, self.slots = console, slots
        self.rows: dict[Path, Row] = {run.path: Row.of(run) for run in runs}
        self.live: Live | None = None
        if console.is_terminal:
            self.live = Live(console=console, get_renderable=self.table, refresh_per_second=2, transient=True)
        self._next_read = 0.0
        self._next_lines = time.monotonic() + LINES_EVERY

    def begin(self) -> None:
        if self.live is not None:
            self.live.start()

    def end(self) -> None:
        if self.live is not None:
            self.live.stop()

    def say(self, text: str) -> None:
        """Print a line, above the table if there is one."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def event(self, text: str) -> None:
        """Print a line with the time of day; on a terminal the table shows it."""
        if self.live is None:
            self.say(f"{datetime.now().astimezone():%H:%M:%S} {text}")

    def started(self, run: RunDirectory, job: Job) -> None:
        row = self.rows.setdefault(run.path, Row.of(run))
        row.state, row.job = Phase.QUEUED, job
        if job.mark:  # what a cluster knows the run as from now on, also after this process
            self.event(f"{run.id}: {Phase.QUEUED} as {job}")

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        row = self.rows[run.path]
        if row.state != phase:  # the job knows by now what it is, a process id for example
            self.event(f"{run.id}: {phase} as {row.job}")
        row.state = phase

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        row = self.rows[run.path]
        row.state, row.progress = outcome, progress.read(run.path) or row.progress
        text = f"{run.id}: {outcome}{f' ({message})' if message else ''}"
        if outcome in (Outcome.FAILED, Outcome.HELD) and self.live is not None:
            self.say(text)
        elif outcome is not Outcome.NOT_STARTED:
            self.event(text)

    def refresh(self) -> None:
        """Read the progress of what runs, about once a second, and print it once a minute without a table."""
        if (now := time.monotonic()) < self._next_read:
            return
        self._next_read = now + READ_EVERY
        running = [row for row in self.rows.values() if row.state == Phase.RUNNING]
        for row in running:
            row.progress = progress.read(row.run.path) or row.progress
        if now < self._next_lines:
            return
        self._next_lines = now + LINES_EVERY
        for row in running:
            if row.progress is not None:
                self.event(f"{row.run.id}: {row.done:,} of {row.total_steps:,} steps, {row.progress}")
        self.event(self.counts())

    def remaining(self) -> float | None:
        """Return the seconds until the sweep's end; None while an algorithm has no rate."""
        live = [row for row in self.rows.values() if row.state in (WAITING, Phase.QUEUED, Phase.RUNNING)]
        found = seconds_left(list(self.rows.values()))
        left = [s for row, s in zip(self.rows.values(), found, strict=True) if row in live]
        known = [seconds for seconds in left if seconds is not None]
        if len(known) < len(left):
            return None
        return max([sum(known) / (self.slots or len(known) or 1), *known], default=0.0)

    def counts(self) -> str:
        """Return `12 of 45 complete, 2 failed, 2 running · 3 h 10 min to go, until 17:05`."""
        count = Counter(str(row.state) for row in self.rows.values())
        parts = [f"{count.pop(Outcome.COMPLETE, 0)} of {len(self.rows)} complete"]
        parts += [f"{number} {state}" for state, number in sorted(count.items()) if state != WAITING]
        left = self.remaining()
        if left == 0:
            return ", ".join(parts)
        return f"{', '.join(parts)} · {'estimating the time to go' if left is None else progress.to_go(left)}"

    def table(self) -> Group:
        """Return running runs first, then the queued and as many of the ended as fit; those that wait are one line."""
        order: dict[str, int] = {Phase.RUNNING: 0, Phase.QUEUED: 1}
        every = list(zip(self.rows.values(), seconds_left(list(self.rows.values())), strict=True))
        shown = sorted(
            (one for one in every if one[0].state != WAITING), key=lambda one: order.get(one[0].state, 2)
        )
        room = max(3, self.console.height - 6)
        table = Table(box=None, pad_edge=False)
        table.add_column("run", overflow="fold")
        table.add_column("state")
        table.add_column("progress", min_width=8, max_width=20)
        for name in ("steps", "steps/s", "success", "to go"):
            table.add_column(name, justify="right", no_wrap=True)
        for row, left in shown[:room]:
            table.add_row(*_cells(row, left))
        more = [Text(f"and {len(shown) - room} more", "dim")] if len(shown) > room else []
        waiting = Counter(row.algo for row, _ in every if row.state == WAITING)
        if waiting:
            kinds = ", ".join(f"{number} {algo}" for algo, number in waiting.items())
            more.append(Text(f"{waiting.total()} waiting: {kinds}", "dim", no_wrap=True, overflow="ellipsis"))
        return Group(table, *more, *self.footer())

    def footer(self) -> list[Text]:
        """Return the lines below the table."""
        return [Text(self.counts(), "bold")]


def _cells(row: Row, left: float | None) -> tuple[Text | ProgressBar, ...]:
    at = row.progress
    rate = None if at is None else telling(at.success_rate, at.episodes)
    return (
        Text(row.run.id),
        Text(str(row.state), STYLES.get(row.state, "dim")),
        Text("") if at is None else ProgressBar(total=at.total_steps, completed=at.steps),
        Text(f"{row.done:,}" if row.done else ""),
        Text(f"{row.rate:,.0f}" if row.rate else ""),
        Text("" if rate is None else f"{rate:.0%}"),
        Text(progress.duration(left) if left and row.state == Phase.RUNNING else ""),
    )
