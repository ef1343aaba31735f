"""Reading `progress.json`, which the training loop writes (`auvbench.runs.progress`), for whoever watches a run."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

from auvbench.runs.manifest_fields import is_count, is_share
from auvbench.runs.progress import Progress
from auvbench.untrusted import documents, reading

_COUNTS = ("steps", "total_steps", "episodes")


def read(run: Path) -> Progress | None:
    """The last progress that a run wrote; None when there is none to be had."""
    try:
        data = documents.json_value(reading.content(run / "progress.json"))
        values = {field.name: data[field.name] for field in fields(Progress)}
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return Progress(**values) if all(_is_right(name, value) for name, value in values.items()) else None


def _is_right(name: str, value: Any) -> bool:
    if name in _COUNTS:
        return is_count(value)
    if value is None:
        return name in ("success_rate", "mean_return")
    if name == "success_rate":
        return is_share(value)
    return type(value) in (int, float) and math.isfinite(value)


def fraction(at: Progress) -> float:
    """Share of the budget that is done, in [0, 1]."""
    return min(1.0, at.steps / at.total_steps) if at.total_steps > 0 else 0.0


def remaining(at: Progress) -> float | None:
    """Seconds to go at the present pace; None while there is no pace."""
    return max(0, at.total_steps - at.steps) / at.steps_per_s if at.steps_per_s > 0 else None
