"""Run ArduSub's SITL in lock-step: sensors and PWM over one UDP socket, MAVLink commands and telemetry over another.

Each process has its own two loopback sockets, so that many processes can each run an ArduSub at the same time.
ArduSub waits for the answer to each packet, so its clock does not advance between two calls of `exchange`. A command
sent between the calls therefore always arrives at the same step of ArduSub's loop.

An environment variable names the program. A run's configuration has the program's digest but not its path: a run from
another person must not choose which program this machine starts.
"""

from __future__ import annotations

import copy
import hashlib
import math
import os
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

from omegaconf import DictConfig, open_dict

from auvbench.errors import ConfigError, TrainingError
from auvbench.integrations.ardusub.protocol import LARGEST, Packet, PacketError, SensorState, parse, reply
from auvbench.integrations.ardusub.radio import MANUAL, Radio, loopback_socket, used
from auvbench.integrations.ardusub.sensors import GRAVITY
from auvbench.integrations.ardusub.spec import ArduSub

VARIABLE = "AUVBENCH_ARDUSUB"
"""environment variable that names the program"""

PARAMETERS = {
    **{
        f"COMPASS_OFS{n}_{axis}": value
        for n in ("", 2, 3)
        for axis, value in (("X", 5), ("Y", 13), ("Z", -18))
    },
    "JS_GAIN_DEFAULT": 1,
    "LOG_BACKEND_TYPE": 0,
    "SIM_BARO_RND": 0.02,
    "SIM_BAR2_RND": 0.02,
    "SIM_RATE_HZ": 400,
}
"""parameters of every ArduSub: the calibration of SITL's compasses, sticks that reach full thrust, no log on
disk, depth noise in m as in ArduPilot's sub-6dof.parm (SITL's own is 0.2), and packets at the rate of ArduSub's own loop
"""

PATIENCE = 20.0
"""wall time in s without a packet after which auvbench reports that ArduSub has failed"""
SETTLING = 120.0
"""longest wait in s, by ArduSub's clock: for the mode and the parameters, and again for arming"""
LOWERING = 1.0
"""mean speed in m/s at which the vehicle is lowered to its depth"""
ASKED = 0.5
"""ArduSub's time in s between two attempts to arm, and between two heartbeats of the pilot"""
PING = 0.1
"""ArduSub's time in s between two pings of a DVL while the vehicle is held"""

_HOME = "55,10,0,0"
"""latitude, longitude, altitude, heading of the world's origin at sea level; ArduPilot takes 0,0 as unknown"""
_EPOCH = "1700000000"
"""start of ArduSub's clock in Unix seconds; fixed, so that the GPS time is the same in each run"""


class Sitl:
    """An ArduSub process for one episode; it never restarts, so it has no state from an earlier episode.

    Args:
        path: path of the program.
        parameters: ArduSub's parameters by name; they override ArduSub's defaults and `PARAMETERS`.
        at_birth: function called in the new process before the program starts. It makes the new process end when this process ends.
        has_dvl: whether ArduSub gets the pings of a DVL, also while the vehicle is held.

    Raises:
        MissingExtraError: pymavlink is not installed.
        TrainingError: the program does not start, ends, or sends nothing.
    """

    def __init__(
        self,
        path: Path,
        parameters: Mapping[str, float],
        at_birth: Callable[[], None] | None = None,
        has_dvl: bool = False,
    ) -> None:
        self.path = path
        self.time = 0.0
        """ArduSub's time so far, s"""
        self._count = -1
        self._peer: Any = None
        self._asked = -ASKED
        self._has_dvl, self._pinged = has_dvl, 0.0
        self.folder = Path(tempfile.mkdtemp(prefix="auvbench-ardusub-"))
        self._physics = loopback_socket()
        self.radio = Radio(path, parameters)
        defaults = self.folder / "defaults.parm"
        defaults.write_text(
            "".join(f"{name} {value:.9g}\n" for name, value in (PARAMETERS | dict(parameters)).items())
        )
        command = [
            *(str(path), "--model", "JSON:127.0.0.1", "--home", _HOME, "--speedup", "1000"),
            *("--sim-port-out", str(self._physics.getsockname()[1]), "--start-time", _EPOCH, "--wipe"),
            *("--serial0", f"udpclient:127.0.0.1:{self.radio.socket.getsockname()[1]}"),
            *("--serial1", "none:1", "--serial2", "none:2", "--rc-in-port", "0", "--defaults", str(defaults)),
        ]
        try:
            with (self.folder / "output.txt").open("wb") as output:
                self._process = subprocess.Popen(
                    command,
                    cwd=self.folder,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    preexec_fn=at_birth,
                    start_new_session=True,  # Ctrl-C is for this process, which then ends ArduSub.
                )
        except OSError as error:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise TrainingError(f"{path} cannot be started: {error.strerror}") from error
        self.close = weakref.finalize(
            self, _end, self._process, self.folder, (self._physics, self.radio.socket)
        )
        """function that ends ArduSub's process; also called when this process ends"""
        self.packet = self._receive()

    def exchange(self, state: SensorState, duration: float) -> Packet:
        """Advance ArduSub's clock by `duration` s, answer its packet with the readings `state`, and return its next packet."""
        self.time += duration
        self._physics.sendto(reply(replace(state, time=self.time)), self._peer)
        self.packet = self._receive()
        return self.packet

    def _receive(self) -> Packet:
        ends = time.monotonic() + PATIENCE
        while True:
            # Short waits, so that the end of the process is noticed at once.
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
        text = (self.folder / "output.txt").read_text(encoding="utf-8", errors="replace").strip()
        lines = [line for line in (self.radio.said, *text.splitlines()[-1:]) if line]
        return f"; it said: {lines[0]}" if lines else ""

    def settle(self, still: SensorState, mode: int) -> float:
        """Bring the held vehicle to its start, armed and in `mode`; return the time in s of ArduSub's clock that this took.

        The vehicle is held at the surface until ArduSub's estimator has settled, then lowered. ArduSub takes
        its pressure at the start as the pressure at the surface, and would take a jump of the position as a
        sensor fault. While the vehicle is held, its DVL has no errors.

        Raises:
            TrainingError: ArduSub was not ready within `SETTLING`, or is not a submarine.
        """
        begun = self.time
        x, y, depth = still.position
        ahead, starboard, down = still.specific_force
        surface = replace(still, position=(x, y, 0.0))
        while not (self.radio.mode == mode and used() and not self.radio.unconfirmed):
            self._wait(surface, mode, begun)
        self.radio.set_mode(MANUAL)
        lowering = abs(depth) / LOWERING
        started = self.time
        while (t := self.time - started) < lowering:
            way, speed, acceleration = _eased(t / lowering)
            force = 1.0 - acceleration * depth / lowering**2 / GRAVITY
            still_there = replace(
                still,
                position=(x, y, depth * way),
                velocity=(0.0, 0.0, speed * depth / lowering),
                specific_force=(force * ahead, force * starboard, force * down),
            )
            self._hold(still_there)
            self._stay_known()
        lowered = self.time
        while not (self.radio.armed and self.radio.mode == mode):
            self._wait(still, mode, lowered, arm=True)
        return self.time - begun

    def _hold(self, held: SensorState) -> None:
        """Answer one packet with the readings `held` of the level, held vehicle; send a DVL ping if one is due."""
        self.exchange(held, self.packet.duration)
        elapsed = self.time - self._pinged
        if self._has_dvl and elapsed >= PING:
            self.radio.moved(elapsed, held.velocity, (0.0, 0.0, 0.0), 100.0)
            self._pinged = self.time

    def _wait(self, held: SensorState, mode: int, begun: float, arm: bool = False) -> None:
        """Hold the vehicle for 20 packets; then, at most every `ASKED` s, request unconfirmed parameters, the mode and, with
        `arm`, arming.
        """
        if self.time - begun > SETTLING:
            raise TrainingError(f"{self.path}: did not {self._lacking(mode)}")
        for _ in range(20):
            self._hold(held)
        if not self._stay_known():
            return
        self.radio.ask()
        self.radio.set_mode(mode)
        if arm and self.radio.mode == mode:
            self.radio.arm()

    def _stay_known(self) -> bool:
        """Receive messages and, every `ASKED` s, send the pilot's heartbeat; return whether it was sent."""
        self.radio.listen()
        if self.time - self._asked < ASKED:
            return False
        self._asked = self.time
        self.radio.show_presence()
        return True

    def _lacking(self, mode: int) -> str:
        if self.radio.unconfirmed:
            wanted = (f"algo.parameters.{name}={value:g}" for name, value in self.radio.unconfirmed.items())
            return f"confirm {', '.join(wanted)}; does this version of ArduSub have such a parameter?"
        what = "arm" if self.radio.mode == mode else f"take mode {mode}"
        return f"{what} within {SETTLING:g} s{self._last_line()}"


def _eased(share: float) -> tuple[float, float, float]:
    """Return distance, speed and acceleration of a smooth motion when a fraction `share` of its duration has passed.

    The motion has length 1 and duration 1; it starts and ends at rest.
    """
    angle = math.pi * share
    return 0.5 - 0.5 * math.cos(angle), 0.5 * math.pi * math.sin(angle), 0.5 * math.pi**2 * math.cos(angle)


def _end(process: subprocess.Popen[bytes], folder: Path, sockets: tuple[socket.socket, ...]) -> None:
    process.kill()
    process.wait()
    for endpoint in sockets:
        endpoint.close()
    shutil.rmtree(folder, ignore_errors=True)


def settled(config: DictConfig, algo: ArduSub) -> DictConfig:
    """Return a copy of a composed configuration, with the SHA-256 of ArduSub's program added.

    Args:
        config: composed configuration.
        algo: `algo` of the configuration, checked.

    Raises:
        ConfigError: see `find`.
    """
    result = copy.deepcopy(config)
    with open_dict(result):
        result.algo.sha256 = find(algo.sha256)[1]
    return result


def find(sha256: str = "") -> tuple[Path, str]:
    """Return the path of ArduSub's SITL and its SHA-256.

    Args:
        sha256: required SHA-256; '' for any.

    Raises:
        ConfigError: no program is named, it cannot be read, or it has a different SHA-256.
    """
    named = os.environ.get(VARIABLE, "")
    if not named:
        raise ConfigError(
            f"algo=ardusub: {VARIABLE} names no program; run export {VARIABLE}=.../build/sitl/bin/ardusub"
        )
    path = Path(named).absolute()
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ConfigError(f"{VARIABLE}={named}: ArduSub's SITL cannot be read: {error.strerror}") from error
    if sha256 not in ("", digest):
        raise ConfigError(
            f"{VARIABLE}={named}: differs from the program of algo.sha256={sha256[:12]}...; set the variable to that program"
        )
    return path, digest
