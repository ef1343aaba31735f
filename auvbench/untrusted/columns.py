"""Define the columns of all tables that another person may have written: names, types, ranges, gaps.

Tables of runs, published studies and missions are checked against these schemas when they are read. Code that uses a
table therefore never meets a missing column, a text among numbers, or a number that is physically impossible. Unknown
columns are left out, so that an older auvbench can read the tables of a newer auvbench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from auvbench import metrics
from auvbench.record import ABORTED, OUTCOMES
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    import pandas as pd

LARGEST = 1e30
"""Largest magnitude of a number in a table; measured values are far smaller, and the square of a much larger number would overflow"""
WHOLE = 2.0**53
"""largest whole number of a column; up to this number, a float64 represents every whole number exactly"""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    kind: Literal["text", "whole", "number"] = "number"
    low: float = -math.inf
    needed: bool = False
    """whether the column is required"""
    gaps: bool = False
    """whether values may be missing in some rows"""
    words: tuple[str, ...] = ()
    """valid texts; empty: any text"""


Schema = Mapping[str, Column]

TEXT, OUTCOME = Column("text", needed=True), Column("text", needed=True, words=OUTCOMES)
COUNT, NUMBER = Column("whole", low=0.0), Column()


def _measured() -> dict[str, Column]:
    """Return the columns of the values that are measured in an episode.

    The columns are computed at each call, since packages can add columns at any time. Columns that depend on the
    navigation or the filter may have gaps, since the conditions of a test may have different navigation and filters.
    """
    return {
        m.name: replace(NUMBER, gaps=m.conditional)
        for m in metrics.registered()
        if m.kind in ("scenario", "episode") and m.value is not None
    }


def of_test() -> Schema:
    """Return the schema of episodes.csv of a test."""
    return {
        "condition": TEXT,
        "frequency_hz": Column(low=1e-9),
        **_measured(),
        "episode": replace(COUNT, needed=True),
        "environment": COUNT,
        "outcome": OUTCOME,
        "steps": Column("whole", low=1.0, needed=True),
        "duration_s": Column(low=0.0, needed=True),
    }


def of_mission() -> Schema:
    """Return the schema of episodes.csv of a pilot's missions, in which returns may be missing: a mission has no reward."""
    outcome = replace(OUTCOME, words=(*OUTCOMES, ABORTED))
    return {**of_test(), "outcome": outcome, "return": replace(NUMBER, gaps=True)}


TRAINING: Schema = {
    "outcome": OUTCOME,
    "step": replace(COUNT, needed=True),
    "steps": Column("whole", low=1.0, needed=True),
    "return": replace(NUMBER, needed=True),
}
"""columns of train/episodes.csv that a report uses"""


def of_study() -> Schema:
    """Return the schema of episodes.parquet, which has the episodes of tests and of trainings."""
    rows = {**of_test(), "step": COUNT}
    columns = {name: replace(column, needed=False, gaps=True) for name, column in rows.items()}
    required = {name: replace(rows[name], needed=True) for name in ("outcome", "steps")}
    parts = {name: replace(columns[name], needed=True) for name in ("condition", "episode")}
    return {"run": TEXT, "protocol": TEXT, **columns, **required, **parts}


RUNS: Schema = dict.fromkeys(("run", "config", "manifest", "evaluations", "validation"), TEXT)
"""columns of runs.parquet"""

TRAJECTORIES: Schema = {
    **dict.fromkeys(("run", "protocol", "condition"), TEXT),
    "episode": replace(COUNT, needed=True),
    **dict.fromkeys(("t_ms", "x_mm", "y_mm", "z_mm"), Column("whole", needed=True)),
}
"""columns of trajectories.parquet: whole milliseconds and millimetres"""


def checked(table: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """Return the columns of a table that are in the schema; columns of whole numbers that must not have gaps become int64.

    Raises:
        ValueError: a column is missing, occurs twice, or has a value of a wrong type or range; the message is one line.
    """
    if missing := [name for name, column in schema.items() if column.needed and name not in table.columns]:
        raise ValueError(f"it lacks the columns {', '.join(missing)}")
    names = [name for name in table.columns if name in schema]
    if twice := [name for name in schema if names.count(name) > 1]:
        raise ValueError(f"it has the column {twice[0]} twice")
    if not len(table):  # In a table without rows, the columns have no type to check.
        return table[names]
    table = table[names]
    types = dict(zip(names, table.dtypes, strict=True))
    plain = [name for name in names if schema[name] is NUMBER and types[name].kind in "if"]
    # One comparison of all columns of numbers is fast. If a value is NaN or too large, each of these columns is checked below.
    if (np.abs(table[plain].to_numpy(dtype=np.float64)) <= LARGEST).all():
        names = [name for name in names if name not in plain]
    values = {name: _values(name, table[name], schema[name]) for name in names}
    return table.assign(**{k: v for k, v in values.items() if v.dtype != types[k]})


def _values(name: str, values: pd.Series, column: Column) -> pd.Series:
    """Return the checked values of a column."""
    if column.kind == "text":
        return _texts(name, values, column)
    numbers = values.to_numpy()
    if not column.gaps and column.kind == "whole":
        what = f"a whole number{_from(column)} in every row"
    else:
        what = f"a finite number up to ±{LARGEST:g}{_from(column)}" + ("" if column.gaps else " in every row")
    if numbers.dtype.kind not in "iuf":
        raise ValueError(f"{name} is not {what}")
    gaps = np.isnan(numbers) if numbers.dtype.kind == "f" else np.zeros(len(numbers), dtype=bool)
    present = numbers[~gaps]
    if (gaps.any() and not column.gaps) or _impossible(present, column):
        raise ValueError(f"{name} is not {what}")
    if column.kind == "whole" and not column.gaps:
        return values.astype(np.int64)
    return values.astype(np.float64) if numbers.dtype.kind == "u" else values


def _from(column: Column) -> str:
    return "" if column.low == -math.inf else f" from {column.low:g}"


def _impossible(numbers: np.ndarray, column: Column) -> bool:
    """Return whether a number is infinite, out of the column's range, or a fraction in a column of whole numbers."""
    most = WHOLE if column.kind == "whole" else LARGEST
    # Convert to float first: in int64, the absolute value of the smallest number overflows and is negative.
    wide = numbers.astype(np.float64)
    fine = (np.abs(wide) <= most) & (wide >= column.low)
    if column.kind == "whole":
        fine &= wide == np.rint(wide)
    return not bool(fine.all())


def _texts(name: str, values: pd.Series, column: Column) -> pd.Series:
    """Return the checked texts of a column."""
    import pandas as pd

    different = values.cat.categories if isinstance(values.dtype, pd.CategoricalDtype) else values.unique()
    if values.isna().any() and not column.gaps:
        raise ValueError(f"{name} has no text in some row")
    for text in different:
        if not isinstance(text, str) and not pd.isna(text):
            raise ValueError(f"{name} is not a text: {short(repr(text), 40)}")
        if column.words and isinstance(text, str) and text not in column.words:
            raise ValueError(
                f"it has the {name} {short(repr(text), 40)}, must be one of {', '.join(column.words)}"
            )
    return values
