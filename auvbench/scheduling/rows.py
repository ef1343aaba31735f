"""Rows of a sweep and the time that remains, by the rates that runs have shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from auvbench.config.agents import learns
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import estimate
from auvbench.scheduling.base import Job, Phase

WAITING = "waiting"


@dataclass(slots=True)
class Row:
    """One run of a sweep."""

    run: RunDirectory
    kind: str
    """the algorithm"""
    total_steps: int
    """0 for an agent that does not learn"""
    steps: int
    """before this sweep"""
    warm_up: int = 0
    """steps before the rate counts: an off-policy learner is faster until it updates"""
    state: str = WAITING
    job: Job | None = None
    message: str = ""
    progress: Progress | None = None

    @classmethod
    def of(cls, run: RunDirectory) -> Row:
        manifest = run.manifest()
        algo = _algorithm(run)
        trains = algo is None or learns(algo)
        return cls(
            run,
            manifest["algo"],
            manifest["total_steps"] if trains else 0,
            manifest["steps"],
            _warm_up(algo),
        )

    @property
    def name(self) -> str:
        return self.run.path.name

    @property
    def to_go(self) -> int:
        """Steps."""
        done = self.progress.steps if self.progress is not None else self.steps
        return max(0, self.total_steps - done)

    @property
    def pace(self) -> float | None:
        """Measured steps per second; None before the first useful measurement."""
        at = self.progress
        if at is None or at.steps_per_s <= 0 or at.steps < self.warm_up:
            return None
        return at.steps_per_s


def _warm_up(algo: Mapping[str, Any] | None) -> int:
    early = (algo or {}).get("learning_starts", 0)
    return 3 * early if isinstance(early, int) else 0


def _algorithm(run: RunDirectory) -> Mapping[str, Any] | None:
    """Return the `algo` configuration; None if unreadable, because the worker reports that error."""
    try:
        algo = run.config()["algo"]
    except (RunError, KeyError, TypeError):
        return None
    return algo if isinstance(algo, Mapping) and isinstance(algo.get("agent"), str) else None


def seconds_left(rows: Sequence[Row]) -> list[float | None]:
    """Return the seconds to go of each row, by its own rate or the mean of its algorithm's; None without a rate."""
    rates: dict[str, list[float]] = {}
    for row in rows:
        if row.pace is not None:
            rates.setdefault(row.kind, []).append(row.pace)
    found: list[float | None] = []
    for row in rows:
        per_s = row.pace or (fmean(rates[row.kind]) if row.kind in rates else None)
        found.append(0.0 if row.to_go == 0 else None if per_s is None else row.to_go / per_s)
    return found


def remaining(rows: Sequence[Row], slots: int | None) -> float | None:
    """Return the seconds until all rows are done; None while an algorithm has no measured rate."""
    live = [row.state in (WAITING, Phase.QUEUED, Phase.RUNNING) for row in rows]
    running: list[float] = []
    waiting: list[float] = []
    for row, alive, seconds in zip(rows, live, seconds_left(rows), strict=True):
        if not alive:
            continue
        if seconds is None:
            return None
        (running if row.state == Phase.RUNNING else waiting).append(seconds)
    return estimate.makespan(running, waiting, slots)
