"""Read telemetry logs of ArduSub (`.tlog`) with pymavlink.

Messages: SERVO_OUTPUT_RAW pulse widths; ATTITUDE attitude and rates; RAW_IMU, or else SCALED_IMU2, specific force;
LOCAL_POSITION_NED position and velocity; SCALED_PRESSURE2 depth in logs without position; VISION_POSITION_DELTA velocity of a
DVL, in place of the velocity of LOCAL_POSITION_NED; BATTERY_STATUS voltage of the first battery; HEARTBEAT mode. Axes are NED and FRD.

In the file, eight bytes before each MAVLink packet contain the time in us at which the computer received the packet.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from auvbench.errors import MissingExtraError
from auvbench.identification.log import Log, LogError
from auvbench.integrations.ardusub.radio import MANUAL
from auvbench.integrations.mavlink import dataflash
from auvbench.untrusted import reading

MILLI_G = 9.80665e-3
FIELDS: Mapping[str, Mapping[str, tuple[str, float]]] = {
    "SERVO_OUTPUT_RAW": {f"servo{k}_raw": (f"C{k}_us", 1.0) for k in range(1, dataflash.CHANNELS + 1)},
    "ATTITUDE": {
        **{name: (f"{name}_deg", 180.0 / np.pi) for name in ("roll", "pitch", "yaw")},
        **{
            f"{name}speed": (f"{rate}_radps", 1.0)
            for name, rate in zip(("roll", "pitch", "yaw"), "pqr", strict=True)
        },
    },
    **{
        name: {f"{axis}acc": (f"a{axis}_mps2", MILLI_G) for axis in "xyz"}
        for name in ("RAW_IMU", "SCALED_IMU2")
    },
    "LOCAL_POSITION_NED": {
        **{axis: (f"{axis}_m", 1.0) for axis in "xyz"},
        **{f"v{axis}": (f"v{name}", 1.0) for axis, name in zip("xyz", "ned", strict=True)},
    },
    "SCALED_PRESSURE2": {"press_abs": ("pressure", 100.0)},
    "VISION_POSITION_DELTA": {},
    "BATTERY_STATUS": {},
    "HEARTBEAT": {},
}
"""For each message that is read, its fields, each with the column that the field becomes and the factor to the column's unit."""
WATER = 9.80665e3
"""Pressure increase with depth in fresh water, Pa/m; depths are measured from the shallowest point of the log."""
RARE = 0.2
"""Largest interval in s between the logged outputs of the thrusters for which `read` adds no remark."""
_WRAP = 2.0**32 * 1e-6
"""Period in s after which the time of SERVO_OUTPUT_RAW restarts at 0."""
_NO_VOLTAGE = 65535


def read(path: Path, motors: Sequence[str] | None = None) -> list[Log]:
    """Return a list with the one log of a file; the axes in the file are always NED and FRD.

    Args:
        path: a file.
        motors: see `dataflash.driven`.

    Raises:
        LogError: the file cannot be read, has no outputs of thrusters, or a check fails.
        MissingExtraError: pymavlink is not installed.
    """
    try:
        from pymavlink.dialects.v20 import ardupilotmega as mavlink
    except ImportError:
        raise MissingExtraError("pymavlink", extra="mavlink", purpose="telemetry logs") from None
    try:
        data = reading.content(path, reading.DATA)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise LogError(f"{path}: not a telemetry log: {error}") from None
    messages = list(_messages(data, mavlink))
    if not messages:
        raise LogError(f"{path}: not a telemetry log: it has none of the messages {', '.join(FIELDS)}")
    rows = _rows(messages, mavlink, str(path))
    if not any("C1_us" in row for row in rows):
        raise LogError(
            f"{path}: has no SERVO_OUTPUT_RAW messages, the outputs of the thrusters; set SR0_RC_CHAN=20 and record again"
        )
    log = dataflash.open_loop(rows, str(path), sha256(data).hexdigest())
    return [dataflash.driven(_with_remark(log, rows), motors)]


def _messages(data: bytes, mavlink: Any) -> Iterator[tuple[float, Any]]:
    """Yield the time of reception in s and the message, for each message of a kind in `FIELDS`; skip damaged bytes."""
    decoder = mavlink.MAVLink(None)
    wanted = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in FIELDS}
    at, end = 0, len(data) - 16
    while at <= end:
        head = data[at + 8 : at + 18]
        if head[0] == mavlink.PROTOCOL_MARKER_V1:
            size, number = 8 + head[1], head[5]
        elif head[0] == mavlink.PROTOCOL_MARKER_V2 and len(head) == 10:
            size = 12 + head[1] + (13 if head[2] & 1 else 0)  # 13 bytes of a signature
            number = int.from_bytes(head[7:10], "little")
        else:
            at += 1
            continue
        if number in wanted:
            try:
                message = decoder.decode(bytearray(data[at + 8 : at + 8 + size]))
            except (mavlink.MAVError, struct.error):
                at += 1
                continue
            yield 1e-6 * int.from_bytes(data[at : at + 8], "big"), message
        at += 8 + size


def _rows(messages: list[tuple[float, Any]], mavlink: Any, name: str) -> list[dict[str, float]]:
    """Return one row, with its time, for each message of the autopilot that sends SERVO_OUTPUT_RAW.

    Raises:
        LogError: the autopilot restarts.
    """
    kinds = {message.get_type() for _, message in messages}
    system = next((m.get_srcSystem() for _, m in messages if m.get_type() == "SERVO_OUTPUT_RAW"), None)
    left_out = {"SCALED_IMU2"} if "RAW_IMU" in kinds else set()
    booted = next((at - 1e-3 * m.time_boot_ms for at, m in messages if hasattr(m, "time_boot_ms")), 0.0)
    latest, state = -np.inf, 0.0
    rows: list[dict[str, float]] = []
    known = 0
    for received, message in messages:
        kind = message.get_type()
        if kind in left_out or (message.get_srcSystem() != system and kind != "VISION_POSITION_DELTA"):
            continue
        if kind == "HEARTBEAT":
            if message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED > 0
                before, state = state, float(armed and message.custom_mode == MANUAL)
                # Rows between two heartbeats are open loop only if both heartbeats report an armed vehicle in MANUAL.
                for row in rows[known:]:
                    row[dataflash.OPEN_LOOP] = min(before, state)
                known = len(rows)
            continue
        time = received - booted
        if hasattr(message, "time_boot_ms"):
            time = 1e-3 * message.time_boot_ms
            if time < latest - 1.0:
                raise LogError(
                    f"{name}: the autopilot restarts {latest:.0f} s after its start; split the file at this time, one file for each start"
                )
            latest = max(latest, time)
        elif kind in ("SERVO_OUTPUT_RAW", "RAW_IMU"):
            clock = 1e-6 * message.time_usec
            time = clock + _WRAP * round((time - clock) / _WRAP)
        if values := _values(kind, message, "VISION_POSITION_DELTA" in kinds):
            rows.append({"t_s": round(time, 6), dataflash.OPEN_LOOP: 0.0, **values})
    surface = max((row["altitude"] for row in rows if "altitude" in row), default=0.0)
    return [{**row, "altitude": row["altitude"] - surface} if "altitude" in row else row for row in rows]


def _values(kind: str, message: Any, dvl: bool) -> dict[str, float]:
    """Return the measurements of a message by column; empty for a failed measurement or another port or battery than the first."""
    if kind == "SERVO_OUTPUT_RAW" and message.port != 0:
        return {}
    if kind == "BATTERY_STATUS":
        cells = [volts for volts in message.voltages if volts != _NO_VOLTAGE]
        return {"voltage_V": 1e-3 * sum(cells)} if cells and message.id == 0 else {}
    if kind == "VISION_POSITION_DELTA":
        seconds = 1e-6 * message.time_delta_usec
        if seconds <= 0.0 or message.confidence <= 0.0:
            return {}
        return {
            f"{axis}_mps": float(moved) / seconds
            for axis, moved in zip("uvw", message.position_delta, strict=True)
        }
    values = {
        column: factor * float(getattr(message, field)) for field, (column, factor) in FIELDS[kind].items()
    }
    if "pressure" in values:
        return {"altitude": -values["pressure"] / WATER}
    if dvl:
        values = {column: value for column, value in values.items() if column not in ("vn", "ve", "vd")}
    return values


def _with_remark(log: Log, rows: list[dict[str, float]]) -> Log:
    """Return the log, with a remark if the interval between its outputs is longer than `RARE` s."""
    times = np.array([row["t_s"] for row in rows if "C1_us" in row])
    interval = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    if interval <= RARE:
        return log
    remark = f"{log.name}: has the outputs of the thrusters only every {interval:.2g} s; set SR0_RC_CHAN=20 for 20 Hz, or use the .BIN"
    return replace(log, remarks=(*log.remarks, remark))
