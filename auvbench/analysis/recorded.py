"""Read the records of a run: trajectories of its tests, episodes and validations of its training."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from auvbench.analysis.damage import Damage, finite, named
from auvbench.analysis.records import RunRecord
from auvbench.analysis.sources import VALIDATION, StoredPath


def paths(run: RunRecord, protocol: str, condition: str, episodes: int) -> Iterator[StoredPath]:
    """Yield the stored trajectories of a test under one condition, at most `episodes` of them.

    Raises:
        Damage: the file cannot be read, or has no trajectories.
    """
    return run.source.paths(protocol, condition, episodes, run.evaluations[protocol].episodes)


def training(run: RunRecord) -> pd.DataFrame | None:
    """Return a run's training episodes, with the columns that a report uses; None without training episodes (PID).

    Raises:
        Damage: the file cannot be read, lacks a column, or has an impossible value.
    """
    return run.source.training(run.manifest) if run.source.has_training() else None


def read_validation_curve(run: RunRecord) -> pd.DataFrame | None:
    """Return a run's validation curve: `step` (rising) and `success_rate` (0 to 1) of train/validation.csv.

    Return None if the file has no rows.

    Raises:
        Damage: the file cannot be read, its steps do not rise, or a value is impossible.
    """
    with named(VALIDATION):
        rows = run.source.validation()
        frame = pd.DataFrame({n: [float(row[n]) for row in rows] for n in ("step", "success_rate")})
    rising, possible = frame["step"].is_monotonic_increasing, frame["success_rate"].between(0, 1).all()
    if not (rising and possible and finite(frame.to_numpy())):
        raise Damage(f"{VALIDATION} must have rising steps, and success rates from 0 to 1")
    return frame if len(frame) else None
