"""What is seen of a sweep: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from auvbench.agents.base import learns
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import estimate, progress
from auvbench.scheduling.base import Job, Phase
from auvbench.scheduling.estimate import duration
from auvbench.scheduling.loop import Outcome, View

READ_EVERY = 1.0  # s between two looks at the runs' progress files
LINES_EVERY = 60.0  # s between two plain lines about a run
BAR = 20  # characters

STYLES = {
    "running": "cyan",
    "queued": "yellow",
    Outcome.COMPLETE: "green",
    Outcome.FAILED: "red",
    Outcome.INTERRUPTED: "yellow",
    Outcome.HELD: "magenta",
    Outcome.NOT_STARTED: "dim",
}


@dataclass(slots=True)
class Row:
    """What is known of one run."""

    run: RunDirectory
    kind: str  # the algorithm: runs of a kind are expected to go at the same pace
    total_steps: int
    steps: int  # before this sweep
    state: str = "waiting"
    job: Job | None = None
    message: str = ""
    progress: Progress | None = None

    @property
    def name(self) -> str:
        return self.run.path.name


class Watch:
    """Keeps the rows up to date; the base of both views."""

    def __init__(self, runs: Sequence[RunDirectory], slots: int | None, console: Console) -> None:
        self.console = console
        self.slots = slots
        self.rows: dict[Path, Row] = {}
        for run in runs:
            manifest = run.manifest()
            total = manifest["total_steps"] if _trains(run) else 0
            self.rows[run.path] = Row(run, manifest["algo"], total, manifest["steps"])
        self._next_read = 0.0

    def begin(self) -> None:
        pass

    def end(self) -> None:
        pass

    def say(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def started(self, run: RunDirectory, job: Job) -> None:
        row = self.rows[run.path]
        row.state, row.job = Phase.QUEUED, job

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        self.rows[run.path].state = phase

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        row = self.rows[run.path]
        row.state, row.message = outcome, message
        row.progress = progress.read(run.path) or row.progress

    def read(self) -> bool:
        """Reads the progress of what runs, about once a second; whether it did."""
        if time.monotonic() < self._next_read:
            return False
        self._next_read = time.monotonic() + READ_EVERY
        for row in self.rows.values():
            if row.state == Phase.RUNNING:
                row.progress = progress.read(row.run.path) or row.progress
        return True

    def remaining(self) -> float | None:
        """Seconds until the sweep's end; None while no run has shown its pace."""
        paces: dict[str, list[float]] = {}
        for row in self.rows.values():
            if row.progress is not None and row.progress.steps_per_s:
                paces.setdefault(row.kind, []).append(row.progress.steps_per_s)
        running: list[float] = []
        waiting: list[float] = []
        for row in self.rows.values():
            if row.state not in ("waiting", Phase.QUEUED, Phase.RUNNING):
                continue
            steps = row.progress.steps if row.progress is not None else row.steps
            own = row.progress.steps_per_s if row.progress is not None else None
            per_s = own or estimate.pace(row.kind, paces)
            if per_s is None:
                return None
            seconds = max(0, row.total_steps - steps) / per_s
            (running if row.state == Phase.RUNNING else waiting).append(seconds)
        return estimate.makespan(running, waiting, self.slots)

    def counts(self) -> str:
        """`12 of 45 complete, 2 failed, 2 running · 3 h 10 min to go, until 17:05`."""
        count: dict[str, int] = {}
        for row in self.rows.values():
            count[row.state] = count.get(row.state, 0) + 1
        parts = [f"{count.pop(str(Outcome.COMPLETE), 0)} of {len(self.rows)} complete"]
        parts += [f"{number} {state}" for state, number in sorted(count.items()) if state != "waiting"]
        left = self.remaining()
        if not left:  # unknown, or over
            return ", ".join(parts)
        until = datetime.now().astimezone() + timedelta(seconds=left)
        day = "" if until.date() == datetime.now().astimezone().date() else f"{until:%a} "
        return f"{', '.join(parts)} · {duration(left)} to go, until {day}{until:%H:%M}"


class PlainView(Watch):
    """A line per event, and from time to time one per running run."""

    def __init__(self, runs: Sequence[RunDirectory], slots: int | None, console: Console) -> None:
        super().__init__(runs, slots, console)
        self._next_lines = time.monotonic() + LINES_EVERY
        self._announced = False

    def started(self, run: RunDirectory, job: Job) -> None:
        super().started(run, job)
        if job.mark:  # a cluster knows it from now on, whatever becomes of this process
            self.say(f"{_clock()} {run.path.name}: {Phase.QUEUED} as {job}")

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        row = self.rows[run.path]
        if row.state != phase:  # the job knows by now who it is, a process id for example
            self.say(f"{_clock()} {run.path.name}: {phase} as {row.job}")
        super().polled(run, phase)

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        super().ended(run, outcome, message)
        if outcome is not Outcome.NOT_STARTED:
            self.say(f"{_clock()} {run.path.name}: {outcome}{f' ({message})' if message else ''}")

    def refresh(self) -> None:
        if not self.read():
            return
        if not self._announced and self.remaining() is not None:
            self._announced = True
            self.say(f"{_clock()} {self.counts()}")
        if time.monotonic() < self._next_lines:
            return
        self._next_lines = time.monotonic() + LINES_EVERY
        for row in self.rows.values():
            if row.state == Phase.RUNNING and row.progress is not None:
                self.say(f"{_clock()} {row.name}: {sentence(row.progress)}")
        self.say(f"{_clock()} {self.counts()}")


class TableView(Watch):
    """A table that is drawn anew in place."""

    def __init__(self, runs: Sequence[RunDirectory], slots: int | None, console: Console) -> None:
        super().__init__(runs, slots, console)
        self.live = Live(console=console, get_renderable=self.table, refresh_per_second=2, transient=True)

    def begin(self) -> None:
        self.live.start()

    def end(self) -> None:
        self.live.stop()

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        super().ended(run, outcome, message)
        if outcome in (Outcome.FAILED, Outcome.HELD):
            self.say(f"{run.path.name}: {outcome} ({message})")

    def refresh(self) -> None:
        self.read()

    def table(self) -> Group:
        """Running runs first, then the queued, then as many of the others as fit."""
        table = Table(box=None, pad_edge=False)
        table.add_column("run", no_wrap=True)
        table.add_column("state", no_wrap=True)
        table.add_column("progress", no_wrap=True)
        for heading in ("steps", "steps/s", "success", "to go"):
            table.add_column(heading, justify="right", no_wrap=True)
        order = {str(Phase.RUNNING): 0, str(Phase.QUEUED): 1, "waiting": 3}
        rows = sorted(self.rows.values(), key=lambda row: order.get(row.state, 2))
        room = max(3, self.console.height - 5)
        for row in rows[:room]:
            table.add_row(Text(row.name), Text(row.state, STYLES.get(row.state, "dim")), *_cells(row))
        more = [Text(f"and {len(rows) - room} more", "dim")] if len(rows) > room else []
        return Group(table, *more, Text(self.counts(), "bold"))


def view(runs: Sequence[RunDirectory], slots: int | None, console: Console) -> View:
    """The view that suits where the output goes."""
    return (TableView if console.is_terminal else PlainView)(runs, slots, console)


def _trains(run: RunDirectory) -> bool:
    """Whether the run's budget of steps is going to be used: PID and random have nothing to learn."""
    try:
        return learns(run.config()["algo"]["agent"])
    except (RunError, KeyError, TypeError):  # the worker will say what is wrong with it
        return True


def sentence(at: Progress) -> str:
    """`34 %, 10123 steps/s, success 83 %, 2 min 10 s to go`."""
    parts = [f"{progress.fraction(at):.0%}"]
    if at.steps_per_s:
        parts.append(f"{at.steps_per_s:.0f} steps/s")
    if at.success_rate is not None:
        parts.append(f"success {at.success_rate:.0%}")
    left = progress.remaining(at)
    if left is not None:
        parts.append(f"{duration(left)} to go")
    return ", ".join(parts)


def _cells(row: Row) -> tuple[str, str, str, str, str]:
    at = row.progress
    if at is None:
        return ("", f"{row.steps:,}" if row.steps else "", "", "", "")
    left = progress.remaining(at)
    full = round(BAR * progress.fraction(at))
    return (
        "━" * full + "╌" * (BAR - full),
        f"{at.steps:,}",
        f"{at.steps_per_s:,.0f}" if at.steps_per_s else "",
        f"{at.success_rate:.0%}" if at.success_rate is not None else "",
        duration(left) if left is not None and row.state == Phase.RUNNING else "",
    )


def _clock() -> str:
    return f"{datetime.now().astimezone():%H:%M:%S}"
