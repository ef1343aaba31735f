"""Columns of a test's rows that follow from others: a copy leaves them out, and whoever reads it computes them.

The summary of a copy names them, under its seal.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from auvbench.record import RECORD_COLUMNS
from auvbench.untrusted import tables
from auvbench.untrusted.text import short

NAMED = "left_out"
"""what a summary calls the names of the columns"""

FOLLOWING = {
    "duration_s": ("steps", "frequency_hz"),  # the one over the other
    "command_norm_sum_N": ("steps", "command_norm_mean_N"),  # their product
}
"""a column, and the two that it follows from"""

TOLERANCE = 1e-9
"""relative, up to which a column follows: both were written with all their digits"""


def _value(name: str, first: Any, second: Any) -> Any:
    return first / second if name == "duration_s" else first * second


def split(rows: bytes) -> tuple[bytes, list[str]]:
    r"""Rows of a test without the columns that follow from others in every one of them, and the names of these.

    >>> split(b"frequency_hz,steps,duration_s\n10.0,17,1.7\n")
    (b'frequency_hz,steps\n10.0,17\n', ['duration_s'])
    >>> split(b"frequency_hz,steps,duration_s\n10.0,17,1.8\n")[1]
    []
    """
    found = csv.DictReader(io.StringIO(rows.decode("utf-8")))
    there = list(found.fieldnames or ())
    content = list(found)
    out = [
        name
        for name, sources in FOLLOWING.items()
        if {name, *sources} <= {*there} and all(_follows(name, row) for row in content)
    ]
    if not out:
        return rows, []
    return tables.text(content, [name for name in there if name not in out]), out


def _follows(name: str, row: Mapping[str, str]) -> bool:
    try:
        said, first, second = (float(row[key]) for key in (name, *FOLLOWING[name]))
        return math.isclose(said, _value(name, first, second), rel_tol=TOLERANCE)
    except (TypeError, ValueError, ZeroDivisionError):
        return False


def named(summary: Mapping[str, Any]) -> list[str]:
    """The columns that the rows of an evaluation leave out; none of a run's own.

    Raises:
        ValueError: one of them follows from nothing.
    """
    names = summary.get(NAMED, [])
    if not isinstance(names, list) or not all(isinstance(name, str) and name in FOLLOWING for name in names):
        raise ValueError(
            f"summary.json leaves out {short(repr(names), 60)}; only {', '.join(FOLLOWING)} follow from others"
        )
    return list(names)


def completed(frame: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Rows with the columns that they leave out, in the order of a record.

    Raises:
        ValueError: what a column follows from is not there, or the column is.
    """
    if not names:
        return frame
    for name in names:
        if name in frame.columns:
            raise ValueError(f"episodes.csv has {name}, which its summary.json says is left out")
        if missing := [source for source in FOLLOWING[name] if source not in frame.columns]:
            raise ValueError(f"episodes.csv lacks {missing[0]}, from which {name} follows")
    # What is no number is found afterwards, in the column in which it stands.
    values = {
        name: _value(name, *(pd.to_numeric(frame[source], errors="coerce") for source in FOLLOWING[name]))
        for name in names
    }
    whole = frame.assign(**values)
    known = [name for name in RECORD_COLUMNS if name in whole.columns]
    return whole[[*(name for name in whole.columns if name not in RECORD_COLUMNS), *known]]
