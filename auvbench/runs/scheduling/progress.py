"""`progress.json`: how far a run is, for whoever watches it.

The training loop writes it, the live table and `auvbench runs` read it. It is a convenience: nothing depends
on it, so it is replaced atomically but not forced to disk, and a failure to write it is not an error.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path

FILE = "progress.json"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is."""

    steps: int  # environment steps so far
    total_steps: int
    steps_per_s: float | None = None
    episodes: int = 0
    success_rate: float | None = None  # over the last 100 episodes, in [0, 1]
    time: float = 0.0  # seconds since the epoch, by the writer's clock

    @property
    def fraction(self) -> float:
        return min(1.0, self.steps / self.total_steps) if self.total_steps > 0 else 0.0

    @property
    def remaining_s(self) -> float | None:
        """Seconds to go at the present pace; None while there is no pace."""
        if not self.steps_per_s:
            return None
        return max(0, self.total_steps - self.steps) / self.steps_per_s


class ProgressWriter:
    """Writes a run's progress, at most once per `interval` seconds."""

    def __init__(self, run: Path, interval: float = 1.0) -> None:
        self.path = run / FILE
        self.interval = interval
        self._next = 0.0

    def write(
        self,
        steps: int,
        total_steps: int,
        steps_per_s: float | None,
        episodes: int,
        success_rate: float | None,
        *,
        force: bool = False,
    ) -> None:
        """Writes when the interval is over, or always with `force` (at the start and at the end)."""
        now = time.monotonic()
        if now < self._next and not force:
            return
        self._next = now + self.interval
        progress = Progress(steps, total_steps, steps_per_s, episodes, success_rate, time.time())
        temporary = self.path.with_name(f".{FILE}.{os.getpid()}")
        with contextlib.suppress(OSError):
            temporary.write_text(json.dumps(asdict(progress)), encoding="utf-8")
            temporary.replace(self.path)


def read(run: Path) -> Progress | None:
    """The last progress a run wrote; None when there is none to be had."""
    try:
        data = json.loads((run / FILE).read_text(encoding="utf-8"))
        return Progress(**{f.name: data[f.name] for f in fields(Progress)})
    except (OSError, ValueError, KeyError, TypeError):
        return None
