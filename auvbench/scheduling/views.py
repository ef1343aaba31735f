"""What is seen of a sweep: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress, telling
from auvbench.scheduling import estimate
from auvbench.scheduling.base import Job, Phase
from auvbench.scheduling.estimate import clock_after, duration
from auvbench.scheduling.loop import Outcome
from auvbench.scheduling.rows import WAITING, Row, remaining, seconds_left

BAR = 20  # characters, the most of a bar
SHORTEST_BAR = 8
SHORTEST_NAME = 22  # characters of a run's id that is cut in the middle

STYLES = {
    "running": "cyan",
    "queued": "yellow",
    Outcome.COMPLETE: "green",
    Outcome.FAILED: "red",
    Outcome.INTERRUPTED: "yellow",
    Outcome.HELD: "magenta",
    Outcome.NOT_STARTED: "dim",
}

HEADINGS = ("run", "state", "progress", "steps", "steps/s", "success", "to go")
GAP = 2  # characters between columns


def lines(rows: Sequence[Row], left: Mapping[str, float | None], width: int) -> list[Text]:
    """The rows as lines of at most `width` characters: steps, success and time are whole, what else there is fits.

    Args:
        rows: in their order.
        left: seconds to go by the run's name.
        width: of the terminal.
    """
    cells = [_cells(row, left[row.name]) for row in rows]
    sizes = {
        name: max(len(name), *(len(line[name]) for line in cells)) if cells else len(name)
        for name in HEADINGS
    }
    sizes["run"] = max([len(row.name) for row in rows], default=3)
    shown = [name for name in HEADINGS if name not in ("progress", "steps/s")]
    room = width - sum(sizes[name] + GAP for name in shown) + GAP
    for name, least in (("steps/s", sizes["steps/s"]), ("progress", SHORTEST_BAR)):
        if room >= least + GAP or sizes["run"] + room - least - GAP >= SHORTEST_NAME:
            shown.append(name)
            sizes[name] = min(max(least, room - GAP), BAR) if name == "progress" else least
            room -= sizes[name] + GAP
    if room < 0:
        sizes["run"] = max(SHORTEST_NAME, sizes["run"] + room)
    shown.sort(key=HEADINGS.index)
    result = [Text(_joined({name: name for name in HEADINGS}, shown, sizes), "bold")]
    for row, line in zip(rows, cells, strict=True):
        name = row.name
        if len(name) > sizes["run"]:  # the beginning says what it is, the hash at its end which
            name = f"{name[: sizes['run'] - 10]}…{name[-9:]}"
        bar = _bar(row, sizes["progress"]) if row.progress is not None else ""
        text = Text(_joined({**line, "run": name, "progress": bar}, shown, sizes))
        start = sizes["run"] + GAP
        text.stylize(STYLES.get(row.state, "dim"), start, start + len(line["state"]))
        result.append(text)
    return result


def _joined(cells: Mapping[str, str], shown: Sequence[str], sizes: Mapping[str, int]) -> str:
    left = ("run", "state", "progress")
    words = [
        cells[name].ljust(sizes[name]) if name in left else cells[name].rjust(sizes[name]) for name in shown
    ]
    return (" " * GAP).join(words).rstrip()


def _bar(row: Row, size: int) -> str:
    full = 0 if row.progress is None else round(size * estimate.fraction(row.progress))
    return "━" * full + "╌" * (size - full)


def _cells(row: Row, left: float | None) -> dict[str, str]:
    at = row.progress
    steps = row.steps if at is None else at.steps
    rate = None if at is None else telling(at.success_rate, at.episodes)
    return {
        "run": "",
        "state": str(row.state),
        "progress": "",
        "steps": f"{steps:,}" if steps or at is not None else "",
        "steps/s": f"{at.steps_per_s:,.0f}" if at is not None and at.steps_per_s else "",
        "success": "" if rate is None else f"{rate:.0%}",
        "to go": duration(left) if left and row.state == Phase.RUNNING else "",
    }


READ_EVERY = 1.0  # s between two looks at the runs' progress files
LINES_EVERY = 60.0  # s between two plain lines about a run


class Watch:
    """Keeps the rows of runs up to date; the base of every view of a loop.

    Args:
        console: where it is shown.
        runs: those that are known from the start.
    """

    def __init__(self, console: Console, runs: Sequence[RunDirectory] = ()) -> None:
        self.console = console
        self.rows: dict[Path, Row] = {}
        for run in runs:
            self.add(run)
        self._next_read = 0.0

    def add(self, run: RunDirectory) -> None:
        self.rows[run.path] = Row.of(run)

    def begin(self) -> None:
        pass

    def end(self) -> None:
        pass

    def say(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def event(self, text: str) -> None:
        """A line with the time of day."""
        self.say(f"{datetime.now().astimezone():%H:%M:%S} {text}")

    def started(self, run: RunDirectory, job: Job) -> None:
        row = self.rows[run.path]
        row.state, row.job = Phase.QUEUED, job

    def marked(self, run: RunDirectory, job: Job) -> None:
        """Say what a cluster knows the run as from now on, also after this process."""
        if job.mark:
            self.event(f"{run.path.name}: {Phase.QUEUED} as {job}")

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        self.rows[run.path].state = phase

    def read(self) -> bool:
        """Reads the progress of what runs, about once a second; whether it did."""
        if time.monotonic() < self._next_read:
            return False
        self._next_read = time.monotonic() + READ_EVERY
        for row in self.rows.values():
            if row.state == Phase.RUNNING:
                row.progress = estimate.read(row.run.path) or row.progress
        return True

    def refresh(self) -> None:
        self.read()


class InPlace(Watch):
    """A view that is drawn anew in place."""

    def begin(self) -> None:
        self.live = Live(
            console=self.console, get_renderable=self.table, refresh_per_second=2, transient=True
        )
        self.live.start()

    def end(self) -> None:
        self.live.stop()

    def table(self) -> Group:
        raise NotImplementedError


class SweepView(Watch):
    """What is known of a sweep, all of whose runs are known from the start; the base of both its views."""

    def __init__(self, runs: Sequence[RunDirectory], slots: int | None, console: Console) -> None:
        super().__init__(console, runs)
        self.slots = slots

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        row = self.rows[run.path]
        row.state, row.message = outcome, message
        row.progress = estimate.read(run.path) or row.progress

    def remaining(self) -> float | None:
        """Return the seconds until the sweep's end; None while unknown."""
        return remaining(list(self.rows.values()), self.slots)

    def counts(self) -> str:
        """Return `12 of 45 complete, 2 failed, 2 running · 3 h 10 min to go, until 17:05`."""
        count: dict[str, int] = {}
        for row in self.rows.values():
            count[row.state] = count.get(row.state, 0) + 1
        parts = [f"{count.pop(str(Outcome.COMPLETE), 0)} of {len(self.rows)} complete"]
        parts += [f"{number} {state}" for state, number in sorted(count.items()) if state != "waiting"]
        left = self.remaining()
        if left is None:
            parts[-1] += " · estimating the time to go"
        elif left > 0:
            parts[-1] += f" · {duration(left)} to go, until {clock_after(left)}"
        return ", ".join(parts)


class PlainView(SweepView):
    """A line per event, and from time to time one per running run."""

    def __init__(self, runs: Sequence[RunDirectory], slots: int | None, console: Console) -> None:
        super().__init__(runs, slots, console)
        self._next_lines = time.monotonic() + LINES_EVERY
        self._announced = False

    def started(self, run: RunDirectory, job: Job) -> None:
        super().started(run, job)
        self.marked(run, job)

    def polled(self, run: RunDirectory, phase: Phase) -> None:
        row = self.rows[run.path]
        if row.state != phase:  # the job knows by now who it is, a process id for example
            self.event(f"{run.path.name}: {phase} as {row.job}")
        super().polled(run, phase)

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        super().ended(run, outcome, message)
        if outcome is not Outcome.NOT_STARTED:
            self.event(f"{run.path.name}: {outcome}{f' ({message})' if message else ''}")

    def refresh(self) -> None:
        if not self.read():
            return
        if not self._announced and self.remaining():
            self._announced = True
            self.event(self.counts())
        if time.monotonic() < self._next_lines:
            return
        self._next_lines = time.monotonic() + LINES_EVERY
        for row in self.rows.values():
            if row.state == Phase.RUNNING and row.progress is not None:
                self.event(f"{row.name}: {sentence(row.progress)}")
        self.event(self.counts())


class TableView(InPlace, SweepView):
    """A table of the runs."""

    def ended(self, run: RunDirectory, outcome: Outcome, message: str) -> None:
        super().ended(run, outcome, message)
        if outcome in (Outcome.FAILED, Outcome.HELD):
            self.say(f"{run.path.name}: {outcome} ({message})")

    def table(self) -> Group:
        """Running runs first, then the queued and as many of the ended as fit; those that wait are one line."""
        order = {str(Phase.RUNNING): 0, str(Phase.QUEUED): 1}
        every = list(self.rows.values())
        left = dict(zip([row.name for row in every], seconds_left(every), strict=True))
        rows = sorted((row for row in every if row.state != WAITING), key=lambda row: order.get(row.state, 2))
        room = max(3, self.console.height - 6)
        more = [Text(f"and {len(rows) - room} more", "dim")] if len(rows) > room else []
        waiting = [row.kind for row in every if row.state == WAITING]
        if waiting:
            kinds = ", ".join(f"{number} {kind}" for kind, number in Counter(waiting).items())
            more.append(Text(_fit(f"{len(waiting)} waiting: {kinds}", self.console.width), "dim"))
        shown = lines(rows[:room], left, self.console.width)
        return Group(*shown, *more, Text(self.counts(), "bold"))


def view(runs: Sequence[RunDirectory], slots: int | None, console: Console) -> SweepView:
    """The view that suits where the output goes."""
    return (TableView if console.is_terminal else PlainView)(runs, slots, console)


def sentence(at: Progress) -> str:
    """`34 %, 10123 steps/s, success 83 %, 2 min 10 s to go`."""
    parts = [f"{estimate.fraction(at):.0%}"]
    if at.steps_per_s:
        parts.append(f"{at.steps_per_s:.0f} steps/s")
    if (rate := telling(at.success_rate, at.episodes)) is not None:
        parts.append(f"success {rate:.0%}")
    left = estimate.remaining(at)
    if left is not None:
        parts.append(f"{duration(left)} to go")
    return ", ".join(parts)


def _fit(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 1]}…"
