"""Exchange MAVLink messages with ArduSub: send a ground station's commands and receive ArduSub's telemetry."""

from __future__ import annotations

import math
import socket
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from auvbench.errors import MissingExtraError, TrainingError

MANUAL = 19
"""number of the mode in which the sticks go directly to ArduSub's mixer"""
MODES = {"alt_hold": 2, "guided": 4, "poshold": 16}
"""mode numbers by name (Mode::Number in ArduSub/mode.h)"""

_PILOT = 255
"""MAVLink system number of a ground station"""
_POSITION_AND_VELOCITY = 0b100111000000
"""type mask of SET_POSITION_TARGET_LOCAL_NED; each bit is a field that ArduSub ignores. Without the velocity, ArduSub
would plan a new path for each message; with 10 messages per second it would approach the target at 0.03 m/s.
"""
_BODY_FRD = 12
"""MAV_FRAME with level axes ahead, starboard and down, relative to ArduSub's own position estimate"""
_TYPES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", 255: ""}

_used: dict[str, str] = {}


def used() -> dict[str, str]:
    """Return the version of the last ArduSub that this process connected to, for manifests; empty without such a connection."""
    return dict(_used)


class Radio:
    """One end of a MAVLink connection over UDP. The other end is an ArduSub that was started with the port of `socket`.

    Args:
        path: path of ArduSub's program, for error messages.
        parameters: parameters that ArduSub must confirm.

    Raises:
        MissingExtraError: pymavlink is not installed.
    """

    def __init__(self, path: Path, parameters: Mapping[str, float]) -> None:
        self.path = path
        self.armed = False
        self.mode = -1
        self.yaw = 0.0
        """yaw that ArduSub estimates, rad, clockwise from north"""
        self.said = ""
        """last text message of ArduSub"""
        self.unconfirmed = dict(parameters)
        """parameters that ArduSub has not confirmed yet"""
        self.socket = loopback_socket()
        self.socket.setblocking(False)
        self._peer: Any = None
        self._dialect = dialect()
        self._link = self._dialect.MAVLink(self, srcSystem=_PILOT, srcComponent=190)
        self._link.robust_parsing = True

    def write(self, data: bytes) -> None:
        """Send the bytes of a message; pymavlink calls this method."""
        if self._peer is not None:
            self.socket.sendto(data, self._peer)

    def listen(self) -> None:
        """Read the telemetry that has arrived."""
        while True:
            try:
                data, self._peer = self.socket.recvfrom(65_536)
            except BlockingIOError:
                return
            for message in self._link.parse_buffer(data) or ():
                self._take(message)

    def _take(self, message: Any) -> None:
        d, kind = self._dialect, message.get_type()
        if kind == "HEARTBEAT" and message.autopilot != d.MAV_AUTOPILOT_INVALID:
            submarine = d.MAV_TYPE_SUBMARINE, d.MAV_AUTOPILOT_ARDUPILOTMEGA
            if (message.type, message.autopilot) != submarine:
                raise TrainingError(
                    f"{self.path}: is not ArduSub: it reports MAV_TYPE {message.type}, MAV_AUTOPILOT {message.autopilot}"
                )
            self.armed = bool(message.base_mode & d.MAV_MODE_FLAG_SAFETY_ARMED)
            self.mode = int(message.custom_mode)
        elif kind == "ATTITUDE":
            self.yaw = float(message.yaw)
        elif kind == "PARAM_VALUE":
            wanted = self.unconfirmed.get(message.param_id, math.nan)
            if math.isclose(message.param_value, wanted, rel_tol=1e-5):
                del self.unconfirmed[message.param_id]
        elif kind == "STATUSTEXT":
            self.said = str(message.text)
        elif kind == "AUTOPILOT_VERSION":
            major, minor, patch, type_ = int(message.flight_sw_version).to_bytes(4, "big")
            commit = bytes(message.flight_custom_version).decode("ascii", "replace").strip("\0")
            _used["ardusub"] = f"{major}.{minor}.{patch}{_TYPES.get(type_, '')} ({commit})"

    def ask(self) -> None:
        """Request the version, the attitude at 50 Hz, and the unconfirmed parameters."""
        d = self._dialect
        self._command(d.MAV_CMD_REQUEST_MESSAGE, d.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        self._command(d.MAV_CMD_SET_MESSAGE_INTERVAL, d.MAVLINK_MSG_ID_ATTITUDE, 20_000)
        for name in self.unconfirmed:
            self._link.param_request_read_send(1, 1, name.encode(), -1)

    def set_mode(self, mode: int) -> None:
        """Request a mode."""
        self._command(self._dialect.MAV_CMD_DO_SET_MODE, 1, mode)

    def arm(self) -> None:
        """Request arming."""
        self._command(self._dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def disarm(self) -> None:
        """Disarm at once."""
        self._command(self._dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)

    def _command(self, number: int, *values: float) -> None:
        self._link.command_long_send(1, 1, number, 0, *values, *(0.0,) * (7 - len(values)))

    def show_presence(self) -> None:
        """Send a ground station's heartbeat, without which ArduSub's failsafe stops the vehicle."""
        d = self._dialect
        self._link.heartbeat_send(d.MAV_TYPE_GCS, d.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def fly_to(
        self, offset: tuple[float, float, float], yaw: float, velocity: tuple[float, float, float]
    ) -> None:
        """Send a target of mode GUIDED.

        Args:
            offset: offset in m from the vehicle, in level axes: ahead, starboard, down.
            yaw: yaw in rad, clockwise from north.
            velocity: velocity of the target in m/s, in the axes of `offset`.
        """
        self._link.set_position_target_local_ned_send(
            *(0, 1, 1, _BODY_FRD, _POSITION_AND_VELOCITY),
            *(*offset, *velocity, 0.0, 0.0, 0.0, yaw, 0.0),
        )

    def moved(
        self,
        elapsed: float,
        velocity: tuple[float, float, float],
        rates: tuple[float, float, float],
        confidence: float,
    ) -> None:
        """Send a measured velocity over ground, as the motion since the last measurement.

        Args:
            elapsed: time in s since the last measurement.
            velocity: velocity in m/s in body axes: ahead, starboard, down.
            rates: angular velocity in rad/s about the same axes.
            confidence: confidence in %; 100 is best.
        """
        turned, way = ([elapsed * x for x in vector] for vector in (rates, velocity))
        self._link.vision_position_delta_send(0, round(1e6 * elapsed), turned, way, confidence)

    def stick(self, forward: float, starboard: float, up: float, turn: float) -> None:
        """Move a pilot's sticks, each in [-1, 1]; neutral sticks also show that the pilot is present."""
        x, y, z, r = (round(1000.0 * value) for value in (forward, starboard, up, turn))
        self._link.manual_control_send(1, x, y, 500 + z // 2, r, 0)

    def sticks(self, x: int, y: int, z: int, r: int, s: int, t: int) -> None:
        """Send the fields of MANUAL_CONTROL, as `Mixer.sticks` returns them."""
        self._link.manual_control_send(1, x, y, z, r, 0, 0, 3, s, t)


def loopback_socket() -> socket.socket:
    """Return a UDP socket on a free port, reachable only from this machine."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", 0))
    return udp


@cache
def dialect(purpose: str = "algo=ardusub") -> Any:
    """Return pymavlink's messages of MAVLink 2 in ArduPilot's dialect.

    Raises:
        MissingExtraError: pymavlink is not installed.
    """
    try:
        return import_module("pymavlink.dialects.v20.ardupilotmega")
    except ModuleNotFoundError as error:
        raise MissingExtraError("pymavlink", extra="mavlink", purpose=purpose) from error
