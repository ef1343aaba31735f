"""Live bars for a terminal, plain lines for a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from auvbench.scheduling.estimate import duration

if TYPE_CHECKING:
    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.progress import Progress, Watch

_PLAIN_INTERVAL = 10.0  # s between lines where the output is no terminal


@contextmanager
def training_bar(total_steps: int, *, shown: bool = True) -> Iterator[Watch | None]:
    """Shows a run's steps/s, remaining time, success over the last 100 episodes and return."""
    if not shown:
        yield None
    elif sys.stderr.isatty():
        with _rich_bar(total_steps) as watch:
            yield watch
    else:
        yield _plain_lines()


@contextmanager
def _rich_bar(total_steps: int) -> Iterator[Watch]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    with Bar(
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TextColumn("{task.fields[line]}"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
    ) as bar:
        task = bar.add_task("", total=total_steps, line="compiling, first episodes")

        def watch(progress: Progress) -> None:
            bar.update(task, completed=min(progress.steps, total_steps), line=_line(progress))

        yield watch


def _plain_lines() -> Callable[[Progress], None]:
    last = [time.monotonic()]

    def watch(progress: Progress) -> None:
        if time.monotonic() - last[0] >= _PLAIN_INTERVAL:
            last[0] = time.monotonic()
            print(
                f"{progress.steps:,} of {progress.total_steps:,} steps, {_line(progress)}",
                file=sys.stderr,
                flush=True,
            )

    return watch


def _line(progress: Progress) -> str:
    parts = [f"{progress.steps_per_s:,.0f} steps/s"]
    if progress.steps_per_s > 0:
        left = max(progress.total_steps - progress.steps, 0) / progress.steps_per_s
        parts.append(f"{duration(left)} left")
    if progress.success_rate is not None:
        parts.append(f"success {100 * progress.success_rate:.0f} %")
    if progress.mean_return is not None:
        parts.append(f"return {progress.mean_return:,.0f}")
    return ", ".join(parts)


class Teller:
    """Lines above a bar that counts them."""

    def __init__(
        self, print_line: Callable[[str | None, bool, bool], None], advance: Callable[[str], None]
    ) -> None:
        self._print = print_line
        self._advance = advance

    def line(self, text: str | None, *, error: bool = False) -> None:
        """One finished thing; None: it needs no line."""
        self._print(text, error, True)
        self._advance("")

    def note(self, text: str) -> None:
        """Something that is no finished thing."""
        self._print(text, True, False)

    def doing(self, run: RunDirectory, what: str) -> None:
        """What is under way."""
        self._advance(f"{run.id}: {what}")


@contextmanager
def counting_bar(total: int, title: str) -> Iterator[Teller]:
    """Counts finished runs on a terminal; plain lines elsewhere."""
    if not sys.stderr.isatty() or total < 2:

        def plain(text: str | None, error: bool, _counts: bool) -> None:
            if text is not None:
                print(text, file=sys.stderr if error else sys.stdout, flush=True)

        yield Teller(plain, lambda _: None)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True, highlight=False)
    with Bar(
        TextColumn(title, markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[now]}", markup=False),  # a run's id is no markup
        console=console,
    ) as bar:
        task = bar.add_task("", total=total, now="")

        def printed(text: str | None, error: bool, counts: bool) -> None:
            if text is not None:
                console.print(text, markup=False, soft_wrap=True, style="red" if error else None)
            if counts:
                bar.advance(task)

        yield Teller(printed, lambda now: bar.update(task, now=now))
