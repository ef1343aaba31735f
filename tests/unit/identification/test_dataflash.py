"""ArduSub's DataFlash logs, of a file that is written here byte by byte."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from auvbench.identification import inputs, readers
from auvbench.identification.log import LogError
from auvbench.vehicles import sheet

pytest.importorskip("pymavlink")

MESSAGES = {  # name: type, formats, columns
    "RCOU": (130, "Q" + "H" * 8, "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
    "ATT": (131, "Qfff", "TimeUS,Roll,Pitch,Yaw"),
    "IMU": (132, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "XKF1": (133, "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD"),
    "BAT": (134, "QBf", "TimeUS,Inst,Volt"),
}
HEAD = b"\xa3\x95"


def formats(names: tuple[str, ...]) -> bytes:
    data = b""
    described = {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"), **MESSAGES}
    for name in ("FMT", *names):
        kind, types, columns = described[name]
        length = 89 if name == "FMT" else 3 + struct.calcsize("<" + types)
        fields = kind, length, name.encode(), types.encode(), columns.encode()
        data += HEAD + bytes([128]) + struct.pack("<BB4s16s64s", *fields)
    return data


def message(name: str, *values: float) -> bytes:
    kind, types, _ = MESSAGES[name]
    return HEAD + bytes([kind]) + struct.pack("<" + types, *values)


def write(path: Path, names: tuple[str, ...] = tuple(MESSAGES), seconds: float = 5.0) -> None:
    """Write a log of a vehicle that heads east and goes ahead at 0.5 m/s, nose up by 10 degrees."""
    data = formats(names)
    for k in range(round(50 * seconds)):
        us = 1_000_000 + 20_000 * k
        pulses = [1500 + 10 * n + (k // 25 % 2) for n in range(1, 7)]
        rows = {
            "RCOU": [us, *pulses, 1100, 0],
            "ATT": [us, 1.0 + 1e-3 * k, 10.0 + 1e-3 * k, (359.0 + k) % 360.0],
            "IMU": [us, 0, 0.1, 0.2, np.radians(50.0), 0.0, 0.0, -9.81],
            "XKF1": [us, 0, 0.0, 0.5, 0.0, 1.0 + 1e-4 * k, 0.01 * k, 2.0 + 0.001 * k],
            "BAT": [us, 0, 15.5],
        }
        for name in names:
            data += message(name, *rows[name])
            if name in ("IMU", "XKF1"):  # The second sensor is not read.
                data += message(name, us, 1, *([9.0] * 6))
    path.write_bytes(data)


def test_messages_become_channels_in_auvbenchs_axes(tmp_path: Path) -> None:
    write(tmp_path / "dive.BIN")
    (log,) = readers.read([str(tmp_path / "dive.BIN")])
    assert log.kind == "pwm"
    assert log.duration == pytest.approx(4.98)
    row = log.measured[0]
    np.testing.assert_allclose(row[:3], [1.0, 0.0, -2.0], atol=1e-6)
    np.testing.assert_allclose(row[3:5], np.radians([1.0, -10.0]), atol=1e-6)
    assert log.measured[-1, 5] - row[5] == pytest.approx(-np.radians(249.0), abs=1e-4)
    heading_east = log.measured[91]  # 359 + 91 degrees
    assert heading_east[6] == pytest.approx(0.5 * np.cos(np.radians(10.0)), abs=1e-3)
    assert heading_east[8] == pytest.approx(-0.5 * np.sin(np.radians(10.0)), abs=0.02)
    assert log.voltage is not None
    assert log.voltage[0] == pytest.approx(15.5)
    vehicle = sheet.load("bluerov2_2026")
    # Output 7 is constant, output 8 is not in use: the vehicle has six thrusters.
    assert inputs.quantities(log, vehicle).shape == (250, 6)


def test_a_log_without_outputs_says_what_to_set(tmp_path: Path) -> None:
    write(tmp_path / "dive.BIN", ("ATT", "IMU"))
    with pytest.raises(LogError, match="has no RCOU messages, the outputs of the thrusters; set LOG_BITMASK"):
        readers.read([str(tmp_path / "dive.BIN")])


@pytest.mark.parametrize("content", [b"", b"hello", b"\xa3\x95" * 1000])
def test_another_file_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "dive.BIN").write_bytes(content)
    with pytest.raises(LogError):
        readers.read([str(tmp_path / "dive.BIN")])
