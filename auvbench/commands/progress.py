"""Live bars for a terminal, plain lines for a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.progress import Progress, Watch

_PLAIN_INTERVAL = 10.0  # s between lines if the output is no terminal


def _bar(title: str) -> Bars:
    from rich.console import Console

    from auvbench.runs.progress import bars

    return bars(Console(stderr=True, highlight=False), title)


class _Interval:
    """Says about every ten seconds that a line is due."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def is_over(self) -> bool:
        now = time.monotonic()
        if now - self._last < _PLAIN_INTERVAL:
            return False
        self._last = now
        return True


@contextmanager
def training_bar(total_steps: int, *, shown: bool = True) -> Iterator[Watch | None]:
    """Show a run's remaining time, success over the last 100 episodes, pace and return."""
    if not shown:
        yield None
    elif sys.stderr.isatty():
        with _bar(" ") as bar:
            task = bar.add_task("", total=total_steps, now="compiling, first episodes")
            yield lambda progress: bar.update(task, completed=progress.steps, now=str(progress))
    else:
        due = _Interval()

        def watch(at: Progress) -> None:
            if due.is_over():
                print(f"{at.steps:,} of {at.total_steps:,} steps, {at}", file=sys.stderr, flush=True)

        yield watch


class Teller:
    """Print lines above a bar that counts runs, or lines alone.

    Args:
        parts: of each run.
        bar: None without a terminal.
        total: runs.
    """

    def __init__(self, parts: int, bar: Bars | None, total: int) -> None:
        self._parts, self._bar = parts, bar
        self._runs = self._done = 0  # finished runs, and finished parts of the runs at work
        self._due = _Interval()
        if bar is not None:
            self._task = bar.add_task("", total=total * parts, now="")

    def line(self, text: str | None, *, error: bool = False) -> None:
        """Count one finished run, with a line or without one."""
        if text is not None:
            self.note(text, error=error)
        self._runs, self._done = self._runs + 1, 0
        self._move("")

    def note(self, text: str, *, error: bool = True) -> None:
        """Print a line that counts for no run."""
        if self._bar is None:
            print(text, file=sys.stderr if error else sys.stdout, flush=True)
        else:
            self._bar.console.print(text, markup=False, soft_wrap=True, style="red" if error else None)

    def doing(self, run: RunDirectory, what: str, parts: int) -> None:
        """Show the present run, of which `parts` more are finished."""
        self._done = min(self._done + parts, self._parts)
        if self._bar is None and self._due.is_over():
            print(
                f"{run.id}: {what}, {self._done:,} of {self._parts:,} episodes", file=sys.stderr, flush=True
            )
        self._move(f"{run.id}: {what}")

    def _move(self, now: str) -> None:
        if self._bar is not None:
            self._bar.update(self._task, completed=self._runs * self._parts + self._done, now=now)


@contextmanager
def counting_bar(total: int, title: str, parts: int = 1) -> Iterator[Teller]:
    """Count finished runs and their parts on a terminal; print plain lines elsewhere.

    Args:
        total: runs.
        title: of the bar.
        parts: of each run.
    """
    if sys.stderr.isatty():
        with _bar(title) as bar:
            yield Teller(parts, bar, total)
    else:
        yield Teller(parts, None, total)
