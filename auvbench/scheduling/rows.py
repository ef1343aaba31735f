"""What a sweep knows of each of its runs, and when all of them will be done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from auvbench.config.agents import learns
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory
from auvbench.runs.progress import Progress
from auvbench.scheduling import estimate, paces
from auvbench.scheduling.base import Job, Phase

WAITING = "waiting"


@dataclass(slots=True)
class Row:
    """What is known of one run."""

    run: RunDirectory
    kind: str
    """the algorithm"""
    total_steps: int
    """0 of what does not learn"""
    steps: int
    """before this sweep"""
    expected: float | None = None
    """steps per second on the machine of `paces.COSTS`"""
    telling_from: int = 0
    """steps from which its own pace counts"""
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
            None if algo is None else paces.prior(algo),
            0 if algo is None else paces.telling_from(algo),
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
        """Steps per second that it has shown; None while they say nothing of the rest."""
        at = self.progress
        if at is None or at.steps_per_s <= 0 or at.steps < self.telling_from:
            return None
        return at.steps_per_s


def _algorithm(run: RunDirectory) -> Mapping[str, Any] | None:
    """None where the configuration cannot be read: the worker will say what is wrong with it."""
    try:
        algo = run.config()["algo"]
    except (RunError, KeyError, TypeError):
        return None
    return algo if isinstance(algo, Mapping) and isinstance(algo.get("agent"), str) else None


def seconds_left(rows: Sequence[Row]) -> list[float | None]:
    """Of each row, by its own pace, else by the measured one as this machine shows it to be; None: nobody knows."""
    by_kind: dict[str, list[tuple[float, float]]] = {}
    plain: dict[str, list[float]] = {}
    for row in rows:
        if row.pace is not None:
            plain.setdefault(row.kind, []).append(row.pace)
            if row.expected is not None:
                by_kind.setdefault(row.kind, []).append((row.pace, row.expected))
    machine = estimate.speed([pair for pairs in by_kind.values() for pair in pairs])
    found: list[float | None] = []
    for row in rows:
        per_s = row.pace
        if per_s is None and row.expected is not None:
            # What runs of the same algorithm show also tells what their configuration changes.
            per_s = row.expected * (estimate.speed(by_kind[row.kind]) if row.kind in by_kind else machine)
        if per_s is None:
            per_s = estimate.pace(row.kind, plain)
        found.append(0.0 if row.to_go == 0 else None if per_s is None else row.to_go / per_s)
    return found


def remaining(rows: Sequence[Row], slots: int | None) -> float | None:
    """Seconds until all are done; None while the pace of one is unknown."""
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


def shown(rows: Sequence[Row]) -> bool:
    """Whether any run has shown its pace: until then an estimate is that of another machine."""
    return any(row.pace is not None for row in rows)
