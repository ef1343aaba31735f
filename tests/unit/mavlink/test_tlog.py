"""Telemetry logs of ArduSub, written with pymavlink."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvbench.cli import main
from auvbench.identification import readers
from auvbench.identification.log import CHANNELS, LogError

mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")

STEP, ROWS = 0.05, 101
BOOT, CLOCK = 4290.0, 1.7e9
"""Time of the autopilot at the first row, near the overflow of 32 bits of us, and of the computer, s."""
TIME = STEP * np.arange(ROWS)
YAW = 3.0 + 0.5 * np.sin(TIME)


def packets(k: int, dvl: bool, position: bool, manual: tuple[float, float] = (0.0, 0.0)) -> list[Any]:
    t = TIME[k]
    base, custom = (128, 19) if manual[0] <= t < manual[1] else (0, 2)
    ms, us = round(1e3 * (BOOT + t)), round(1e6 * (BOOT + t))
    yaw = (YAW[k] + np.pi) % (2.0 * np.pi) - np.pi
    pulses = [1500 + (100 if t % 2.0 < 1.0 else -100) * (j < 6) for j in range(8)]
    made = [
        mavlink.MAVLink_attitude_message(ms, 0.0, 0.1, yaw, 0.0, 0.0, 0.5 * np.cos(t)),
        mavlink.MAVLink_servo_output_raw_message(us % 2**32, 0, *pulses),
        mavlink.MAVLink_servo_output_raw_message(us % 2**32, 1, *[999] * 8),
        mavlink.MAVLink_raw_imu_message(us, 0, 0, -1000, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_scaled_imu2_message(ms, 0, 0, -500, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_scaled_pressure2_message(ms, 1013.25 + 98.0665 * 0.1 * t, 0.0, 2000),
        mavlink.MAVLink_heartbeat_message(12, 3, base, custom, 4, 3),
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    ]
    if k % 10 == 0:
        volts = [15800, *[65535] * 9]
        made.append(mavlink.MAVLink_battery_status_message(0, 1, 1, 2000, volts, 100, 0, 0, 90))
    if position:
        made.append(mavlink.MAVLink_local_position_ned_message(ms, 2.0 * t, t, 5.0, 2.0, 1.0, 0.0))
    if dvl:
        made.append(
            mavlink.MAVLink_vision_position_delta_message(
                123, 50_000, [0.0] * 3, [0.05 * t, 0.01, -0.02], 90.0
            )
        )
    return made


def write(
    path: Path,
    *,
    dvl: bool = False,
    position: bool = False,
    drop: str = "",
    shift: float = 0.0,
    manual: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Write a log; `drop` is a message that is left out, `shift` in s what the autopilot's clock loses in mid-log."""
    vehicle, station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)
    data = b""
    for k in range(ROWS):
        stamp = struct.pack(">Q", round(1e6 * (CLOCK + TIME[k])))
        for message in packets(k, dvl, position, manual):
            if message.get_type() == drop:
                continue
            if hasattr(message, "time_boot_ms") and k > ROWS // 2:
                message.time_boot_ms -= round(1e3 * shift)
            data += stamp + message.pack(vehicle)
        data += stamp + mavlink.MAVLink_attitude_message(1, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0).pack(station)
        if k == 7:
            data += b"\xfd\xff\x00"  # a damaged packet
    path.write_bytes(data)


def column(log: Any, name: str) -> Any:
    values = log.measured[:, CHANNELS.index(name)]
    return log.time[np.isfinite(values)], values[np.isfinite(values)]


def test_messages_become_columns(tmp_path: Path) -> None:
    write(tmp_path / "dive.tlog")
    [log] = readers.read([str(tmp_path / "dive.tlog")])
    assert (log.kind, log.actuators) == ("pwm", tuple(f"C{k}" for k in range(1, 9)))
    # Outputs, half an interval before they were logged, and then measurements.
    np.testing.assert_allclose(log.time[::2], TIME, atol=1e-9)
    np.testing.assert_allclose(log.time[1::2], TIME + 0.5 * STEP, atol=1e-9)
    np.testing.assert_array_equal(log.inputs[::2, 0], np.where(TIME % 2.0 < 1.0, 1600.0, 1400.0))
    assert np.all(log.inputs[:, 7] == 1500.0)
    # Yaw and its rate are positive to starboard in the file, to port here; roll never changes.
    np.testing.assert_allclose(np.diff(column(log, "yaw")[1]), -np.diff(YAW), atol=1e-5)
    np.testing.assert_allclose(column(log, "r")[1], -0.5 * np.cos(TIME), atol=1e-6)
    np.testing.assert_allclose(column(log, "z")[1], -0.1 * TIME, atol=1e-4)
    assert log.acceleration is not None
    np.testing.assert_allclose(log.acceleration[1::2], [[0.0, 0.0, 9.80665]] * ROWS, atol=1e-9)
    assert log.voltage is not None
    assert np.all(log.voltage == 15.8)
    assert not log.has("x")


def test_only_the_time_in_manual_is_used(tmp_path: Path) -> None:
    write(tmp_path / "dive.tlog", manual=(1.0, 4.0))
    [log] = readers.read([str(tmp_path / "dive.tlog")])
    assert log.duration == pytest.approx(3.0, abs=0.1)
    assert log.remarks[-1].endswith("2 s in other modes than MANUAL, or disarmed, are not used")


@pytest.mark.parametrize("dvl", [False, True])
def test_velocity_is_that_of_the_dvl_or_of_the_position(tmp_path: Path, dvl: bool) -> None:
    write(tmp_path / "dive.tlog", dvl=dvl, position=True)
    [log] = readers.read([str(tmp_path / "dive.tlog")])
    np.testing.assert_allclose(column(log, "x")[1], 2.0 * TIME, atol=1e-5)
    np.testing.assert_allclose(column(log, "y")[1], -TIME, atol=1e-5)
    forward = TIME if dvl else (2.0 * np.cos(YAW) + np.sin(YAW)) * np.cos(0.1)
    np.testing.assert_allclose(column(log, "u")[1], forward, atol=1e-5)


def test_damage_and_bad_logs_get_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "dive.tlog"
    for words, message in (
        ({"drop": "SERVO_OUTPUT_RAW"}, "has no SERVO_OUTPUT_RAW messages, the outputs of the thrusters"),
        ({"drop": "ATTITUDE", "shift": 3.0}, "the autopilot restarts 429"),
    ):
        write(file, **words)  # type: ignore[arg-type]
        with pytest.raises(LogError) as raised:
            readers.read([str(file)])
        assert message in str(raised.value)
    for data in (b"", b"\xfd" * 1000, bytes(range(256)) * 40):
        file.write_bytes(data)
        assert main(["identify", str(file), "vehicle=bluerov2_2026"]) == 2
        error = capsys.readouterr().err
        assert "not a telemetry log" in error
        assert error.count("\n") == 1


def test_rare_outputs_get_a_remark(tmp_path: Path) -> None:
    data = b""
    vehicle = mavlink.MAVLink(None, 1, 1)
    for k in range(ROWS):
        for message in packets(k, False, False)[: 2 if k % 10 == 0 else 1]:
            data += struct.pack(">Q", round(1e6 * (CLOCK + TIME[k]))) + message.pack(vehicle)
    (tmp_path / "dive.tlog").write_bytes(data)
    [log] = readers.read([str(tmp_path / "dive.tlog")])
    assert "has the outputs of the thrusters only every 0.5 s; set SR0_RC_CHAN=20" in log.remarks[-1]
