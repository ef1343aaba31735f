"""Create the dictionaries `info`. All interfaces have the same keys; the values are numbers or arrays of numbers.

=============  ==================================================================================================
`pose`         (7,) x, y, z in m, quaternion w, x, y, z: pose without noise; world axes (ENU)
`waypoint`     (3,) x, y, z in m; in other tasks `reference`, the present reference position
`distance`     m, distance from the vehicle to the waypoint or the reference
`is_success`   whether the episode has ended with success
`record`       at the end of an episode: its record (`auvbench.record`), with `outcome` as a code: 0 success,
               1 collision, 2 timeout, 3 out of bounds; in a world with solids `hit` is the kind of solid that was hit: 0 sphere,
               1 capsule, 2 cylinder, 3 box, 4 plane, 5 bottom, -1 none
=============  ==================================================================================================

As in Gymnasium's vector environments, each value for a batch is an array of n rows. The key `_<key>` has a mask (n,) of
the rows that are valid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.envs.batch import State
from auvbench.record import OUTCOMES, Record
from auvbench.worlds.kinds import KINDS, NOTHING

WHOLE = ("episode", "environment", "outcome", "steps", "hit", "infeasible_steps")
"""Columns of a record that are whole numbers"""


def numbers(record: Record) -> dict[str, int | float]:
    """Return a record as numbers: `outcome` as an index into OUTCOMES, `hit` as an index into KINDS. Other texts are left out."""
    codes: dict[str, Any] = {"outcome": OUTCOMES.index(str(record["outcome"]))}
    if "hit" in record:
        codes["hit"] = KINDS.index(str(record["hit"])) if record["hit"] else NOTHING
    return {
        name: codes.get(name, value)
        for name, value in record.items()
        if name in codes or not isinstance(value, str)
    }


def single(state: State, i: int, record: Record | None = None) -> dict[str, Any]:
    """Return the info of environment `i`, with a record if its episode has ended."""
    info: dict[str, Any] = {
        "pose": state.pose[i].copy(),
        state.key: state.reference[i].copy(),
        "distance": float(state.distance[i]),
        "is_success": record is not None and record["outcome"] == "success",
    }
    if record is not None:
        info["record"] = numbers(record)
    return info


def batch(state: State, success: NDArray[np.bool_], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the info of n environments. `rows` (n,) marks the valid rows, `success` (n,) the episodes that ended with success."""
    return {
        "pose": state.pose.copy(),
        "_pose": rows.copy(),
        state.key: state.reference.copy(),
        f"_{state.key}": rows.copy(),
        "distance": state.distance.copy(),
        "_distance": rows.copy(),
        "is_success": success,
        "_is_success": rows.copy(),
    }


def final(
    state: State, ended: NDArray[np.int64], records: Sequence[Record], rows: NDArray[np.bool_]
) -> dict[str, Any]:
    """Return the info of the episodes that ended in environments `ended` (k,), as arrays of n rows; `rows` (n,) marks
    the valid rows.
    """
    n = len(rows)
    spread = replace(
        state,
        pose=_spread(n, ended, state.pose),
        reference=_spread(n, ended, state.reference),
        distance=_spread(n, ended, state.distance),
    )
    success = np.zeros(n, dtype=np.bool_)
    success[ended] = [record["outcome"] == "success" for record in records]
    return batch(spread, success, rows) | {"record": table(ended, records, rows), "_record": rows.copy()}


def table(ended: NDArray[np.int64], records: Sequence[Record], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the columns of the records by name, each as an array of n rows."""
    coded = [numbers(record) for record in records]
    values = np.zeros((len(coded[0]), len(rows)))
    values[:, ended] = np.array([list(record.values()) for record in coded]).T
    columns: dict[str, Any] = {}
    for name, column in zip(coded[0], values, strict=True):
        columns[name] = column.astype(np.int64) if name in WHOLE else column
        columns[f"_{name}"] = rows.copy()
    return columns


def _spread(n: int, rows: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    filled = np.zeros((n, *values.shape[1:]))
    filled[rows] = values
    return filled
