"""Show progress as a live bar on a terminal, or as plain lines in a log."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.progress import Progress

_PLAIN_INTERVAL = 10.0  # s, time between lines if the output is not a terminal


class Bar:
    """Progress bar on a terminal; elsewhere one line about every ten seconds.

    Args:
        total: number of steps until the bar is full.
        title: text in front of the bar.
        now: text that describes the first step.
    """

    def __init__(self, total: int, title: str = " ", now: str = "") -> None:
        from rich.console import Console

        from auvbench.runs.progress import bars, in_notebook

        live = sys.stderr.isatty() and not in_notebook()
        self._bars = bars(Console(stderr=True, highlight=False), title) if live else None
        self._last = time.monotonic()
        if self._bars is not None:
            self._task = self._bars.add_task("", total=total, now=now)

    def __enter__(self) -> Self:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def move(self, done: int, now: str, line: str = "") -> None:
        """Show the number of finished steps and the text `now` for the present step; without a bar, print `line` every ten seconds."""
        if self._bars is not None:
            self._bars.update(self._task, completed=done, now=now)
        elif line and time.monotonic() - self._last >= _PLAIN_INTERVAL:
            self._last = time.monotonic()
            print(line, file=sys.stderr, flush=True)

    def watch(self, at: Progress) -> None:
        """Show a training's remaining time, success over the last 100 episodes, pace and return."""
        self.move(at.steps, str(at), f"{at.steps:,} of {at.total_steps:,} steps, {at}")

    def note(self, text: str, *, error: bool = True) -> None:
        """Print a line above the bar. Without a bar, print an error to stderr, and any other line to stdout."""
        if self._bars is None:
            print(text, file=sys.stderr if error else sys.stdout, flush=True)
        else:
            self._bars.console.print(text, markup=False, soft_wrap=True, style="red" if error else None)


class RunBar(Bar):
    """Progress bar that counts runs.

    Args:
        total: number of runs.
        title: text in front of the bar.
        parts: number of parts in each run, for example episodes.
    """

    def __init__(self, total: int, title: str, parts: int = 1) -> None:
        super().__init__(total * parts, title)
        self._parts = parts
        self._runs = self._done = 0  # number of finished runs, and of finished parts of the active run

    def line(self, text: str | None, *, error: bool = False) -> None:
        """Count one finished run; print `text` unless it is None."""
        if text is not None:
            self.note(text, error=error)
        self._runs, self._done = self._runs + 1, 0
        self.move(self._runs * self._parts, "")

    def doing(self, run: RunDirectory, what: str, parts: int) -> None:
        """Count `parts` more finished parts of the active run, and show the run."""
        self._done = min(self._done + parts, self._parts)
        now = f"{run.id}: {what}"
        line = f"{now}, {self._done:,} of {self._parts:,} episodes"
        self.move(self._runs * self._parts + self._done, now, line)
