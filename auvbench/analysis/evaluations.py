"""Reads one evaluation of a run, and says what is wrong with it: of a damaged one, no row enters a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from auvbench.analysis import consistency
from auvbench.analysis.records import Evaluation, RunRecord
from auvbench.record import OUTCOMES, measured
from auvbench.runs import integrity
from auvbench.untrusted import path_safety, reading, tables
from auvbench.untrusted.text import LONGEST, plain, short

if TYPE_CHECKING:
    from auvbench.analysis.archive import Archive

CORE_COLUMNS = (
    "steps",
    "duration_s",
    "return",
    "final_distance_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
)
"""without these an evaluation is not reported on; not all of a record's columns, so that an evaluation stays
readable when a later auvbench measures something more"""
OF_WAYPOINTS = ("deviation_mean_m", "deviation_std_m")
OF_OTHERS = ("position_error_rms_m", "cross_track_rms_m", "final_position_error_m")
"""alike, by task: the waypoint task has all of the former, every other task one of the latter"""

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


def checked(value: Any, schema: type[integrity.Manifest | integrity.Summary], name: str) -> dict[str, Any]:
    """Return a manifest or summary from a JSON value.

    Raises:
        Damage: It is damaged, or of another version.
    """
    try:
        return integrity.checked(value, schema)
    except integrity.VersionError as error:
        raise Damage(f"{name} has {error}", "foreign") from error
    except ValueError as error:
        raise Damage(f"{name}: {short(error)}") from error


def sealed(path: Path, schema: type[integrity.Manifest | integrity.Summary]) -> dict[str, Any]:
    """Return a manifest or summary.

    Raises:
        Damage: it is missing, damaged, or of another version.
    """
    try:
        return integrity.read(path, schema)
    except FileNotFoundError as error:
        raise Damage(f"{path.name} is missing") from error
    except OSError as error:
        raise Damage(f"{path.name} cannot be read ({error.strerror})") from error
    except integrity.VersionError as error:
        raise Damage(f"{path.name} has {error}", "foreign") from error
    except ValueError as error:
        raise Damage(f"{path.name}: {short(error)}") from error


def protocols_of(run: RunRecord) -> list[str]:
    """Return the names of the protocols by which a run was evaluated."""
    if run.archive is not None:
        return sorted(run.archive.summaries(run.id))
    return sorted(path.parent.name for path in run.directory.glob("evaluations/*/summary.json"))


def evaluation_of(run: RunRecord, protocol: str) -> Evaluation:
    """Read the evaluation of a run by a protocol that it has.

    Raises:
        Damage: It cannot be used.
    """
    if run.archive is not None:
        return archived_evaluation(run.archive, run.id, protocol)
    return read_evaluation(path_safety.child(run.directory / "evaluations", protocol))


def read_evaluation(directory: Path) -> Evaluation:
    """Read summary.json and episodes.csv of one protocol.

    Raises:
        Damage: One of them cannot be used, was changed, or they disagree.
    """
    summary = sealed(directory / "summary.json", integrity.Summary)
    try:
        data = reading.content(directory / "episodes.csv", reading.DATA)
        frame = tables.csv(data, words=("condition",))  # a condition may be called 1.30
    except FileNotFoundError as error:
        raise Damage("episodes.csv is missing") from error
    except (OSError, ValueError) as error:
        raise Damage(f"episodes.csv cannot be read ({short(error)})") from error
    if not data.endswith(b"\n") or (len(frame) and frame.iloc[-1:, -1].isna().any()):
        raise Damage(f"episodes.csv is cut short: the last of its {len(frame)} rows is incomplete")
    return _checked(directory.name, summary, frame, directory, data)


def archived_evaluation(archive: Archive, run: str, protocol: str) -> Evaluation:
    """Read one evaluation of a run of a published study.

    Raises:
        Damage: It cannot be used, or its summary and rows disagree.
    """
    summary = checked(
        archive.summaries(run)[protocol], integrity.Summary, f"the summary of {short(protocol, 40)}"
    )
    found = _checked(protocol, summary, archive.episodes(run, protocol), archive.folder, None)
    return replace(found, archive=archive)


def _checked(
    protocol: str, summary: dict[str, Any], frame: pd.DataFrame, directory: Path, data: bytes | None
) -> Evaluation:
    """Return the evaluation if summary and rows agree; `data` is episodes.csv, None without that file."""
    _check_episodes(frame, summary)
    wrong = consistency.of_file(summary, "episodes.csv", data) if data is not None else ""
    if wrong := wrong or consistency.of_rows(summary, frame):
        raise Damage(wrong)
    return Evaluation(protocol, summary["fingerprint"], summary, frame, directory)


def _conditions(summary: Mapping[str, Any]) -> dict[str, int]:
    """Return the number of episodes of each condition."""
    found = {c["name"]: c["episodes"] for c in summary["conditions"]}
    if len(found) < max(1, len(summary["conditions"])):
        raise Damage("summary.json has no conditions, or one of them twice")
    return found


def _check_episodes(frame: pd.DataFrame, summary: Mapping[str, Any]) -> None:
    """Raise Damage unless all columns and all rows of the summary are there, with possible values."""
    expected = _conditions(summary)
    own = () if any(name in frame.columns for name in OF_OTHERS) else OF_WAYPOINTS
    needed = ("condition", "episode", "outcome", *CORE_COLUMNS, *own)
    if missing := [c for c in needed if c not in frame.columns]:
        raise Damage(f"episodes.csv lacks the columns {', '.join(missing)}")
    rows = sum(expected.values())
    if len(frame) != rows:
        raise Damage(f"episodes.csv has {len(frame)} rows, summary.json says {rows}: evaluate again")
    _check_rows(frame, expected)
    _check_numbers(frame)


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
    columns = [name for name in (*measured(), "environment") if name in frame.columns]
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
