"""Read ArduSub's DataFlash logs (`.BIN`) with pymavlink.

Messages: RCOU pulse widths; ATT attitude; IMU rates and specific force of the first sensor; XKF1 position and velocity of the first
core; CTUN altitude in logs without XKF1; BAT voltage of the first battery; MODE and ARM. Axes are NED and FRD.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from auvbench.dynamics import frames
from auvbench.errors import ConfigError, MissingExtraError
from auvbench.identification import csv_log, inputs
from auvbench.identification.log import Lasting, Log, LogError, Motors, longest_step
from auvbench.integrations.ardusub.frames import motors_of
from auvbench.integrations.ardusub.radio import MANUAL
from auvbench.untrusted import reading
from auvbench.untrusted.text import short
from auvbench.vehicles.vehicle_model import VehicleModel

HEAD = b"\xa3\x95\x80"
"""First bytes of each DataFlash file: the start of a message that describes other messages."""
CHANNELS = 14
"""Number of outputs in an RCOU message."""
FIELDS: Mapping[str, Mapping[str, str]] = {
    "RCOU": {f"C{k}": f"C{k}_us" for k in range(1, CHANNELS + 1)},
    "ATT": {"Roll": "roll_deg", "Pitch": "pitch_deg", "Yaw": "yaw_deg"},
    "IMU": {
        **{f"Gyr{axis}": f"{rate}_radps" for axis, rate in zip("XYZ", "pqr", strict=True)},
        **{f"Acc{axis}": f"a{axis.lower()}_mps2" for axis in "XYZ"},
    },
    "XKF1": {"PN": "x_m", "PE": "y_m", "PD": "z_m", "VN": "vn", "VE": "ve", "VD": "vd"},
    "CTUN": {"Alt": "altitude"},
    "BAT": {"Volt": "voltage_V"},
    "MODE": {},
    "ARM": {},
}
"""For each message that is read, its fields and the column that each field becomes."""
OPEN_LOOP = "open_loop"
"""Name of the column that is 1 while the vehicle is armed in MANUAL. It is 0 while a controller, a person or the deck may move the
vehicle."""
GYRO_FILTER = "INS_GYRO_FILTER"
"""Name of the parameter with the cutoff in Hz of the gyro's Butterworth filter of order 2, whose delay is sqrt(2) / (2 pi cutoff)."""
OFFSET = (math.inf, math.inf, 0.0, 0.003, 0.003, 0.0, 0.04, 0.04, 0.006, *(0.0025,) * 3)
DRIFT = (0.0, 0.0, 0.01, *(0.001,) * 3, 0.015, 0.015, 0.004, *(0.0005,) * 3)
"""Errors of ArduSub's estimate in a window of 2 s, one number per channel of a log, SI units: OFFSET is the standard deviation of the
constant error, DRIFT the standard deviation of the error's growth per s. The position over ground lags behind the velocity and is
not used.
"""
DEPTH_SCALE = 0.025
"""Relative difference between the densities of sea water and fresh water (ArduSub's parameter BARO_SPEC_GRAV)."""
FACTOR = 2.5
"""Value of `Lasting.factor`; docs/identification.md names the dives on which the value was chosen and the dives that tested it."""
INSTANCE = ("I", "Instance", "Inst", "C")
"""Fields with the number of a sensor or core; only number 0 is read."""


def read(path: Path, motors: Sequence[str] | None = None) -> list[Log]:
    """Return a list with the one log of a file; the axes in the file are always NED and FRD.

    Args:
        path: a file.
        motors: see `driven`.

    Raises:
        LogError: the file cannot be read, has no outputs of thrusters, or a check fails.
        MissingExtraError: pymavlink is not installed.
    """
    try:
        from pymavlink import DFReader
    except ImportError:
        raise MissingExtraError("pymavlink", extra="mavlink", purpose="DataFlash logs") from None
    try:
        data = reading.content(path, reading.DATA)
        if not data.startswith(HEAD):
            raise ValueError(f"it begins with {data[:3].hex() or 'nothing'}, not with {HEAD.hex()}")
        digest = sha256(data).hexdigest()
        # pymavlink prints a line for each damaged byte.
        with open(os.devnull, "w") as nowhere, redirect_stderr(nowhere), redirect_stdout(nowhere):
            rows = _rows(DFReader.DFReader_binary(str(path), zero_time_base=True))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:  # pymavlink raises exceptions of all kinds on damaged files
        raise LogError(f"{path}: not a DataFlash log: {short(error)}") from None
    if not any("C1_us" in row for row in rows):
        raise LogError(
            f"{path}: has no RCOU messages, the outputs of the thrusters; set LOG_BITMASK to log RC output"
        )
    return [driven(open_loop(rows, str(path), digest), motors)]


def open_loop(rows: list[dict[str, float]], name: str, digest: str) -> Log:
    """Return the log of the rows in which the vehicle is armed in MANUAL; of all rows if no row qualifies.

    Args:
        rows: rows of the log; a row has a value of `OPEN_LOOP` if the value is known.
        name: name of the file.
        digest: SHA-256 of the file.

    Raises:
        LogError: a check fails.
    """
    table = log_table(rows)
    lasting = _lasting(2.0 * _half_interval(rows))
    time = table["t_s"].to_numpy()
    used = np.ones(len(table), bool)
    if OPEN_LOOP in table:
        used = (table.pop(OPEN_LOOP).ffill() == 1.0).to_numpy(copy=True)
    if not used.any() or used.all():
        return replace(csv_log.parse(table, name, digest, "ned"), lasting=lasting)
    # No window may cross rows that are left out, so each left-out part must be long enough to be a gap.
    pause = 1.01 * longest_step(time)
    for left in time[1:][used[:-1] & ~used[1:]]:
        used &= (time < left) | (time > left + pause)
    left_out = float(np.diff(time, append=time[-1])[~used].sum())
    remark = f"{left_out:.0f} s in other modes than MANUAL, or disarmed, are not used"
    try:
        log = csv_log.parse(table[used].reset_index(drop=True), name, digest, "ned")
    except LogError as error:
        raise LogError(f"{error} ({remark})") from None
    return replace(log, remarks=(*log.remarks, f"{name}: {remark}"), lasting=lasting)


def driven(log: Log, names: Sequence[str] | None) -> Log:
    """Return the log with a function that finds which thrusters of a vehicle the columns C1, C2, ... (ArduSub's motors) drive.

    Args:
        log: log of an ArduSub.
        names: thruster names in the order of the motors, with `-` before a reversed thruster; None: match a frame by direction.
    """

    def motors(vehicle: VehicleModel) -> Motors:
        try:
            return motors_of(vehicle, names)
        except ConfigError as error:
            raise ConfigError(str(error).replace("--motors", "motors")) from None

    return replace(log, motors=motors)


def _rows(log: Any) -> list[dict[str, float]]:
    """Return one row for each message of a kind in `FIELDS`, with the message's time and columns."""
    rows: list[dict[str, float]] = []
    mode = armed = math.nan
    late = 0.0
    while (message := log.recv_match(type=["PARM", *FIELDS])) is not None:
        kind = message.get_type()
        if kind == "PARM":
            if message.Name == GYRO_FILTER and message.Value > 0.0:
                late = math.sqrt(2.0) / (2.0 * math.pi * message.Value)
            continue
        if kind != "ATT" and any(getattr(message, name, 0) for name in INSTANCE if kind != "RCOU"):
            continue
        row = {"t_s": round(1e-6 * float(message.TimeUS) - (late if kind == "IMU" else 0.0), 6)}
        if kind == "MODE":
            mode = float(message.ModeNum)
        elif kind == "ARM":
            if math.isnan(armed) and message.ArmState:
                rows = [{**row, OPEN_LOOP: 0.0} for row in rows]  # disarmed until now
            armed = float(message.ArmState)
        if not math.isnan(mode):
            row[OPEN_LOOP] = float(mode == MANUAL and armed != 0.0)
        for field, column in FIELDS[kind].items():
            value = getattr(message, field, None)
            if value is not None:
                row[column] = float(value)
        rows.append(row)
    return rows


def log_table(rows: list[dict[str, float]]) -> pd.DataFrame:
    """Return the table for `csv_log`: one row per time, from the first output on; each output is held until the next one.

    The autopilot changes its outputs more often than it logs them. A logged output began at an unknown time since the previous
    entry, on average half an interval before its own entry. Its time is therefore moved back by half an interval.
    """
    ago = _half_interval(rows)
    rows = [_moved(row, ago) if "C1_us" in row else row for row in rows]
    table = pd.DataFrame(rows).groupby("t_s", as_index=False).first().sort_values("t_s")
    outputs = [name for name in FIELDS["RCOU"].values() if name in table]
    # An output that is always 0 is not in use.
    table = table.drop(columns=[name for name in outputs if not table[name].fillna(0.0).any()])
    # An output without a pulse gives no thrust, as the neutral pulse does.
    outputs = [name for name in outputs if name in table]
    table[outputs] = table[outputs].replace(0.0, inputs.NEUTRAL)
    held = [name for name in (*outputs, "voltage_V") if name in table]
    table[held] = table[held].ffill()
    if "voltage_V" in table:
        table["voltage_V"] = table["voltage_V"].bfill()
    used = [name for name in outputs if name in table]
    table = table[table[used].notna().all(axis=1)].reset_index(drop=True)
    if "yaw_deg" in table:
        there = table["yaw_deg"].notna()
        table.loc[there, "yaw_deg"] = np.degrees(np.unwrap(np.radians(table.loc[there, "yaw_deg"])))
    if "x_m" in table:
        table = (_with_body_velocity(table) if "vn" in table else table).drop(
            columns="altitude", errors="ignore"
        )
    elif "altitude" in table:
        table["depth_m"] = -table.pop("altitude")
    return table


def _half_interval(rows: list[dict[str, float]]) -> float:
    """Return half of the median time in s between two consecutive logged outputs."""
    sampled = np.array([row["t_s"] for row in rows if "C1_us" in row])
    return 0.5 * float(np.median(np.diff(sampled))) if sampled.size > 1 else 0.0


def _lasting(interval: float) -> Lasting:
    """Return the errors of ArduSub's estimate, and of outputs that are logged every `interval` s.

    The time error of one output is uniform within plus or minus half an interval. The common time error of all outputs is
    uniform within plus or minus a quarter of an interval.
    """
    return Lasting(
        offset=np.array(OFFSET),
        drift=np.array(DRIFT),
        early=interval / math.sqrt(12.0),
        all_early=0.5 * interval / math.sqrt(12.0),
        depth_scale=DEPTH_SCALE,
        factor=FACTOR,
    )


def _moved(row: dict[str, float], ago: float) -> dict[str, float]:
    """Return the row of an output, moved `ago` s back in time, without `OPEN_LOOP`: other rows have the right `OPEN_LOOP` for that time."""
    kept = {name: value for name, value in row.items() if name != OPEN_LOOP}
    return {**kept, "t_s": round(row["t_s"] - ago, 6)}


def _with_body_velocity(table: pd.DataFrame) -> pd.DataFrame:
    """Return the table with the velocity over ground rotated from world axes to body axes by the interpolated attitude."""
    there = table["vn"].notna().to_numpy()
    time = table["t_s"].to_numpy()
    angles = []
    for name in ("roll_deg", "pitch_deg", "yaw_deg"):
        known = table[name].notna().to_numpy() if name in table else np.zeros(len(table), bool)
        values = np.radians(table[name].to_numpy()[known]) if known.any() else np.zeros(1)
        angles.append(np.interp(time[there], time[known] if known.any() else np.zeros(1), values))
    R = frames.rotation(frames.quaternion(np.stack(angles, axis=-1)))
    velocity = np.einsum("tji,tj->ti", R, table.loc[there, ["vn", "ve", "vd"]].to_numpy(dtype=np.float64))
    for column, name in enumerate(("u_mps", "v_mps", "w_mps")):
        table.loc[there, name] = velocity[:, column]
    return table.drop(columns=["vn", "ve", "vd"])
