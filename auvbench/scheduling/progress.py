"""Reading `progress.json`, which the training loop writes (`auvbench.runs.progress`), for those that watch a run."""

from __future__ import annotations

from pathlib import Path

from auvbench.runs.progress import Progress
from auvbench.untrusted import typed_json


def read(run: Path) -> Progress | None:
    """Return the last progress that a run wrote; None where it cannot be read."""
    try:
        return typed_json.read(run / "progress.json", Progress)
    except (OSError, ValueError):
        return None


def fraction(at: Progress) -> float:
    """Share of the budget that is done, in [0, 1]."""
    return min(1.0, at.steps / at.total_steps) if at.total_steps > 0 else 0.0


def remaining(at: Progress) -> float | None:
    """Seconds to go at the present pace; None while there is no pace."""
    return max(0, at.total_steps - at.steps) / at.steps_per_s if at.steps_per_s > 0 else None
