"""Reads the training records of a run, checked."""

from __future__ import annotations

import pandas as pd

from auvbench.analysis import consistency
from auvbench.analysis.evaluations import Damage, finite
from auvbench.analysis.model import RunRecord
from auvbench.record import OUTCOMES
from auvbench.untrusted import bz2_io, reading, tables
from auvbench.untrusted.text import short

NUMBERS = ("step", "steps", "return", "final_distance_m")
"""columns of train/episodes.csv that a report uses, beside the outcome"""


def training(run: RunRecord) -> pd.DataFrame | None:
    """The columns of train/episodes.csv that a report uses; None where there is no such file (PID).

    A table without a row is sound: not one episode ended during a short training.

    Raises:
        Damage: the file cannot be read, lacks a column, or holds a value that cannot be.
    """
    path = run.directory / "train" / "episodes.csv"
    if bz2_io.beside(path) is None and not path.exists():
        return None
    name, needed = "train/episodes.csv", ("outcome", *NUMBERS)
    try:
        data = bz2_io.content(path, reading.DATA)
        frame = tables.csv(data, needed)
    except (OSError, ValueError) as error:
        raise Damage(f"{name} cannot be read ({short(error)})") from error
    if missing := [c for c in needed if c not in frame.columns]:
        raise Damage(f"{name} lacks the columns {', '.join(missing)}")
    if frame.empty:  # a training that was shorter than its first episode
        return frame
    if bad := {str(outcome) for outcome in frame["outcome"].unique()} - set(OUTCOMES):
        raise Damage(f"{name} has the outcome {min(bad)!r}, none of {', '.join(OUTCOMES)}")
    if not finite(frame[list(NUMBERS)].to_numpy()):
        raise Damage(f"{name} is cut short or has values that are not finite numbers")
    if wrong := consistency.of_file(run.manifest, name, data):
        raise Damage(f"train/{wrong}")
    return frame
