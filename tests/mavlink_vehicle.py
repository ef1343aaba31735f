"""A stand-in for ArduSub: it speaks MAVLink over UDP, and its motors drive the embedded physics.

Joystick and mixer are written after ArduSub/joystick.cpp, ArduSub/mode_manual.cpp and libraries/AP_Motors/AP_Motors6DOF.cpp once more,
motor by motor, so that `auvbench.integrations.mavlink.mixer` is tested against another implementation.
"""

from __future__ import annotations

import contextlib
import math
import random
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from auvbench.dynamics import frames
from auvbench.integrations.ardusub.frames import FRAMES
from auvbench.integrations.ardusub.physics import Physics
from auvbench.integrations.ardusub.radio import dialect
from tests import configs

STEP = 0.02  # s of simulated time between two messages of telemetry
MANUAL = 19
PATIENCE = 10
"""waits of 10 ms for a command, after which time goes on without it"""


def free_port() -> int:
    """Return a UDP port of this machine that no program has at present.

    It is below those that the system gives to sockets without one: another test's socket would get it before its user does.
    """
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


class ArduSub:
    """A vehicle that sends to one port of this machine, in a thread of its own.

    Simulated time goes on by one period of the pilot with each command while it is armed, and by itself without commands.

    Attributes are switches of a test: `tells` its telemetry, `beats` its heart, `refuses` to arm, `kind` is its MAV_TYPE, `wrong`
    changes the fields of a message before it is sent.
    """

    def __init__(
        self,
        port: int,
        vehicle: str = "bluerov2",
        *,
        system: int = 1,
        period: float = 0.1,
        physics: Physics | None = None,
    ) -> None:
        self.d = dialect()
        self.system, self.period = system, period
        self.kind = self.d.MAV_TYPE_SUBMARINE
        self.physics = physics or Physics(configs.training("algo=pid", f"vehicle={vehicle}"))
        self.frame = self.physics.motors.frame
        self.parameters = {
            "FRAME_CONFIG": float(self.frame.config),
            "JS_THR_GAIN": 1.0,
            "MOT_FV_CPLNG_K": 1.0,
            "FS_PILOT_INPUT": 2.0,
            "FS_PILOT_TIMEOUT": 3.0,
            "FS_GCS_ENABLE": 2.0,
            "FS_GCS_TIMEOUT": 5.0,
        }
        self.gain = 1.0
        self.armed, self.mode = False, 0
        self.tells, self.positions, self.beats, self.refuses = True, True, True, False
        self.ignores_disarming = False
        self.wrong: Callable[[str, list[Any]], Any] = lambda name, fields: None
        self.sticks: list[tuple[int, ...]] = []
        self.heard: list[str] = []
        self.boot = 3_600_000  # ms
        self.state = self._advance(STEP)
        self.last_input = 0
        self._streams: set[int] = set()
        self._mav = self.d.MAVLink(None, srcSystem=system, srcComponent=1)
        self._to = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.01)
        self._beat, self._beat_boot = 0.0, 0
        self._idle = 0  # waits without a message
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> ArduSub:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()

    @property
    def position(self) -> tuple[float, float, float]:
        """East, north, up in m."""
        return frames.ned(self.state.position)

    def restart(self) -> None:
        """Boot again: disarmed, at the start."""
        self.armed, self.boot = False, 0
        self._streams.clear()
        self.physics.reset()

    def send(self, name: str, *fields: Any) -> None:
        values = list(fields)
        self.wrong(name, values)
        message = getattr(self.d, f"MAVLink_{name}_message")(*values)
        self._socket.sendto(message.pack(self._mav), self._to)

    def _run(self) -> None:
        while not self._over.is_set():
            if time.monotonic() - self._beat > 0.1:
                self.beat()
            try:
                data, _ = self._socket.recvfrom(2048)
            except TimeoutError:
                data = b""
            except OSError:
                continue
            parser = self.d.MAVLink(None)
            for message in parser.parse_buffer(data) or () if data else ():
                self._handle(message)
            self._idle = 0 if data else self._idle + 1
            if self._idle > (PATIENCE if self.armed else 0):
                self.state = self._advance(STEP)
                self._telemetry()

    def beat(self) -> None:
        self._beat, self._beat_boot = time.monotonic(), self.boot
        if not self.beats:
            return
        mode = self.d.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        self.send(
            "heartbeat",
            self.kind,
            self.d.MAV_AUTOPILOT_ARDUPILOTMEGA,
            mode | self.d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
            self.mode,
            self.d.MAV_STATE_ACTIVE,
            3,
        )

    def _handle(self, message: Any) -> None:
        assert message.get_srcSystem() == 255
        kind = message.get_type()
        self.heard.append(kind)
        if kind == "COMMAND_LONG":
            self._command(message)
        elif kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            value = self.parameters[message.param_id]
            self.send("param_value", message.param_id.encode(), value, 9, 900, 65535)
        elif kind == "REQUEST_DATA_STREAM":
            self.send("named_value_float", self.boot, b"PilotGain", self.gain)
        elif kind == "MANUAL_CONTROL":
            assert message.target == self.system
            self.sticks.append((message.x, message.y, message.z, message.r, message.s, message.t))
            if self.armed and self.mode == MANUAL:
                for _ in range(round(self.period / STEP)):
                    self.state = self._advance(STEP)
                self._telemetry()

    def _command(self, message: Any) -> None:
        d, command = self.d, message.command
        result = d.MAV_RESULT_ACCEPTED
        if command == d.MAV_CMD_SET_MESSAGE_INTERVAL:
            self._streams.add(int(message.param1))
        elif command == d.MAV_CMD_DO_SET_MODE:
            self.mode = int(message.param2)
            self.beat()
        elif command == d.MAV_CMD_COMPONENT_ARM_DISARM:
            if message.param1 and self.refuses:
                result = d.MAV_RESULT_FAILED
                self.send("statustext", d.MAV_SEVERITY_CRITICAL, b"Arm: Compass not calibrated")
            elif message.param1 or not self.ignores_disarming:
                self.armed = bool(message.param1)
        self.send("command_ack", command, result)

    def _telemetry(self) -> None:
        if not self.tells:
            return
        if abs(self.boot - self._beat_boot) >= 100:  # by its own time, which goes on with the commands
            self.beat()
        state = self.state
        angles = frames.euler(state.quaternion).tolist()
        if self.d.MAVLINK_MSG_ID_ATTITUDE in self._streams:
            self.send("attitude", self.boot, *angles, *state.gyro)
        if self.positions and self.d.MAVLINK_MSG_ID_LOCAL_POSITION_NED in self._streams:
            self.send("local_position_ned", self.boot, *state.position, *state.velocity)

    def _advance(self, seconds: float) -> Any:
        self.boot += round(1000 * seconds)
        pwm = [1500] * 16
        if self.armed and self.sticks:
            for motor, level in enumerate(self.motors(self.sticks[-1])):
                pwm[motor] = 1500 + int(400 * level)
        return self.physics.step(pwm, seconds)

    def motors(self, sticks: tuple[int, ...]) -> list[float]:
        """Return the motors' outputs in [-1, 1]."""
        x, y, z, r, s, t = sticks
        gain, throttle_gain = self.gain, 0.8 * self.gain * self.parameters["JS_THR_GAIN"]

        def channel(value: float) -> float:
            return (min(max(math.floor(value), 1100), 1900) - 1500) / 400

        pitch, roll = channel(s + 1500), channel(t + 1500)
        throttle = channel(z * throttle_gain + 1500 - 500 * throttle_gain)
        yaw, forward, lateral = (channel(0.4 * gain * value + 1500) for value in (r, x, y))
        if self.frame is FRAMES["vectored"]:
            room = max(1 - self.parameters["MOT_FV_CPLNG_K"] * abs(throttle), 0.0)
            outputs = []
            for motor, (a, b, c, d, e, f) in enumerate(self.frame.factors):
                ahead = forward
                direction = (-1, -1, 1, 1, 0, 0)[motor]
                if direction and forward and (forward < 0) == (direction < 0):
                    ahead = min(max(forward, -room), room)
                output = roll * a + pitch * b + yaw * c + throttle * d + ahead * e + lateral * f
                outputs.append(min(max(output, -1.0), 1.0))
            return outputs
        upright = [roll * a + pitch * b + throttle * d for a, b, c, d, e, f in self.frame.factors]
        level = [yaw * c + forward * e + lateral * f for a, b, c, d, e, f in self.frame.factors]
        most = [max(1.0, *map(abs, part)) for part in (upright, level)]
        return [u / most[0] + v / most[1] for u, v in zip(upright, level, strict=True)]
