"""Read and write ArduPilot's JSON backend: a binary packet of PWM in, a line of JSON out.

Source: libraries/SITL/SIM_JSON.h, SIM_JSON.cpp and examples/JSON/readme.md. This module imports neither NumPy nor compiled code.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

PORT = 9002
"""UDP port of the physics for ArduPilot's instance 0"""
PORT_STEP = 10
"""difference between the ports of two consecutive instances"""
SLOWEST = 10
"""frame rate in Hz that a packet must exceed: ArduPilot ignores steps of 0.1 s or longer"""
CHANNELS = {18458: 16, 29569: 32}
"""number of PWM channels of a packet, by its magic number"""

_LAYOUTS = {magic: struct.Struct(f"<HHI{channels}H") for magic, channels in CHANNELS.items()}
_MAGIC = struct.Struct("<H")
LARGEST = max(layout.size for layout in _LAYOUTS.values())
"""size of the longest packet in bytes"""


class PacketError(ValueError):
    """A datagram is not a packet of ArduPilot's JSON backend."""


@dataclass(frozen=True, slots=True)
class Packet:
    """Packet that ArduSub sends for each step."""

    frame_rate: int
    """number of steps per second of simulated time, Hz"""
    frame_count: int
    """number of replies that ArduSub has received since its start"""
    pwm: tuple[int, ...]
    """(16,) or (32,) pulses, us; 0 for a channel without a pulse"""

    @property
    def duration(self) -> float:
        """Return the length of the step in s."""
        return 1.0 / self.frame_rate


@dataclass(frozen=True, slots=True)
class SensorState:
    """Sensor readings for ArduSub.

    World axes point north, east, down, from the vehicle's home at the surface (position, velocity). Body axes point forward,
    starboard, down (angular velocity, specific force).
    """

    time: float
    """time in s since the vehicle was reset"""
    gyro: tuple[float, float, float]
    """angular velocity, rad/s"""
    specific_force: tuple[float, float, float]
    """acceleration less gravity, m/s2: (0, 0, -9.81) at rest and level"""
    position: tuple[float, float, float]
    """position, m; the last number is the depth"""
    velocity: tuple[float, float, float]
    """velocity over ground, m/s"""
    quaternion: tuple[float, float, float, float]
    """unit quaternion (w, x, y, z) that rotates body axes to world axes"""
    voltage: float
    """voltage of the battery, V"""
    current: float
    """current of the battery, A"""

    @property
    def depth(self) -> float:
        """Return the depth below the mean surface in m."""
        return self.position[2]


def parse(datagram: bytes) -> Packet:
    """Return the packet in a datagram.

    Raises:
        PacketError: the magic number or the length is wrong, or the frame rate is too low.
    """
    if len(datagram) < _MAGIC.size:
        raise PacketError(f"{len(datagram)} bytes: must be 40 or 72")
    (magic,) = _MAGIC.unpack_from(datagram)
    layout = _LAYOUTS.get(magic)
    if layout is None:
        raise PacketError(f"magic number {magic}: must be {' or '.join(map(str, CHANNELS))}")
    if len(datagram) != layout.size:
        raise PacketError(f"{len(datagram)} bytes: {CHANNELS[magic]} channels take {layout.size}")
    _, frame_rate, frame_count, *pwm = layout.unpack(datagram)
    if frame_rate <= SLOWEST:
        raise PacketError(f"a frame rate of {frame_rate} Hz: must be more than {SLOWEST} (SIM_RATE_HZ)")
    return Packet(frame_rate, frame_count, tuple(pwm))


def reply(state: SensorState) -> bytes:
    """Return the reply to a packet.

    Raises:
        ValueError: a number is not finite, which ArduPilot's parser would misread.
    """
    numbers = (
        state.time,
        *state.gyro,
        *state.specific_force,
        *state.position,
        *state.velocity,
        *state.quaternion,
        state.voltage,
        state.current,
    )
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f"the state at {state.time} s is not finite")
    return _LINE.format(*numbers).encode("ascii")


# ArduPilot finds a key by the first occurrence of its name, so no key may contain the name of a later key.
_LINE = (
    '\n{{"timestamp":{:.9f},"imu":{{"gyro":[{:.9f},{:.9f},{:.9f}],"accel_body":[{:.9f},{:.9f},{:.9f}]}},'
    '"position":[{:.9f},{:.9f},{:.9f}],"velocity":[{:.9f},{:.9f},{:.9f}],'
    '"quaternion":[{:.9f},{:.9f},{:.9f},{:.9f}],"battery":{{"voltage":{:.3f},"current":{:.3f}}}}}\n'
)
