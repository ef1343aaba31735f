"""DataFlash logs of ArduSub, written as ArduPilot's AP_Logger does: packets that begin with A3 95 and a number of their format."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.commands.identify import motors
from auvbench.errors import ConfigError
from auvbench.identification import inputs, readers
from auvbench.identification.log import CHANNELS, LogError
from auvbench.vehicles import sheet

pytest.importorskip("pymavlink")

TIME = 0.05 * np.arange(101)
FORMATS = {
    "RCOU": (1, "QHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6"),
    "ATT": (2, "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "IMU": (3, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "CTUN": (4, "Qf", "TimeUS,Alt"),
    "BAT": (5, "QBf", "TimeUS,Inst,Volt"),
    "MODE": (6, "QBBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ARM": (7, "QB", "TimeUS,ArmState"),
    "PARM": (8, "QNff", "TimeUS,Name,Value,Default"),
}
"""number, types and labels of messages"""


def packet(name: str, *values: float) -> bytes:
    number, types, _ = FORMATS[name]
    whole = (int(v) if kind in "QBH" else v for v, kind in zip(values, types, strict=True))
    return bytes((0xA3, 0x95, number)) + struct.pack(f"<{types}", *whole)


def written(without: str = "", changes: Mapping[float, tuple[str, int]] | None = None) -> bytes:
    """Return a file in which yaw turns, and each message but `without` comes.

    `changes` are modes and states of arming by the time in s from which they hold.
    """
    data = b""
    for name, (number, types, labels) in {
        "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
        **FORMATS,
    }.items():
        size = 89 if name == "FMT" else 3 + struct.calcsize(f"<{types.replace('N', '16s')}")
        texts = (name.encode(), types.encode(), labels.encode())
        data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, size, *texts)
    for t in TIME:
        us = 1e6 * t + 1e6
        if what := (changes or {}).get(round(t, 2)):
            kind, number = what
            data += packet(kind, us, *((number, number, 0) if kind == "MODE" else (number,)))
        pulse = 1600 if t % 2.0 < 1.0 else 1400
        rows = {
            "RCOU": (us, *[pulse] * 6),
            "ATT": (us, 0.0, 0.0, (170.0 + np.degrees(0.5 * np.sin(t)) + 180.0) % 360.0 - 180.0),
            "CTUN": (us, -0.1 * t),
            "BAT": (us, 0, 15.5),
        }
        data += b"".join(packet(name, *row) for name, row in rows.items() if name != without)
        for sensor, rate in ((0, 0.5 * np.cos(t)), (1, 9.0)):
            data += packet("IMU", us, sensor, 0.0, 0.0, rate, 0.0, 0.0, -9.8)
    return data


def test_messages_become_columns(tmp_path: Path) -> None:
    file = tmp_path / "dive.BIN"
    file.write_bytes(written())
    [log] = readers.read([str(file)])
    # An output holds from the middle between it and the one before: half of 0.05 s earlier than it was logged.
    np.testing.assert_allclose(log.time[::2], TIME, atol=1e-6)
    np.testing.assert_allclose(log.time[1::2], TIME + 0.025, atol=1e-6)
    assert log.kind == "pwm"
    np.testing.assert_array_equal(log.inputs[::2, 5], np.where(TIME % 2.0 < 1.0, 1600.0, 1400.0))
    np.testing.assert_allclose(log.measured[1::2, CHANNELS.index("z")], -0.1 * TIME, atol=1e-5)
    np.testing.assert_allclose(log.measured[1::2, CHANNELS.index("r")], -0.5 * np.cos(TIME), atol=1e-6)
    yaw = log.measured[1::2, CHANNELS.index("yaw")]
    np.testing.assert_allclose(yaw - yaw[0], -0.5 * np.sin(TIME), atol=1e-4)
    assert log.voltage is not None
    assert np.all(log.voltage == 15.5)


def test_rates_come_before_the_delay_of_their_filter(tmp_path: Path) -> None:
    file = tmp_path / "dive.BIN"
    data, first = written(), packet("RCOU", 1e6, *[1600] * 6)
    at = data.index(first)
    parameter = bytes((0xA3, 0x95, 8)) + struct.pack("<Q16sff", 900_000, b"INS_GYRO_FILTER", 20.0, 20.0)
    file.write_bytes(data[:at] + parameter + data[at:])
    [log] = readers.read([str(file)])
    rates = log.time[np.isfinite(log.measured[:, CHANNELS.index("r")])]
    turns = log.time[np.isfinite(log.measured[:, CHANNELS.index("yaw")])]
    # Two poles of a Butterworth filter at 20 Hz.
    np.testing.assert_allclose(turns[-1] - rates[-1], 0.01125, atol=1e-5)
    # Outputs every 0.05 s begin at an unknown time between two of them.
    assert log.lasting is not None
    assert log.lasting.early == pytest.approx(0.05 / 12.0**0.5)


def test_only_the_time_in_manual_is_used(tmp_path: Path) -> None:
    path = tmp_path / "dive.BIN"
    path.write_bytes(written(changes={0.0: ("MODE", 2), 1.0: ("MODE", 19), 1.5: ("ARM", 1), 4.5: ("ARM", 0)}))
    (log,) = readers.read([path])
    # What comes before the first arming is disarmed.
    assert log.duration == pytest.approx(3.0, abs=0.06)
    assert log.remarks[-1].endswith("2 s in other modes than MANUAL, or disarmed, are not used")
    # A visit of half a second ends a segment, as a gap does.
    path.write_bytes(written(changes={0.0: ("MODE", 19), 2.0: ("MODE", 2), 2.5: ("MODE", 19)}))
    (log,) = readers.read([path])
    assert len(log.segments) == 2
    assert log.duration == pytest.approx(5.0 - 1.0, abs=0.15)
    path.write_bytes(written(changes={0.0: ("MODE", 19), 1.5: ("MODE", 2)}))
    with pytest.raises(LogError, match=r"needs at least 2 s.*\(4 s in other modes than MANUAL"):
        readers.read([path])
    # Of a log without MANUAL everything is used: its gate is the commands' correlation with the motion.
    path.write_bytes(written(changes={0.0: ("MODE", 2)}))
    (log,) = readers.read([path])
    assert log.duration == pytest.approx(5.025)
    assert not any("MANUAL" in remark for remark in log.remarks)


def test_outputs_drive_the_motors_of_a_frame(tmp_path: Path) -> None:
    file = tmp_path / "dive.BIN"
    file.write_bytes(written())
    for given in ({}, {"motors": "-thruster1,-thruster2,thruster3,thruster4,-thruster5,thruster6"}):
        [log] = readers.read([str(file)], motors=motors(given))
        vehicle = sheet.load("bluerov2_2026")
        values = inputs.quantities(log, vehicle)
        # As ArduSub's frame "vectored" drives them: motors 1, 2 and 5 push against the sheet's directions.
        force = inputs.at_voltage((log.inputs[:, 0] - 1500.0) / 400.0, 15.5)
        np.testing.assert_allclose(values, np.outer(force, (-1, -1, 1, 1, -1, 1)), rtol=1e-6)
    [log] = readers.read([str(file)], motors=motors({}))
    with pytest.raises(ConfigError, match=r"name them in the order of ArduSub's motors .*: motors=thruster"):
        inputs.quantities(log, sheet.load("rexrov"))
    with pytest.raises(LogError, match="has no output C7; bluerov2_heavy_2026 has 8 thrusters"):
        inputs.quantities(log, sheet.load("bluerov2_heavy_2026"))


def test_damaged_files_get_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "dive.bin"
    for data, message in (
        (b"", "it begins with nothing"),
        (bytes(range(256)) * 20, "it begins with 000102"),
        (b"\xa3\x95\x80" + bytes(2000), "has no RCOU messages"),
        (written("RCOU"), "has no RCOU messages"),
    ):
        file.write_bytes(data)
        assert main(["identify", str(file), "vehicle=bluerov2_2026"]) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1, error
    # What is damaged in the middle is skipped.
    good = written()
    file.write_bytes(good[:3000] + bytes(50) + good[3050:])
    [log] = readers.read([str(file)])
    assert log.time.size > 90
    assert capsys.readouterr().err == ""
