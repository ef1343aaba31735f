"""Report a run's progress at most once a second: write `progress.json` and call a function."""

from __future__ import annotations

import csv
import io
import json
import os
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvbench.record import Record
from auvbench.untrusted import typed_json
from auvbench.untrusted.typed_json import Count, Share

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bars


class EpisodeLog:
    """CSV file to which rows are appended with full precision; after `flush` it contains only complete rows.

    Args:
        columns: columns of the records.
        path: path of the CSV file; created with its header unless `keep` is given.
        keep: number of bytes to keep of an existing file (exact resume).
    """

    def __init__(self, columns: Sequence[str], path: Path, keep: int | None = None) -> None:
        self._columns = columns
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "ab" if keep is not None else "wb")  # noqa: SIM115
        if keep is None:
            self._write([("step", *columns)])
        else:
            self._file.truncate(keep)
            self._file.seek(0, os.SEEK_END)

    def append(self, step: int, records: Sequence[Record]) -> None:
        """Append rows for the episodes that ended at environment step `step` of the run."""
        self._write([(step, *(record[name] for name in self._columns)) for record in records])

    def _write(self, rows: Sequence[Sequence[object]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        self._file.write(text.getvalue().encode())

    def flush(self) -> None:
        """Write all buffered rows to the file."""
        self._file.flush()

    def abandon(self) -> None:
        """Close without writing the buffered rows."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._file.fileno())
        os.close(nowhere)

    def close(self) -> None:
        self._file.close()


WINDOW = 100
"""Number of most recent training episodes over which success rate and return are averaged."""

TELLING = 30
"""Smallest number of episodes for which a success rate is shown."""


def telling(rate: float | None, episodes: int) -> float | None:
    """Return the success rate if it comes from at least `TELLING` episodes, else None."""
    return rate if episodes >= TELLING else None


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a run."""

    steps: Count
    total_steps: Count
    steps_per_s: float
    episodes: Count
    success_rate: Share | None
    """success rate over the last WINDOW training episodes; None before the first episode has ended"""
    mean_return: float | None
    time: float
    """time of this report, Unix time"""

    @property
    def remaining(self) -> float | None:
        """Return the remaining seconds at the present rate; None while the rate is unknown."""
        steps = max(0, self.total_steps - self.steps)
        return steps / self.steps_per_s if self.steps_per_s > 0 else None

    def __str__(self) -> str:
        """Return the progress in one line, the most important number first."""
        seconds = self.remaining
        parts = ["estimating the time to go" if seconds is None else f"{duration(seconds)} left"]
        if (rate := telling(self.success_rate, self.episodes)) is not None:
            parts.append(f"success {100 * rate:.0f} %")
        if self.steps_per_s > 0:
            parts.append(f"{self.steps_per_s:,.0f} steps/s")
        if self.mean_return is not None:
            parts.append(f"return {self.mean_return:,.0f}")
        return ", ".join(parts)


def read(run: Path) -> Progress | None:
    """Return the last progress that a run wrote; None if it cannot be read."""
    try:
        return typed_json.read(run / "progress.json", Progress)
    except (OSError, ValueError):
        return None


def newest(progress: Progress | None, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the steps, episodes and success rate that a run recorded last, in its progress file or in its manifest.

    The manifest is written at the start and at the end. During a run, and after a kill, the progress file is newer.
    """
    names = ("steps", "episodes", "success_rate")
    if progress is not None and progress.steps >= manifest["steps"]:
        return {name: getattr(progress, name) for name in names}
    return {name: manifest[name] for name in names if name in manifest}


def duration(seconds: float) -> str:
    """Return a time in its two largest units.

    >>> duration(59.4), duration(130), duration(11400), duration(200000)
    ('59 s', '2 min 10 s', '3 h 10 min', '2 d 7 h')
    """
    whole = max(0, round(seconds))
    for unit, size, below, part in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= size:
            remainder = whole % size // part
            return f"{whole // size} {unit}" + (f" {remainder} {below}" if remainder else "")
    return f"{whole} s"


def to_go(seconds: float) -> str:
    """Return e.g. `3 h 10 min to go, until 17:05`; if the run does not end today, the text has the day before the time of day."""
    now = datetime.now().astimezone()
    end = now + timedelta(seconds=seconds)
    return (
        f"{duration(seconds)} to go, until {end:{'%H:%M' if end.date() == now.date() else '%a %d %b %H:%M'}}"
    )


def in_notebook() -> bool:
    """Return whether a notebook cell (`!auvbench ...`) started this process; a notebook cannot show live bars."""
    return "JPY_PARENT_PID" in os.environ


def bars(console: Console, title: str = "", **options: Any) -> Bars:
    """Return rich's progress bars; the field `now` of a bar is a text about the present step.

    Args:
        console: console that shows the bars.
        title: text in front of each bar.
        options: keyword arguments of `rich.progress.Progress`.
    """
    from rich import progress
    from rich.table import Column

    # No markup, since a run's id may contain brackets. On a narrow terminal, only this column is shortened.
    now = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    return progress.Progress(
        progress.TextColumn(title or "{task.description}", markup=False),
        progress.BarColumn(bar_width=20),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("{task.fields[now]}", markup=False, table_column=now),
        console=console,
        expand=True,
        refresh_per_second=2,
        **options,
    )


Watch = Callable[[Progress], None]


class Reporter:
    """Counter of steps and episodes, which reports the progress of a run at most once a second. It never changes a run's result.

    Args:
        path: path of `progress.json`.
        total_steps: training budget in environment steps.
        watch: function called with each report.
    """

    def __init__(self, path: Path, total_steps: int, watch: Watch | None = None) -> None:
        self._path = path
        self._total = total_steps
        self._watch = watch
        self._outcomes: deque[bool] = deque(maxlen=WINDOW)
        self._returns: deque[float] = deque(maxlen=WINDOW)
        self.episodes = 0
        self._started = self._reported = time.monotonic()
        self._first_step: int | None = None

    def episode(self, success: bool, total_return: float) -> None:
        self.episodes += 1
        self._outcomes.append(success)
        self._returns.append(total_return)

    @property
    def success_rate(self) -> float | None:
        return sum(self._outcomes) / len(self._outcomes) if self._outcomes else None

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return the number of episodes, and the last outcomes and returns, so that a resumed run reports the same numbers."""
        return {
            "episodes": np.asarray(self.episodes),
            "outcomes": np.asarray(self._outcomes, dtype=np.bool_),
            "returns": np.asarray(self._returns, dtype=np.float64),
        }

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.episodes = int(state["episodes"])
        self._outcomes = deque((bool(value) for value in state["outcomes"]), maxlen=WINDOW)
        self._returns = deque((float(value) for value in state["returns"]), maxlen=WINDOW)

    def step(self, steps: int, *, force: bool = False) -> None:
        """Report the progress after `steps` environment steps if a second has passed since the last report, or with `force`."""
        moment = time.monotonic()
        if self._first_step is None:
            self._first_step, self._started = steps, moment
        if not force and moment - self._reported < 1.0:
            return
        self._reported = moment
        elapsed = moment - self._started
        progress = Progress(
            steps=steps,
            total_steps=self._total,
            steps_per_s=(steps - self._first_step) / elapsed if elapsed > 0.0 else 0.0,
            episodes=self.episodes,
            success_rate=self.success_rate,
            mean_return=sum(self._returns) / len(self._returns) if self._returns else None,
            time=time.time(),
        )
        # Not flushed to disk: a lost report does no harm, but a synchronous write every second would slow the run.
        staged = self._path.with_name(f".{self._path.name}")
        staged.write_text(json.dumps(asdict(progress)), encoding="utf-8")
        staged.replace(self._path)
        if self._watch is not None:
            self._watch(progress)
