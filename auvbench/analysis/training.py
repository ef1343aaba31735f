"""Reads the training records of a run, checked."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis import consistency
from auvbench.analysis.archive import TRAIN
from auvbench.analysis.evaluations import Damage, finite
from auvbench.analysis.records import RunRecord
from auvbench.record import OUTCOMES
from auvbench.statistics.intervals import FloatArray
from auvbench.untrusted import reading, tables
from auvbench.untrusted.text import short

NAME = "train/episodes.csv"

NUMBERS = ("step", "steps", "return")
"""columns of train/episodes.csv that a report uses, without the outcome"""


def has_training(run: RunRecord) -> bool:
    """Return whether the run has training episodes."""
    if run.archive is not None:
        return run.archive.has_training(run.id)
    return (run.directory / NAME).exists()


def training(run: RunRecord) -> pd.DataFrame | None:
    """Return the columns of train/episodes.csv that a report uses; None without that file (PID).

    A table without rows is sound: no episode ended during a short training.

    Raises:
        Damage: The file cannot be read, lacks a column, or holds an impossible value.
    """
    needed = ("outcome", *NUMBERS)
    if not has_training(run):
        return None
    if run.archive is not None:
        frame = run.archive.episodes(run.id, TRAIN)
        frame = frame[[name for name in needed if name in frame.columns]]
        return _checked(frame, needed)
    try:
        data = reading.content(run.directory / NAME, reading.DATA)
        frame = tables.csv(data, needed)
    except (OSError, ValueError) as error:
        raise Damage(f"{NAME} cannot be read ({short(error)})") from error
    frame = _checked(frame, needed)
    if wrong := consistency.of_file(run.manifest, NAME, data):
        raise Damage(f"train/{wrong}")
    return frame


def _checked(frame: pd.DataFrame, needed: tuple[str, ...]) -> pd.DataFrame:
    if missing := [c for c in needed if c not in frame.columns]:
        raise Damage(f"{NAME} lacks the columns {', '.join(missing)}")
    if frame.empty:
        return frame
    if bad := {str(outcome) for outcome in frame["outcome"].unique()} - set(OUTCOMES):
        raise Damage(f"{NAME} has the outcome {min(bad)!r}, not one of {', '.join(OUTCOMES)}")
    if not finite(frame[list(NUMBERS)].to_numpy()):
        raise Damage(f"{NAME} is cut short or has values that are not finite numbers")
    return frame


VALIDATION = "train/validation.csv"
AXES = ("step", "wall_s", "simulated_s")


@dataclass(frozen=True, slots=True, eq=False)
class ValidationCurve:
    """Success of one training on the validation scenarios, at rising steps."""

    fingerprint: str
    step: FloatArray
    wall_s: FloatArray
    simulated_s: FloatArray
    success: FloatArray
    """(n,) from 0 to 1"""


def read_validation_curve(run: RunRecord) -> ValidationCurve | None:
    """The run's train/validation.csv; None where there is none, or nothing in it.

    Raises:
        Damage: it cannot be read, or holds what it cannot.
    """
    try:
        rows = validation_rows(run)
        if not rows:
            return None
        columns = {name: np.array([float(row[name]) for row in rows]) for name in (*AXES, "success_rate")}
        fingerprints = {str(row["fingerprint"]) for row in rows}
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise Damage(f"{VALIDATION} cannot be read ({type(error).__name__}: {error})") from error
    success = columns["success_rate"]
    rising = all((np.diff(columns[axis]) >= 0).all() for axis in AXES)
    whole = all(np.isfinite(values).all() for values in columns.values())
    if len(fingerprints) > 1 or not whole or not rising or (success < 0).any() or (success > 1).any():
        raise Damage(f"{VALIDATION} holds rows that do not belong together, or numbers that cannot be")
    return ValidationCurve(
        fingerprints.pop(), columns["step"], columns["wall_s"], columns["simulated_s"], success
    )


def validation_rows(run: RunRecord) -> list[dict[str, Any]]:
    """Return the rows of train/validation.csv; empty without that file."""
    if run.archive is not None:
        return list(run.archive.document(run.id, "validation") or ())
    path = run.directory / VALIDATION
    if not path.exists():
        return []
    return list(csv.DictReader(io.StringIO(reading.content(path).decode("utf-8"))))
