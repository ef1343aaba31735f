"""Reads one evaluation of a run, and says what is wrong with it: of a damaged one, no row enters a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.analysis import consistency, derived_columns, scenarios
from auvbench.analysis.model import Evaluation
from auvbench.record import OUTCOMES, RECORD_COLUMNS
from auvbench.runs import integrity, schemas
from auvbench.untrusted import bz2_io, reading, tables
from auvbench.untrusted.text import LONGEST, plain, short

CORE_COLUMNS = (
    "steps",
    "duration_s",
    "return",
    "final_distance_m",
    "deviation_mean_m",
    "deviation_std_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
)
"""without these an evaluation is not reported on; not all of a record's columns, so that an evaluation stays
readable when a later auvbench measures something more"""

MEASURED = tuple(name for name in RECORD_COLUMNS if name not in ("episode", "environment", "outcome"))
"""columns that hold a finite number in every row, where they are there"""

LARGEST = 1e30
"""nothing that is measured comes near; the squares of larger numbers would leave what a float holds"""


class Damage(Exception):
    """Why a file cannot be used; `kind` is that of the `Problem`."""

    def __init__(self, message: str, kind: str = "damaged") -> None:
        super().__init__(message)
        self.kind = kind


def is_name(value: Any) -> bool:
    """Whether a text can stand in a table and in a figure: one line, not endless, every character visible."""
    return isinstance(value, str) and 0 < len(value) <= LONGEST and plain(value) == value


def finite(table: np.ndarray[Any, Any]) -> bool:
    """Whether all of it are numbers that can have been measured."""
    # A text anywhere makes a table one of objects; NaN compares as False.
    return table.dtype.kind in "if" and bool((np.abs(table) <= LARGEST).all())


def sealed(path: Path, schema: type[schemas.Manifest | schemas.Summary]) -> dict[str, Any]:
    """Return a manifest or summary.

    Raises:
        Damage: it is missing, damaged, or of another version.
    """
    try:
        return schemas.read(path, schema)
    except FileNotFoundError as error:
        raise Damage(f"{path.name} is missing") from error
    except OSError as error:
        raise Damage(f"{path.name} cannot be read ({error.strerror})") from error
    except integrity.VersionError as error:
        raise Damage(f"{path.name} has {error}", "foreign") from error
    except ValueError as error:
        raise Damage(f"{path.name}: {short(error)}") from error


def read_evaluation(directory: Path) -> Evaluation:
    """summary.json and episodes.csv of one protocol.

    Raises:
        Damage: one of them cannot be used, is not what was written, or they disagree.
    """
    summary = sealed(directory / "summary.json", schemas.Summary)
    path = directory / "episodes.csv"
    try:
        data = bz2_io.content(path, reading.DATA)
    except FileNotFoundError as error:
        raise Damage("episodes.csv is missing") from error
    except (OSError, ValueError) as error:
        raise Damage(f"episodes.csv cannot be read ({short(error)})") from error
    episodes = _episodes(data, summary, directory)
    wrong = consistency.of_file(summary, path.name, data) or consistency.of_rows(summary, episodes)
    if wrong:
        raise Damage(wrong)
    return Evaluation(
        protocol=directory.name,
        fingerprint=summary["fingerprint"],
        summary=summary,
        episodes=episodes,
        directory=directory,
    )


def _conditions(summary: Mapping[str, Any]) -> dict[str, int]:
    """Return the number of episodes of each condition."""
    found = {c["name"]: c["episodes"] for c in summary["conditions"]}
    if len(found) < max(1, len(summary["conditions"])):
        raise Damage("summary.json has no conditions, or one of them twice")
    return found


def _episodes(data: bytes, summary: Mapping[str, Any], directory: Path) -> pd.DataFrame:
    """episodes.csv, checked: all columns, all rows of the summary, no row cut short, all values possible."""
    expected = _conditions(summary)
    try:
        frame = tables.csv(data, words=("condition",))  # one may be called 1.30
    except ValueError as error:
        raise Damage(f"episodes.csv cannot be read ({short(error)})") from error
    try:
        left_out = derived_columns.named(summary)
    except ValueError as error:
        raise Damage(str(error)) from error
    needed = ("condition", "episode", "outcome", *CORE_COLUMNS)
    if missing := [c for c in needed if c not in frame.columns and c not in left_out]:
        raise Damage(f"episodes.csv lacks the columns {', '.join(missing)}")
    rows = sum(expected.values())
    if len(frame) != rows:
        raise Damage(f"episodes.csv has {len(frame)} rows, summary.json says {rows}: evaluate again")
    if not data.endswith(b"\n") or frame.iloc[-1:, -1].isna().any():
        raise Damage(f"episodes.csv is cut short: the last of its {len(frame)} rows ends half way")
    _check_rows(frame, expected)
    try:
        frame = scenarios.joined(derived_columns.completed(frame, left_out), summary, directory)
    except ValueError as error:
        raise Damage(str(error)) from error
    _check_numbers(frame)
    return frame


def _check_rows(frame: pd.DataFrame, expected: Mapping[str, int]) -> None:
    """Known outcomes, and of each condition the episodes of the summary, each once."""
    if bad := {str(name) for name in frame["outcome"].to_numpy()} - set(OUTCOMES):
        raise Damage(f"episodes.csv has the outcome {min(bad)!r}, none of {', '.join(OUTCOMES)}")
    conditions = frame["condition"].tolist()
    found = Counter(conditions)
    for name in [*expected, *found]:
        if found[name] != expected.get(name, 0):
            raise Damage(
                f"episodes.csv has {found[name]} episodes of condition {name!r}, "
                f"summary.json says {expected.get(name, 0)}: evaluate again"
            )
    numbers = frame["episode"].to_numpy()
    if numbers.dtype.kind != "i" or numbers.min() < 0:
        raise Damage("episodes.csv: episode is not a whole number from 0 in every row")
    ids = list(zip(conditions, numbers.tolist(), strict=True))
    if len(set(ids)) < len(ids):
        (name, number), times = Counter(ids).most_common(1)[0]
        raise Damage(f"episodes.csv has episode {number} of condition {name!r} {times} times: evaluate again")


def _check_numbers(frame: pd.DataFrame) -> None:
    """What was measured is a finite number everywhere, and steps are whole and at least one."""
    columns = [name for name in MEASURED if name in frame.columns]
    if not finite(frame[columns].to_numpy()):
        for column in columns:
            numbers = pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=np.float64)
            _refuse(frame, ~np.isfinite(numbers), f"{column} is not a finite number")
            _refuse(frame, np.abs(numbers) > LARGEST, f"{column} is beyond ±{LARGEST:g}")
    steps = frame["steps"].to_numpy(dtype=np.float64)
    _refuse(frame, (steps < 1) | (steps != np.rint(steps)), "steps is not a whole number from 1")


def _refuse(frame: pd.DataFrame, bad: np.ndarray[Any, np.dtype[np.bool_]], what: str) -> None:
    if bad.any():
        first = frame["episode"].iloc[int(bad.argmax())]
        raise Damage(
            f"episodes.csv: {what} in {int(bad.sum())} of {len(frame)} episodes (first: episode {first})"
        )
