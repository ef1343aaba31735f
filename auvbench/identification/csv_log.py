"""Read a log from a table of comma-separated values; docs/identification.md lists the columns."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.errors import closest
from auvbench.identification.log import CHANNELS, Log, LogError, checked
from auvbench.untrusted import reading, tables
from auvbench.untrusted.text import short

FloatArray = NDArray[np.float64]

FRAMES = ("enu", "ned")
_TURN = np.array([1.0, -1.0, -1.0])

TIME = {"t_s": 1.0, "time_s": 1.0, "t_ms": 1e-3, "time_ms": 1e-3, "t_us": 1e-6, "time_us": 1e-6}
"""Time columns, each with the factor that converts its values to s."""
_DEG = np.pi / 180.0
COLUMNS: Mapping[str, tuple[str, float]] = {
    **{f"{name}_m": (name, 1.0) for name in ("x", "y", "z")},
    "depth_m": ("depth", 1.0),
    **{f"{name}_{unit}": (name, factor) for name in ("roll", "pitch", "yaw") for unit, factor in (("rad", 1.0), ("deg", _DEG))},
    **{f"{alias}_rad": (name, 1.0) for alias, name in (("phi", "roll"), ("theta", "pitch"), ("psi", "yaw"))},
    **{name: (name, 1.0) for name in ("qw", "qx", "qy", "qz")},
    **{f"{name}_mps": (name, 1.0) for name in ("u", "v", "w")},
    **{f"{name}_{unit}": (name, factor) for name in ("p", "q", "r") for unit, factor in (("radps", 1.0), ("degps", _DEG))},
    **{f"{name}_mps2": (name, 1.0) for name in ("ax", "ay", "az")},
    "voltage_V": ("voltage", 1.0),
}  # fmt: skip
"""Measured quantity of each column, and the factor that converts the column's values to SI units."""
WRENCH = ("Fx_N", "Fy_N", "Fz_N", "Mx_Nm", "My_Nm", "Mz_Nm")
ENDINGS = {"_us": "pwm", "_cmd": "command", "_N": "force"}
"""Kind of input for each ending of an actuator column's name."""


def read(path: Path, frame: str = "enu") -> Log:
    """Return the log of a file.

    Args:
        path: file with a header.
        frame: axes of the file: "enu" (ENU and FLU) or "ned" (NED and FRD).

    Raises:
        LogError: the file cannot be read, or a check fails.
    """
    try:
        data = reading.content(path, reading.DATA)
        header = data.split(b"\n", 1)[0].decode("utf-8-sig").strip().split(",")
        names = [name.strip().strip('"') for name in header]
        table = tables.csv(data, words=names)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise LogError(f"{path}: not a table of comma-separated values: {short(error)}") from None
    table.columns = [str(name).removeprefix("\ufeff").strip() for name in table.columns]
    return parse(table, str(path), sha256(data).hexdigest(), frame)


def parse(table: pd.DataFrame, name: str, digest: str, frame: str = "enu") -> Log:
    """Return the log of a table of texts or numbers with the columns of docs/identification.md.

    Raises:
        LogError: a column is missing or unknown, or a check fails.
    """
    rows = len(table)
    # Columns with a dot are additional columns of `auvbench replay --signals`, which are not read.
    table = table[[column for column in table.columns if "." not in str(column)]]
    given = {str(column) for column in table.columns}
    times = [column for column in TIME if column in given]
    if not times:
        raise LogError(f"{name}: has no time; it needs a column t_s, in s ({closest('t_s', TIME)})")
    time = _numbers(table, times[0], name) * TIME[times[0]]
    values = {
        quantity: _numbers(table, column, name) * factor
        for column, (quantity, factor) in COLUMNS.items()
        if column in given
    }
    kind, actuators, inputs = _inputs(table, name)
    known = {*TIME, *COLUMNS, *WRENCH, *(column for column in given if _ending(column))}
    if unknown := sorted(given - known):
        raise LogError(f"{name}: unknown column {short(unknown[0])!r}; {closest(unknown[0], [*COLUMNS, *TIME])}, NAME_us, NAME_cmd, NAME_N")  # fmt: skip
    measured = _measured(values, rows, name)
    acceleration = _three(values, ("ax", "ay", "az"), name)
    if frame == "ned":
        if "depth" not in values:
            measured[:, 2] *= -1.0
        measured[:, 1] *= -1.0
        for start in (3, 6, 9):
            measured[:, start : start + 3] *= _TURN
        if acceleration is not None:
            acceleration = acceleration * _TURN
        if kind == "wrench":
            inputs = frames.flip(inputs)
    measured[:, 3:6] = _unwrapped(measured[:, 3:6])
    return checked(
        Log(
            name=name,
            digest=digest,
            time=time - time[0] if rows else time,
            kind=kind,
            actuators=actuators,
            inputs=inputs,
            measured=measured,
            acceleration=acceleration,
            voltage=_held(values["voltage"], "voltage_V", name) if "voltage" in values else None,
        )
    )


def _numbers(table: pd.DataFrame, column: str, name: str) -> FloatArray:
    """Return the numbers (T,) of a column; an empty cell is NaN.

    Raises:
        LogError: a cell is neither empty nor a finite number.
    """
    cells = table[column]
    if cells.dtype.kind in "fiu":
        return np.asarray(cells, dtype=np.float64)
    texts = cells.astype(str).str.strip()
    values = np.asarray(pd.to_numeric(texts, errors="coerce"), dtype=np.float64)
    wrong = np.flatnonzero(~np.isfinite(values) & np.asarray(texts != ""))
    if wrong.size:
        row = int(wrong[0])
        raise LogError(
            f"{name}: {column} is {short(texts.iloc[row])!r} in row {row + 1}; it must be a finite number, or empty where"
            " nothing was measured"
        )
    return values


def _ending(column: str) -> str:
    """Return the ending of an actuator column's name, such as `_us`; '' for other columns."""
    if column in TIME or column in COLUMNS or column in WRENCH:
        return ""
    return next((ending for ending in ENDINGS if column.endswith(ending) and len(column) > len(ending)), "")


def _inputs(table: pd.DataFrame, name: str) -> tuple[str, tuple[str, ...], FloatArray]:
    """Return the kind of the inputs, the names of the actuators (or wrench components), and the inputs (T, n_u)."""
    columns = [str(column) for column in table.columns]
    wrench = [column for column in WRENCH if column in columns]
    groups = {
        kind: [column for column in columns if _ending(column) == ending] for ending, kind in ENDINGS.items()
    }
    present = [kind for kind, members in groups.items() if members] + (["wrench"] if wrench else [])
    if not present:
        raise LogError(
            f"{name}: has no inputs; record what the thrusters were commanded: NAME_us (PWM in us), NAME_cmd (-1 to 1) or"
            " NAME_N for each thruster, or the wrench Fx_N to Mz_Nm"
        )
    if len(present) > 1:
        raise LogError(
            f"{name}: has inputs of {len(present)} kinds ({', '.join(present)}); keep the columns of one kind"
        )
    kind = present[0]
    if kind == "wrench":
        inputs = np.zeros((len(table), 6))
        for column in wrench:
            inputs[:, WRENCH.index(column)] = _held(_numbers(table, column, name), column, name)
        return kind, WRENCH, inputs
    chosen = groups[kind]
    inputs = np.column_stack([_held(_numbers(table, column, name), column, name) for column in chosen])
    return kind, tuple(column.removesuffix(_ending(column)) for column in chosen), inputs


def _held(values: FloatArray, column: str, name: str) -> FloatArray:
    """Return the values (T,), with each empty cell filled by the last value before it."""
    if values.size and np.isnan(values[0]):
        raise LogError(f"{name}: {column} is empty in row 1; an input needs a value from the first row on")
    rows = np.where(np.isnan(values), 0, np.arange(values.size))
    return np.asarray(values[np.maximum.accumulate(rows)])


def _three(values: Mapping[str, FloatArray], names: tuple[str, ...], name: str) -> FloatArray | None:
    present = [part for part in names if part in values]
    if not present:
        return None
    if len(present) < len(names):
        missing = next(part for part in names if part not in values)
        raise LogError(f"{name}: has {present[0]} but not {missing}; give all of {', '.join(names)}")
    return np.column_stack([values[part] for part in names])


def _measured(values: Mapping[str, FloatArray], rows: int, name: str) -> FloatArray:
    """Return the measurements (T, 12) in the file's axes; a z computed from a depth always points up."""
    measured = np.full((rows, len(CHANNELS)), np.nan)
    for index, channel in enumerate(CHANNELS):
        if channel in values:
            measured[:, index] = values[channel]
    if "depth" in values:
        if "z" in values:
            raise LogError(f"{name}: has z_m and depth_m; give one of the two")
        measured[:, 2] = -values["depth"]
    quaternion = _three(values, ("qw", "qx", "qy", "qz"), name)
    if quaternion is not None:
        if any(angle in values for angle in ("roll", "pitch", "yaw")):
            raise LogError(f"{name}: has a quaternion and angles; give one of the two")
        length = np.linalg.norm(quaternion, axis=1)
        wrong = np.flatnonzero(np.abs(length - 1.0) > 0.02)
        if wrong.size:
            raise LogError(
                f"{name}: the quaternion in row {wrong[0] + 1} has length {length[wrong[0]]:.4g}; it must be 1"
            )
        measured[:, 3:6] = frames.euler(quaternion)
    return measured


def _unwrapped(angles: FloatArray) -> FloatArray:
    """Return angles (T, 3) without jumps of a whole turn; rows without a measurement stay NaN."""
    done = angles.copy()
    for column in done.T:
        there = np.isfinite(column)
        column[there] = np.unwrap(column[there])
    return done
