"""A process of ArduSub's SITL in lock-step: sensors and PWM over UDP, orders and telemetry in MAVLink over UDP.

Both sockets are this process's own, on loopback, so that many pairs run side by side. ArduSub waits for the answer to each
of its packets: between two calls of `exchange` its clock stands, and what is sent to it meanwhile arrives at the same step
of its loop each time.
"""

from __future__ import annotations

import math
import select
import shutil
import socket
import subprocess
import tempfile
import time
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from auvbench.ardusub.protocol import LARGEST, Packet, PacketError, SensorState, parse, reply
from auvbench.ardusub.sensors import GRAVITY
from auvbench.errors import MissingExtraError, TrainingError

_MANUAL = 19
MODES = {"alt_hold": 2, "guided": 4, "poshold": 16}
"""Mode::Number of ArduSub/mode.h"""

PARAMETERS = {
    **{
        f"COMPASS_OFS{n}_{axis}": value
        for n in ("", 2, 3)
        for axis, value in (("X", 5), ("Y", 13), ("Z", -18))
    },
    "JS_GAIN_DEFAULT": 1,
    "LOG_BACKEND_TYPE": 0,
    "SIM_RATE_HZ": 400,
}
"""what every ArduSub is started with: the calibration of SITL's compasses, sticks that reach to full thrust, no log on disk,
and packets at the rate of ArduSub's own loop"""

PATIENCE = 20.0
"""s of wall time without a packet after which ArduSub is given up"""
SETTLING = 120.0
"""s of ArduSub's time in which it must take its mode, and then arm"""
LOWERING = 1.0
"""m/s, mean speed at which the vehicle is brought to its depth"""
ASKED = 0.5
"""s of ArduSub's time between two attempts to arm, and between two messages that show that a pilot is there"""

_HOME = "55,10,0,0"
"""latitude, longitude, altitude, heading of the world's origin, which is at sea level; ArduPilot takes 0,0 for no place"""
_EPOCH = "1700000000"
"""of ArduSub's clock, which sets its GPS's: the same in each run"""
_PILOT, _SUBMARINE, _AUTOPILOT = 255, 12, 3
"""MAVLink's system number of a ground station, MAV_TYPE_SUBMARINE, MAV_AUTOPILOT_ARDUPILOTMEGA"""
_SET_MODE, _ARM, _MESSAGE_INTERVAL, _REQUEST_MESSAGE = 176, 400, 511, 512
_ATTITUDE, _VERSION = 30, 148
_POSITION_AND_VELOCITY = 0b100111000000
"""type mask of SET_POSITION_TARGET_LOCAL_NED: what it ignores. A position alone makes ArduSub plan its way anew with each
message, so that one that is sent at 10 Hz is approached at 0.03 m/s."""
_BODY_FRD = 12
"""MAV_FRAME: ahead, to starboard and down of where ArduSub takes itself to be, level"""
_TYPES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", 255: ""}

_used: dict[str, str] = {}


def used() -> dict[str, str]:
    """Return the version of the last ArduSub of this process, for manifests; empty without one."""
    return dict(_used)


class Sitl:
    """ArduSub from its start to its end; it never starts over, so nothing of an earlier episode is left in it.

    Args:
        path: the program.
        parameters: of ArduSub, by name, in place of its defaults and of `PARAMETERS`.
        at_birth: called in the new process before the program: what ties it to the life of this one.

    Raises:
        MissingExtraError: pymavlink is not installed.
        TrainingError: the program does not start, or ends, or sends nothing.
    """

    def __init__(
        self, path: Path, parameters: Mapping[str, float], at_birth: Callable[[], None] | None = None
    ) -> None:
        self.path = path
        self.armed = False
        self.mode = -1
        self.yaw = 0.0
        """rad, of ArduSub's own estimate, from north to starboard"""
        self.said = ""
        """the last text of ArduSub"""
        self.time = 0.0
        """s, that ArduSub has lived through"""
        self._count = -1
        self._peer: Any = None
        self._link_peer: Any = None
        self._asked = -ASKED
        self._unconfirmed = dict(parameters)
        self._folder = Path(tempfile.mkdtemp(prefix="auvbench-ardusub-"))
        self._physics, self._radio = _socket(), _socket()
        self._radio.setblocking(False)
        self._link = _dialect().MAVLink(self, srcSystem=_PILOT, srcComponent=190)
        self._link.robust_parsing = True
        defaults = self._folder / "defaults.parm"
        defaults.write_text(
            "".join(f"{name} {value:.9g}\n" for name, value in (PARAMETERS | dict(parameters)).items())
        )
        command = [
            *(str(path), "--model", "JSON:127.0.0.1", "--home", _HOME, "--speedup", "1000"),
            *("--sim-port-out", str(self._physics.getsockname()[1]), "--start-time", _EPOCH, "--wipe"),
            *("--serial0", f"udpclient:127.0.0.1:{self._radio.getsockname()[1]}"),
            *("--serial1", "none:1", "--serial2", "none:2", "--rc-in-port", "0", "--defaults", str(defaults)),
        ]
        try:
            with (self._folder / "output.txt").open("wb") as output:
                self._process = subprocess.Popen(
                    command,
                    cwd=self._folder,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    preexec_fn=at_birth,
                    start_new_session=True,  # Ctrl-C is for this process, which then ends ArduSub
                )
        except OSError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise TrainingError(f"{path} cannot be started: {error.strerror}") from error
        self.close = weakref.finalize(self, _end, self._process, self._folder, (self._physics, self._radio))
        """ends the process; so does the end of this one"""
        self.packet = self._receive()

    def write(self, data: bytes) -> None:
        """Send the bytes of a MAVLink message; pymavlink calls it."""
        if self._link_peer is not None:
            self._radio.sendto(data, self._link_peer)

    def exchange(self, state: SensorState, duration: float) -> Packet:
        """Answer ArduSub's packet with what its sensors read `duration` s later; return its next packet."""
        self.time += duration
        self._physics.sendto(reply(replace(state, time=self.time)), self._peer)
        self.packet = self._receive()
        return self.packet

    def _receive(self) -> Packet:
        ends = time.monotonic() + PATIENCE
        while True:
            # Short waits: a process that has ended sends nothing, and is noticed at once.
            if select.select([self._physics], [], [], 0.2)[0]:
                data, sender = self._physics.recvfrom(LARGEST + 1)
                try:
                    packet = parse(data)
                except PacketError:
                    continue
                # ArduSub repeats a packet that was not answered within a second.
                if packet.frame_count > self._count:
                    self._peer, self._count = sender, packet.frame_count
                    return packet
            elif (code := self._process.poll()) is not None:
                raise TrainingError(f"{self.path}: ended with exit code {code}{self._last_line()}")
            elif time.monotonic() > ends:
                raise TrainingError(
                    f"{self.path}: has sent no packet of the JSON backend for {PATIENCE:g} s{self._last_line()}"
                )

    def _last_line(self) -> str:
        text = (self._folder / "output.txt").read_text(encoding="utf-8", errors="replace").strip()
        lines = [line for line in (self.said, *text.splitlines()[-1:]) if line]
        return f"; it said: {lines[0]}" if lines else ""

    def settle(self, still: SensorState, mode: int) -> float:
        """Bring the vehicle, held by hand, to where it is to start, armed and in `mode`; return the s of ArduSub's time it takes.

        It is held at the surface until ArduSub's estimator has settled, then lowered: ArduSub takes the pressure in which it
        starts for that of the surface, and a position that jumps for a fault of its sensors.

        Raises:
            TrainingError: ArduSub was not ready within `SETTLING`, or is no submarine.
        """
        begun = self.time
        x, y, depth = still.position
        ahead, starboard, down = still.specific_force
        surface = replace(still, position=(x, y, 0.0))
        while not (self.mode == mode and _used and not self._unconfirmed):
            self._wait(surface, mode, begun)
        self._command(_SET_MODE, 1, _MANUAL)
        lowering = abs(depth) / LOWERING
        started = self.time
        while (t := self.time - started) < lowering:
            way, speed, acceleration = _eased(t / lowering)
            force = 1.0 - acceleration * depth / lowering**2 / GRAVITY
            held = replace(
                still,
                position=(x, y, depth * way),
                velocity=(0.0, 0.0, speed * depth / lowering),
                specific_force=(force * ahead, force * starboard, force * down),
            )
            self.exchange(held, self.packet.duration)
            self._stay_known()
        lowered = self.time
        while not (self.armed and self.mode == mode):
            self._wait(still, mode, lowered, arm=True)
        return self.time - begun

    def _wait(self, held: SensorState, mode: int, begun: float, arm: bool = False) -> None:
        """Let a little time pass with the vehicle held; ask for what lacks."""
        if self.time - begun > SETTLING:
            raise TrainingError(
                f"{self.path}: did not {self._lacking(mode)} within {SETTLING:g} s{self._last_line()}"
            )
        for _ in range(20):
            self.exchange(held, self.packet.duration)
        if not self._stay_known():
            return
        self._command(_REQUEST_MESSAGE, _VERSION)
        self._command(_MESSAGE_INTERVAL, _ATTITUDE, 20_000)
        for name in self._unconfirmed:
            self._link.param_request_read_send(1, 1, name.encode(), -1)
        self._command(_SET_MODE, 1, mode)
        if arm and self.mode == mode:
            self._command(_ARM, 1)

    def _stay_known(self) -> bool:
        """Listen; every `ASKED` s show that a pilot is there, and return True."""
        self.listen()
        if self.time - self._asked < ASKED:
            return False
        self._asked = self.time
        self.show_presence()
        return True

    def _lacking(self, mode: int) -> str:
        if self._unconfirmed:
            wanted = (f"algo.parameters.{name}={value:g}" for name, value in self._unconfirmed.items())
            return f"confirm {', '.join(wanted)}"
        return "arm" if self.mode == mode else f"take mode {mode}"

    def listen(self) -> None:
        """Take in the telemetry that has arrived."""
        while True:
            try:
                data, self._link_peer = self._radio.recvfrom(65_536)
            except BlockingIOError:
                return
            for message in self._link.parse_buffer(data) or ():
                self._take(message)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.autopilot != 8:  # 8: not an autopilot
            if (message.type, message.autopilot) != (_SUBMARINE, _AUTOPILOT):
                raise TrainingError(
                    f"{self.path}: is no ArduSub: it calls itself MAV_TYPE {message.type}, MAV_AUTOPILOT {message.autopilot}"
                )
            self.armed, self.mode = bool(message.base_mode & 128), int(message.custom_mode)
        elif kind == "ATTITUDE":
            self.yaw = float(message.yaw)
        elif kind == "PARAM_VALUE":
            wanted = self._unconfirmed.get(message.param_id, math.nan)
            if math.isclose(message.param_value, wanted, rel_tol=1e-5):
                del self._unconfirmed[message.param_id]
        elif kind == "STATUSTEXT":
            self.said = str(message.text)
        elif kind == "AUTOPILOT_VERSION":
            major, minor, patch, type_ = int(message.flight_sw_version).to_bytes(4, "big")
            commit = bytes(message.flight_custom_version).decode("ascii", "replace").strip("\0")
            _used["ardusub"] = f"{major}.{minor}.{patch}{_TYPES.get(type_, '')} ({commit})"

    def _command(self, number: int, *values: float) -> None:
        self._link.command_long_send(1, 1, number, 0, *values, *(0.0,) * (7 - len(values)))

    def show_presence(self) -> None:
        """Send a ground station's heartbeat, without which ArduSub's failsafe stops the vehicle."""
        self._link.heartbeat_send(6, 8, 0, 0, 0)

    def fly_to(
        self, offset: tuple[float, float, float], yaw: float, velocity: tuple[float, float, float]
    ) -> None:
        """Give a target of mode GUIDED.

        Args:
            offset: m ahead, to starboard and down of the vehicle, level.
            yaw: rad from north to starboard.
            velocity: m/s of the target, in the same axes.
        """
        self._link.set_position_target_local_ned_send(
            *(int(1000.0 * self.time), 1, 1, _BODY_FRD, _POSITION_AND_VELOCITY),
            *(*offset, *velocity, 0.0, 0.0, 0.0, yaw, 0.0),
        )

    def stick(self, forward: float, starboard: float, up: float, turn: float) -> None:
        """Move a pilot's sticks, each in [-1, 1]; neutral sticks also tell ArduSub that the pilot is there."""
        x, y, z, r = (round(1000.0 * value) for value in (forward, starboard, up, turn))
        self._link.manual_control_send(1, x, y, 500 + z // 2, r, 0)


def _eased(share: float) -> tuple[float, float, float]:
    """Return way, speed and acceleration at a share of the time of a motion of length and time 1, at rest at both ends."""
    angle = math.pi * share
    return 0.5 - 0.5 * math.cos(angle), 0.5 * math.pi * math.sin(angle), 0.5 * math.pi**2 * math.cos(angle)


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    return made


def _dialect() -> Any:
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ModuleNotFoundError as error:
        raise MissingExtraError("pymavlink", extra="mavlink", purpose="algo=ardusub") from error
    return ardupilotmega


def _end(process: subprocess.Popen[bytes], folder: Path, sockets: tuple[socket.socket, ...]) -> None:
    process.kill()
    process.wait()
    for one in sockets:
        one.close()
    shutil.rmtree(folder, ignore_errors=True)
