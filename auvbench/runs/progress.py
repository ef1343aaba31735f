"""How a run tells others how far it is: `progress.json`, at most once a second, and a callback."""

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
    """Appends rows; full precision; complete rows only.

    Args:
        columns: of the records.
        path: of the CSV file; begun anew with its header unless `keep` says how many bytes of it stay.
        keep: length in bytes to which an existing file is cut (exact resume).
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
        """Rows of the episodes that ended at environment step `step` of the run."""
        self._write([(step, *(record[name] for name in self._columns)) for record in records])

    def _write(self, rows: Sequence[Sequence[object]]) -> None:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        self._file.write(text.getvalue().encode())

    def flush(self) -> None:
        """Hands all rows to the system."""
        self._file.flush()

    def abandon(self) -> None:
        """Closes without writing what is still held back."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._file.fileno())
        os.close(nowhere)

    def close(self) -> None:
        self._file.close()


WINDOW = 100
"""Episodes over which success rate and return are averaged."""

TELLING = 30
"""Episodes without which a success rate is not shown: one of three says nothing."""


def telling(rate: float | None, episodes: int) -> float | None:
    """A success rate that is worth showing, else None."""
    return rate if episodes >= TELLING else None


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a run is."""

    steps: Count
    total_steps: Count
    steps_per_s: float
    episodes: Count
    success_rate: Share | None
    """share of the last WINDOW training episodes; None before the first ended"""
    mean_return: float | None
    time: float
    """Unix time of this report"""

    @property
    def remaining(self) -> float | None:
        """Return the seconds to go at the present rate; None before there is one."""
        left = max(0, self.total_steps - self.steps)
        return left / self.steps_per_s if self.steps_per_s > 0 else None

    def __str__(self) -> str:
        """Return the figures in one line, the most important first."""
        left = self.remaining
        parts = ["estimating the time to go" if left is None else f"{duration(left)} left"]
        if (rate := telling(self.success_rate, self.episodes)) is not None:
            parts.append(f"success {100 * rate:.0f} %")
        if self.steps_per_s > 0:
            parts.append(f"{self.steps_per_s:,.0f} steps/s")
        if self.mean_return is not None:
            parts.append(f"return {self.mean_return:,.0f}")
        return ", ".join(parts)


def read(run: Path) -> Progress | None:
    """Return the last progress that a run wrote; None where it cannot be read."""
    try:
        return typed_json.read(run / "progress.json", Progress)
    except (OSError, ValueError):
        return None


def duration(seconds: float) -> str:
    """Return a time in its two largest units.

    >>> duration(59.4), duration(130), duration(11400), duration(200000)
    ('59 s', '2 min 10 s', '3 h 10 min', '2 d 7 h')
    """
    whole = max(0, round(seconds))
    for unit, size, below, part in (("d", 86400, "h", 3600), ("h", 3600, "min", 60), ("min", 60, "s", 1)):
        if whole >= size:
            rest = whole % size // part
            return f"{whole // size} {unit}" + (f" {rest} {below}" if rest else "")
    return f"{whole} s"


def to_go(seconds: float) -> str:
    """Return `3 h 10 min to go, until 17:05`, with the day where it is not today."""
    now = datetime.now().astimezone()
    end = now + timedelta(seconds=seconds)
    return (
        f"{duration(seconds)} to go, until {end:{'%H:%M' if end.date() == now.date() else '%a %d %b %H:%M'}}"
    )


def bars(console: Console, title: str = "", **options: Any) -> Bars:
    """Return rich's bars with what each does now in the field `now`.

    Args:
        console: where they are shown.
        title: in front of each.
        options: of `rich.progress.Progress`.
    """
    from rich import progress
    from rich.table import Column

    # A run's id is no markup, and the text gives way on a narrow terminal.
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
    """Counts steps and episodes and reports them at most once a second. Never changes a run's result.

    Args:
        path: of `progress.json`.
        total_steps: the budget.
        watch: called with each report.
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
        """What a resumed run needs to report the same numbers."""
        return {
            "episodes": np.asarray(self.episodes),
            "outcomes": np.asarray(self._outcomes, dtype=np.bool_),
            "returns": np.asarray(self._returns, dtype=np.float64),
        }

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.episodes = int(state["episodes"])
        self._outcomes = deque((bool(one) for one in state["outcomes"]), maxlen=WINDOW)
        self._returns = deque((float(one) for one in state["returns"]), maxlen=WINDOW)

    def step(self, steps: int, *, force: bool = False) -> None:
        """Reports if a second has passed since the last report."""
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
        # Not flushed to disk: a lost report costs nothing, a synchronous write every second would.
        staged = self._path.with_name(f".{self._path.name}")
        staged.write_text(json.dumps(asdict(progress)), encoding="utf-8")
        staged.replace(self._path)
        if self._watch is not None:
            self._watch(progress)
