"""The bytes of ArduPilot's JSON backend."""

import json
import math
import struct
import subprocess
import sys
from dataclasses import replace

import pytest

from auvbench.integrations.ardusub import protocol
from auvbench.integrations.ardusub.protocol import PacketError, SensorState

STATE = SensorState(
    time=12.5,
    gyro=(0.1, -0.2, 0.3),
    specific_force=(0.0, 1e-7, -9.80665),
    position=(1.0, -2.0, 20.0),
    velocity=(0.25, 0.5, -0.75),
    quaternion=(0.8, 0.0, 0.6, 0.0),
    voltage=16.0,
    current=3.25,
)


@pytest.mark.parametrize(("magic", "channels"), [(18458, 16), (29569, 32)])
def test_a_packet_is_read_as_ardupilot_writes_it(magic, channels):
    pwm = tuple(range(1100, 1100 + channels))
    packet = protocol.parse(struct.pack(f"<HHI{channels}H", magic, 1200, 4_000_000_000, *pwm))
    assert (packet.frame_rate, packet.frame_count, packet.pwm) == (1200, 4_000_000_000, pwm)
    assert packet.duration == 1 / 1200


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\x1a",
        struct.pack("<HHI16H", 18459, 400, 0, *[1500] * 16),
        struct.pack("<HHI16H", 29569, 400, 0, *[1500] * 16),
        struct.pack("<HHI32H", 18458, 400, 0, *[1500] * 32),
        struct.pack("<HHI16H", 18458, 400, 0, *[1500] * 16)[:-1],
        struct.pack("<HHI16H", 18458, 0, 0, *[1500] * 16),
        struct.pack("<HHI16H", 18458, 10, 0, *[1500] * 16),
        b'\n{"timestamp":1}\n',
    ],
    ids=["empty", "a byte", "magic", "32 in 40 bytes", "16 in 72 bytes", "cut", "no rate", "0.1 s", "JSON"],
)
def test_other_datagrams_are_refused(datagram):
    with pytest.raises(PacketError):
        protocol.parse(datagram)


def test_a_reply_is_one_line_with_the_fields_of_the_readme():
    line = protocol.reply(STATE)
    assert line.startswith(b"\n{")
    assert line.endswith(b"}\n")
    assert line.count(b"\n") == 2
    assert json.loads(line) == {
        "timestamp": 12.5,
        "imu": {"gyro": [0.1, -0.2, 0.3], "accel_body": [0.0, 1e-7, -9.80665]},
        "position": [1.0, -2.0, 20.0],
        "velocity": [0.25, 0.5, -0.75],
        "quaternion": [0.8, 0.0, 0.6, 0.0],
        "battery": {"voltage": 16.0, "current": 3.25},
    }


def test_ardupilots_search_by_substring_finds_the_right_places():
    """SIM_JSON.cpp takes the first occurrence of a section's name, then of the key's, and what follows two characters later."""
    text = protocol.reply(STATE).decode()
    for section, key, start in (
        ("", "timestamp", "12.5"),
        ("imu", "gyro", "[0.1"),
        ("imu", "accel_body", "[0.0"),
        ("", "position", "[1.0"),
        ("", "velocity", "[0.25"),
        ("", "quaternion", "[0.8"),
        ("battery", "voltage", "16.0"),
        ("battery", "current", "3.25"),
    ):
        behind = text[text.index(section) + len(section) + 1 :]
        assert behind[behind.index(key) + len(key) + 2 :].startswith(start), key
    for absent in ("attitude", "rng_1", "velocity_wind", "windvane", "airspeed", "no_time_sync", "rc"):
        assert absent not in text


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_no_reply_has_a_number_that_is_none(value):
    with pytest.raises(ValueError, match="not finite"):
        protocol.reply(replace(STATE, gyro=(0.0, value, 0.0)))


def test_the_protocol_needs_neither_compiled_code_nor_learning():
    code = "import sys; from auvbench.integrations.ardusub import protocol, frames; print(*{'numba', 'torch', 'hydra', 'scipy'} & {*sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
