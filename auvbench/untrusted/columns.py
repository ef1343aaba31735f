"""The columns of all tables that another person may have written: names, types, ranges, gaps.

A table of a run, of a published study and of a mission is checked against one of these schemas where it is read, so that
nothing behind it meets a missing column, a text among numbers, or a number that cannot have been measured. Columns that a
schema does not name are left out, so that an older auvbench reads the tables of a newer one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from auvbench.metrics import METRICS
from auvbench.record import ABORTED, OUTCOMES
from auvbench.untrusted.text import short

if TYPE_CHECKING:
    import pandas as pd

LARGEST = 1e30
"""nothing that is measured comes near; the squares of larger numbers would leave what a float holds"""
WHOLE = 2.0**53
"""largest whole number that a float64 holds exactly"""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table."""

    kind: Literal["text", "whole", "number"] = "number"
    low: float = -math.inf
    needed: bool = False
    """whether a table without it is refused"""
    gaps: bool = False
    """whether a row may have no value"""
    words: tuple[str, ...] = ()
    """valid texts; empty: any"""


Schema = Mapping[str, Column]

TEXT, OUTCOME = Column("text", needed=True), Column("text", needed=True, words=OUTCOMES)
COUNT, NUMBER = Column("whole", low=0.0), Column()


def _measured() -> dict[str, Column]:
    """Return the columns of what is measured in an episode; packages add theirs at any time."""
    return {m.name: NUMBER for m in METRICS if m.kind in ("scenario", "episode") and m.value is not None}


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
    """Return the schema of episodes.csv of a pilot's missions, which have no reward."""
    outcome = replace(OUTCOME, words=(*OUTCOMES, ABORTED))
    return {**of_test(), "outcome": outcome, "return": replace(NUMBER, gaps=True)}


TRAINING: Schema = {
    "outcome": OUTCOME,
    "step": replace(COUNT, needed=True),
    "steps": Column("whole", low=1.0, needed=True),
    "return": replace(NUMBER, needed=True),
}
"""train/episodes.csv, the columns that a report uses"""


def of_study() -> Schema:
    """Return the schema of episodes.parquet, which has the episodes of tests and of trainings."""
    rows = {**of_test(), "step": COUNT}
    found = {name: replace(column, needed=False, gaps=True) for name, column in rows.items()}
    whole = {name: replace(rows[name], needed=True) for name in ("outcome", "steps")}
    parts = {name: replace(found[name], needed=True) for name in ("condition", "episode")}
    return {"run": TEXT, "protocol": TEXT, **found, **whole, **parts}


RUNS: Schema = dict.fromkeys(("run", "config", "manifest", "evaluations", "validation"), TEXT)
"""runs.parquet"""

TRAJECTORIES: Schema = {
    **dict.fromkeys(("run", "protocol", "condition"), TEXT),
    "episode": replace(COUNT, needed=True),
    **dict.fromkeys(("t_ms", "x_mm", "y_mm", "z_mm"), Column("whole", needed=True)),
}
"""trajectories.parquet: whole milliseconds and millimetres"""


def checked(table: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """Return the columns of a table that its schema names, whole numbers without gaps as int64.

    Raises:
        ValueError: a column is missing, there twice, or has a value of another type or out of its range; in one line.
    """
    if missing := [name for name, column in schema.items() if column.needed and name not in table.columns]:
        raise ValueError(f"it lacks the columns {', '.join(missing)}")
    names = [name for name in table.columns if name in schema]
    if twice := [name for name in schema if names.count(name) > 1]:
        raise ValueError(f"it has the column {twice[0]} twice")
    if not len(table):  # columns without a value have no type
        return table[names]
    table = table[names]
    types = dict(zip(names, table.dtypes, strict=True))
    plain = [name for name in names if schema[name] is NUMBER and types[name].kind in "if"]
    # All measures at once, which is quicker; NaN compares as False.
    if (np.abs(table[plain].to_numpy(dtype=np.float64)) <= LARGEST).all():
        names = [name for name in names if name not in plain]
    found = {name: _values(name, table[name], schema[name]) for name in names}
    return table.assign(**{k: v for k, v in found.items() if v.dtype != types[k]})


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
    known = np.isnan(numbers) if numbers.dtype.kind == "f" else np.zeros(len(numbers), dtype=bool)
    present = numbers[~known]
    if (known.any() and not column.gaps) or _impossible(present, column):
        raise ValueError(f"{name} is not {what}")
    if column.kind == "whole" and not column.gaps:
        return values.astype(np.int64)
    return values.astype(np.float64) if numbers.dtype.kind == "u" else values


def _from(column: Column) -> str:
    return "" if column.low == -math.inf else f" from {column.low:g}"


def _impossible(numbers: np.ndarray, column: Column) -> bool:
    """Return whether a number is infinite, out of the column's range, or not a whole one where it must be."""
    most = WHOLE if column.kind == "whole" else LARGEST
    # In floats: the absolute value of the least integer is itself.
    wide = numbers.astype(np.float64)
    fine = (np.abs(wide) <= most) & (wide >= column.low)
    if column.kind == "whole":
        fine &= wide == np.rint(wide)
    return not bool(fine.all())


def _texts(name: str, values: pd.Series, column: Column) -> pd.Series:
    """Return a column of texts."""
    import pandas as pd

    different = values.cat.categories if isinstance(values.dtype, pd.CategoricalDtype) else values.unique()
    if values.isna().any() and not column.gaps:
        raise ValueError(f"{name} has no text in some row")
    for text in different:
        if not isinstance(text, str) and not pd.isna(text):
            raise ValueError(f"{name} is not a text: {short(repr(text), 40)}")
        if column.words and isinstance(text, str) and text not in column.words:
            raise ValueError(f"it has the {name} {short(repr(text), 40)}, none of {', '.join(column.words)}")
    return values
