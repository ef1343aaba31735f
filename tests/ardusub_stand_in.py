"""A stand-in for ArduSub's SITL: the same options, packets and messages, and a P controller in place of the autopilot.

A test starts it as a program of its own (`installed`). Parameters named SIM_... make it fail in one way or another.
"""

from __future__ import annotations

import argparse
import json
import math
import socket
import stat
import struct
import sys
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from auvbench.integrations.ardusub.frames import FRAMES
from auvbench.integrations.ardusub.protocol import CHANNELS

RATE = 100
"""packets per s, fewer than ArduSub's: tests wait for them"""
STICKS, GUIDED = (2, 16), 4
VERSION = (4, 7, 0, 255)


def installed(folder: Path) -> Path:
    """Return a program in `folder` that runs this file."""
    path = folder / "ardusub"
    root = Path(__file__).parents[1]
    path.write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(root)!r})\n"
        "from tests.ardusub_stand_in import main\nmain()\n"
    )
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


class StandIn:
    def __init__(self, physics: int, radio: int, parameters: dict[str, float]) -> None:
        self.parameters = parameters
        self.frame = next(f for f in FRAMES.values() if f.config == parameters["FRAME_CONFIG"])
        self.channels = 32 if self.wants("CHANNELS") else 16
        self.physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.physics.connect(("127.0.0.1", physics))
        self.physics.settimeout(1.0)
        self.radio = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.radio.connect(("127.0.0.1", radio))
        self.radio.setblocking(False)
        self.link = mavlink.MAVLink(self, srcSystem=1, srcComponent=1)
        self.link.robust_parsing = True
        self.mode, self.armed, self.count = 0, False, 0
        self.since = math.inf
        self.sticks = (0.0,) * 4
        self.state: dict[str, Any] = {}
        self.target: tuple[float, float, float] | None = None
        self.yaw_target = 0.0
        self.velocity_target = (0.0, 0.0, 0.0)
        self.has_gps = parameters.get("SIM_GPS1_ENABLE", 1.0) > 0.0
        self.place, self.motion = [0.0] * 3, (0.0,) * 3
        self.pinged = -math.inf

    def wants(self, name: str) -> float:
        return self.parameters.get(f"SIM_{name}", 0.0)

    def write(self, data: bytes) -> None:
        self.radio.send(data)

    @property
    def yaw(self) -> float:
        w, x, y, z = self.state["quaternion"]
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    def turned(self, ahead: float, starboard: float, sign: float = 1.0) -> tuple[float, float]:
        """Return a level vector turned from the body's axes to the world's; with sign -1 from the world's to the body's."""
        c, s = math.cos(self.yaw), sign * math.sin(self.yaw)
        return c * ahead - s * starboard, s * ahead + c * starboard

    def exchange(self) -> None:
        """Send the PWM and take the answer, as often as it takes."""
        magic = next(magic for magic, channels in CHANNELS.items() if channels == self.channels)
        pwm = (*self.pwm(), *(0,) * (self.channels - self.frame.motors))
        packet = struct.pack(f"<HHI{self.channels}H", magic, RATE, self.count, *pwm)
        while True:
            self.physics.send(packet)
            if self.wants("REPEATS"):
                self.physics.send(packet)
            try:
                line = self.physics.recv(2000)
            except TimeoutError:
                continue
            break
        self.state = json.loads(line)
        self.count += 1

    @property
    def position(self) -> list[float]:
        return self.state["position"] if self.has_gps else self.place

    @property
    def velocity(self) -> tuple[float, ...]:
        return tuple(self.state["velocity"]) if self.has_gps else self.motion

    def knows_its_position(self) -> bool:
        """Return whether GPS or recent pings of a DVL tell it."""
        listens = self.parameters.get("VISO_TYPE") == 1.0 and self.parameters.get("EK3_SRC1_VELXY") == 6.0
        return self.has_gps or (listens and self.state["timestamp"] - self.pinged < 0.5)

    def pwm(self) -> list[int]:
        if not self.armed:
            return [1500] * self.frame.motors
        w, x, y, z = self.state["quaternion"]
        p, q, _ = self.state["imu"]["gyro"]
        roll = -0.8 * math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)) - 0.2 * p
        pitch = -0.8 * math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))) - 0.2 * q
        forward, lateral, throttle, yaw = self.efforts()
        axes = (roll, pitch, yaw, throttle, forward, lateral)
        outputs = (sum(a * b for a, b in zip(factors, axes, strict=True)) for factors in self.frame.factors)
        return [round(1500 + 400 * min(1.0, max(-1.0, value))) for value in outputs]

    def efforts(self) -> tuple[float, ...]:
        if self.mode in STICKS:
            return self.sticks
        if self.target is None:
            return (0.0,) * 4
        north, east, down = (
            a - b + v - u
            for a, b, v, u in zip(
                self.target, self.position, self.velocity_target, self.velocity, strict=True
            )
        )
        forward, starboard = self.turned(north, east, -1.0)
        turn = math.remainder(self.yaw_target - self.yaw, 2.0 * math.pi)
        return forward, starboard, -down, 0.3 * turn - 0.2 * self.state["imu"]["gyro"][2]

    def take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "COMMAND_LONG" and message.command == 176 and not self.wants("NO_MODE"):
            if int(message.param2) not in (GUIDED, 16) or self.knows_its_position():
                self.mode = int(message.param2)
        elif kind == "VISION_POSITION_DELTA":
            seconds = 1e-6 * message.time_delta_usec
            ahead, starboard, down = message.position_delta
            moved = (*self.turned(ahead, starboard), down)
            self.place = [a + b for a, b in zip(self.place, moved, strict=True)]
            self.motion = tuple(x / seconds for x in moved)
            self.pinged = self.state["timestamp"]
        elif kind == "COMMAND_LONG" and message.command == 400:
            self.armed, self.since = not self.wants("NEVER_ARMS"), self.state["timestamp"]
        elif kind == "COMMAND_LONG" and message.command == 512:
            version = int.from_bytes(bytes(VERSION), "big")
            commit = list(b"standin!")
            self.link.autopilot_version_send(0, version, 0, 0, 0, commit, commit, commit, 0, 0, 0)
        elif kind == "PARAM_REQUEST_READ" and not (name := message.param_id).startswith("NO_"):
            self.link.param_value_send(name.encode(), self.parameters[name], 9, 1, 0)
        elif kind == "MANUAL_CONTROL":
            self.sticks = message.x / 1e3, message.y / 1e3, (message.z - 500) / 500, message.r / 1e3
        elif kind == "SET_POSITION_TARGET_LOCAL_NED" and self.mode == GUIDED:
            north, east = self.turned(message.x, message.y)
            x, y, z = self.position
            self.target, self.yaw_target = (x + north, y + east, z + message.z), message.yaw
            self.velocity_target = (*self.turned(message.vx, message.vy), message.vz)

    def run(self) -> None:
        while True:
            self.exchange()
            if self.wants("ENDS") and self.armed:
                print("PANIC: the stand-in was told to end")
                raise SystemExit(3)
            if (limit := self.wants("DISARMS")) and self.state["timestamp"] > self.since + limit:
                self.armed = False
            try:
                while True:
                    for message in self.link.parse_buffer(self.radio.recv(65_536)) or ():
                        self.take(message)
            except BlockingIOError:
                pass
            kind = 2 if self.wants("COPTER") else 12
            self.link.heartbeat_send(kind, 3, 128 * self.armed, self.mode, 4)
            self.link.attitude_send(0, 0.0, 0.0, self.yaw, 0.0, 0.0, 0.0)
            if self.wants("NEVER_ARMS"):
                self.link.statustext_send(3, b"PreArm: the stand-in was told not to arm")


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("--sim-port-out", type=int)
    options.add_argument("--serial0")
    options.add_argument("--defaults", type=Path)
    given, _ = options.parse_known_args()
    lines = (line.split() for line in given.defaults.read_text().splitlines())
    parameters = {name: float(value) for name, value in lines}
    StandIn(given.sim_port_out, int(given.serial0.split(":")[2]), parameters).run()
