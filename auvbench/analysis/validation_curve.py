"""Tests on validation scenarios during training: success against steps, wall time and simulated time."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.records import RunRecord
from auvbench.statistics.intervals import FloatArray
from auvbench.untrusted import reading

NAME = "train/validation.csv"
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
        raise Damage(f"{NAME} cannot be read ({type(error).__name__}: {error})") from error
    success = columns["success_rate"]
    rising = all((np.diff(columns[axis]) >= 0).all() for axis in AXES)
    whole = all(np.isfinite(values).all() for values in columns.values())
    if len(fingerprints) > 1 or not whole or not rising or (success < 0).any() or (success > 1).any():
        raise Damage(f"{NAME} holds rows that do not belong together, or numbers that cannot be")
    return ValidationCurve(
        fingerprints.pop(), columns["step"], columns["wall_s"], columns["simulated_s"], success
    )


def validation_rows(run: RunRecord) -> list[dict[str, Any]]:
    """Return the rows of train/validation.csv; empty without that file."""
    if run.archive is not None:
        return list(run.archive.document(run.id, "validation") or ())
    path = run.directory / NAME
    if not path.exists():
        return []
    return list(csv.DictReader(io.StringIO(reading.content(path).decode("utf-8"))))
