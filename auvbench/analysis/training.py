"""Reads the training records of a run, checked."""

from __future__ import annotations

import pandas as pd

from auvbench.analysis import consistency
from auvbench.analysis.archive import TRAIN
from auvbench.analysis.evaluations import Damage, finite
from auvbench.analysis.records import RunRecord
from auvbench.record import OUTCOMES
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
