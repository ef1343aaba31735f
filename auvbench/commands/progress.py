"""Live bars for a terminal, plain lines for a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from auvbench.runs.progress import telling
from auvbench.scheduling.estimate import duration

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.progress import Progress, Watch

_PLAIN_INTERVAL = 10.0  # s between lines if the output is no terminal


def _bar(title: str, *, transient: bool = False) -> Bar:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.table import Column

    return Progress(
        TextColumn(title, markup=False),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        # A run's id is no markup, and the text gives way on a narrow terminal.
        TextColumn(
            "{task.fields[now]}",
            markup=False,
            table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
        ),
        console=Console(stderr=True, highlight=False),
        expand=True,
        transient=transient,
        refresh_per_second=2,
    )


@contextmanager
def training_bar(total_steps: int, *, shown: bool = True) -> Iterator[Watch | None]:
    """Show a run's remaining time, success over the last 100 episodes, pace and return."""
    if not shown:
        yield None
    elif not sys.stderr.isatty():
        yield _plain_lines()
    else:
        with _bar("") as bar:
            task = bar.add_task("", total=total_steps, now="compiling, first episodes")
            yield lambda progress: bar.update(task, completed=progress.steps, now=figures(progress))


def figures(progress: Progress) -> str:
    """Return the figures of a training in one line, the most important first."""
    parts = ["estimating the time to go"]
    if progress.steps_per_s > 0:
        left = max(progress.total_steps - progress.steps, 0) / progress.steps_per_s
        parts = [f"{duration(left)} left"]
    if (rate := telling(progress.success_rate, progress.episodes)) is not None:
        parts.append(f"success {100 * rate:.0f} %")
    if progress.steps_per_s > 0:
        parts.append(f"{progress.steps_per_s:,.0f} steps/s")
    if progress.mean_return is not None:
        parts.append(f"return {progress.mean_return:,.0f}")
    return ", ".join(parts)


def _plain_lines() -> Callable[[Progress], None]:
    last = [time.monotonic()]

    def watch(progress: Progress) -> None:
        if time.monotonic() - last[0] >= _PLAIN_INTERVAL:
            last[0] = time.monotonic()
            steps = f"{progress.steps:,} of {progress.total_steps:,} steps"
            print(f"{steps}, {figures(progress)}", file=sys.stderr, flush=True)

    return watch


class Teller:
    """Print lines above a bar that counts them, or lines alone.

    Args:
        total: runs.
        parts: of each run.
        bar: moves by the parts of a single run, else by runs; None without a terminal.
    """

    def __init__(self, total: int, parts: int, bar: Bar | None = None) -> None:
        self._parts, self._bar = parts, bar
        self._single = total == 1 and parts > 1
        self._runs = self._done = 0  # finished runs, and finished parts of the present run
        self._last = time.monotonic()
        self._first: tuple[float, int] | None = None  # time and parts of the first report
        if bar is not None:
            self._task = bar.add_task("", total=parts if self._single else total, now="")

    def line(self, text: str | None, *, error: bool = False) -> None:
        """Count one finished run, with a line or without one."""
        if text is not None:
            self.note(text, error=error)
        self._runs, self._done = self._runs + 1, self._parts if self._single else 0
        self._move()

    def note(self, text: str, *, error: bool = True) -> None:
        """Print a line that counts for no run."""
        if self._bar is None:
            print(text, file=sys.stderr if error else sys.stdout, flush=True)
        else:
            self._bar.console.print(text, markup=False, soft_wrap=True, style="red" if error else None)

    def doing(self, run: RunDirectory, what: str, parts: int) -> None:
        """Show the present run, of which `parts` more are finished."""
        self._done += parts
        self._move(f"{run.id}: {what}")

    def _move(self, now: str = "") -> None:
        if self._bar is not None:
            place = self._done if self._single else self._runs + min(self._done / self._parts, 1.0)
            self._bar.update(self._task, completed=place, now=now)
        elif self._single and 0 < self._done < self._parts:
            present = time.monotonic()
            self._first = self._first or (present, self._done)
            if present - self._last >= _PLAIN_INTERVAL:
                self._last = present
                line = f"{now}, {self._done:,} of {self._parts:,} episodes, {self._left(present)}"
                print(line, file=sys.stderr, flush=True)

    def _left(self, present: float) -> str:
        """Return the time to go by the rate since the first report: before it, code is compiled."""
        begun, done = self._first or (present, self._done)
        if self._done == done:
            return "estimating the time to go"
        return f"{duration((present - begun) / (self._done - done) * (self._parts - self._done))} left"


@contextmanager
def counting_bar(total: int, title: str, parts: int = 1) -> Iterator[Teller]:
    """Count finished runs on a terminal, of a single one its parts; print plain lines elsewhere.

    Args:
        total: runs.
        title: of the bar.
        parts: of each run.
    """
    if sys.stderr.isatty() and (total > 1 or parts > 1):
        with _bar(title) as bar:
            yield Teller(total, parts, bar)
    else:
        yield Teller(total, parts)


@contextmanager
def work_bar(title: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Count parts of one piece of work on a terminal; print nothing elsewhere, because it takes seconds."""
    if not sys.stderr.isatty():
        yield lambda done, of: None
        return
    with _bar(title, transient=True) as bar:
        task = bar.add_task("", total=None, now=unit)
        yield lambda done, of: bar.update(task, completed=done, total=of)
