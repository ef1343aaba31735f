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
    from auvbench.runs.directory import RunDirectory
    from auvbench.runs.progress import Progress, Watch

_PLAIN_INTERVAL = 10.0  # s between lines where the output is no terminal
SHORTEST_BAR = 8  # characters; a shorter one says nothing
LONGEST_BAR = 40


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
    from rich.live import Live
    from rich.text import Text

    console = Console(stderr=True)
    begun = time.monotonic()
    now: list[Progress] = []

    def draw() -> Text:
        elapsed = time.monotonic() - begun
        if not now:
            return Text(f"compiling, first episodes, {duration(elapsed)}", no_wrap=True)
        return Text(bar_line(now[0], elapsed, console.width), no_wrap=True)

    # Drawn by itself twice a second: it shows that time passes where training reports nothing for a while.
    with Live(console=console, get_renderable=draw, refresh_per_second=2):
        yield lambda progress: now.__setitem__(slice(None), [progress])


def bar_line(progress: Progress, elapsed: float, width: int) -> str:
    """A bar and figures on one line; where that is too long, what matters least is left out.

    Steps, success and remaining time are shown at any width.
    """
    rate = telling(progress.success_rate, progress.episodes)
    left = (
        max(progress.total_steps - progress.steps, 0) / progress.steps_per_s
        if progress.steps_per_s > 0
        else None
    )
    parts = {
        "steps": f"{progress.steps:,} of {progress.total_steps:,} steps",
        "pace": f"{progress.steps_per_s:,.0f} steps/s" if progress.steps_per_s > 0 else "",
        "left": "" if left is None else f"{duration(left)} left",
        "success": "" if rate is None else f"success {100 * rate:.0f} %",
        "return": "" if progress.mean_return is None else f"return {progress.mean_return:,.0f}",
        "elapsed": duration(elapsed),
    }
    for dropped in ("", "elapsed", "return", "pace"):
        parts.pop(dropped, None)
        text = ", ".join(part for part in parts.values() if part)
        if len(text) + SHORTEST_BAR + 1 <= width:
            break
    size = min(LONGEST_BAR, width - len(text) - 2)
    if size < SHORTEST_BAR:
        return text
    done = min(1.0, progress.steps / progress.total_steps) if progress.total_steps > 0 else 0.0
    return f"{'━' * round(size * done)}{'╌' * (size - round(size * done))} {text}"


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
    if (rate := telling(progress.success_rate, progress.episodes)) is not None:
        parts.append(f"success {100 * rate:.0f} %")
    if progress.mean_return is not None:
        parts.append(f"return {progress.mean_return:,.0f}")
    return ", ".join(parts)


class Teller:
    """Lines above a bar that counts them."""

    def __init__(
        self, print_line: Callable[[str | None, bool, bool], None], advance: Callable[[str, int], None]
    ) -> None:
        self._print = print_line
        self._advance = advance

    def line(self, text: str | None, *, error: bool = False) -> None:
        """One finished thing; None: it needs no line."""
        self._print(text, error, True)
        self._advance("", 0)

    def note(self, text: str) -> None:
        """Something that is no finished thing."""
        self._print(text, True, False)

    def doing(self, run: RunDirectory, what: str, parts: int) -> None:
        """What is under way, and how many of its parts have just been finished."""
        self._advance(f"{run.id}: {what}", parts)


@contextmanager
def counting_bar(total: int, title: str, parts: int = 1) -> Iterator[Teller]:
    """Counts finished runs on a terminal, of a single one its parts; plain lines elsewhere.

    Args:
        total: runs.
        title: what is done with them.
        parts: of each run: the bar moves by these, where they are reported.
    """
    single = total == 1 and parts > 1
    if not sys.stderr.isatty() or not (single or total > 1):
        yield _plain_teller(parts if single else 0)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar
    from rich.table import Column

    console = Console(stderr=True, highlight=False)
    with Bar(
        TextColumn(title, markup=False),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        # A run's id is no markup; and it is what gives way on a narrow terminal.
        TextColumn(
            "{task.fields[now]}",
            markup=False,
            table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
        ),
        console=console,
        expand=True,
    ) as bar:
        task = bar.add_task("", total=parts if single else total, now="")
        finished = [0, 0]  # runs, and parts of the one under way

        def place() -> float:
            return finished[1] if single else finished[0] + min(finished[1] / parts, 1.0)

        def printed(text: str | None, error: bool, counts: bool) -> None:
            if text is not None:
                console.print(text, markup=False, soft_wrap=True, style="red" if error else None)
            if counts:
                finished[:] = finished[0] + 1, parts if single else 0
                bar.update(task, completed=place())

        def advance(now: str, ended: int) -> None:
            finished[1] += ended
            bar.update(task, now=now, completed=place())

        yield Teller(printed, advance)


def _plain_teller(parts: int) -> Teller:
    """Lines alone; of a long single run, every now and then how many of its parts are finished."""
    begun = last = time.monotonic()
    finished = 0

    def advance(now: str, ended: int) -> None:
        nonlocal last, finished
        finished += ended
        if not (parts and ended) or finished >= parts or time.monotonic() - last < _PLAIN_INTERVAL:
            return
        last = time.monotonic()
        left = (last - begun) / finished * (parts - finished)
        line = f"{now}, {finished:,} of {parts:,} episodes, {duration(left)} left"
        print(line, file=sys.stderr, flush=True)

    def plain(text: str | None, error: bool, _counts: bool) -> None:
        if text is not None:
            print(text, file=sys.stderr if error else sys.stdout, flush=True)

    return Teller(plain, advance)


@contextmanager
def work_bar(title: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """Counts parts of one piece of work on a terminal, and is silent elsewhere: it takes seconds."""
    if not sys.stderr.isatty():
        yield lambda done, of: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    with Bar(
        TextColumn(title, markup=False),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)
