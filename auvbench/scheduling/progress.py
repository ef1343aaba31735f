"""Reading `progress.json`, which the training loop writes (`auvbench.runs.progress`), for whoever watches a run."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

from auvbench.runs.progress import Progress


def read(run: Path) -> Progress | None:
    """The last progress that a run wrote; None when there is none to be had."""
    try:
        data = json.loads((run / "progress.json").read_text(encoding="utf-8"))
        return Progress(**{field.name: data[field.name] for field in fields(Progress)})
    except (OSError, ValueError, KeyError, TypeError):
        return None


def fraction(at: Progress) -> float:
    """Share of the budget that is done, in [0, 1]."""
    return min(1.0, at.steps / at.total_steps) if at.total_steps > 0 else 0.0


def remaining(at: Progress) -> float | None:
    """Seconds to go at the present pace; None while there is no pace."""
    return max(0, at.total_steps - at.steps) / at.steps_per_s if at.steps_per_s > 0 else None
