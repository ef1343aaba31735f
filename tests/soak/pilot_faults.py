"""What can befall a pilot, drawn at random."""

from __future__ import annotations

import contextlib
import errno
import os
import random
import shutil
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

SIGNALS = {"SIGKILL": 9, "SIGSTOP": 19, "SIGFPE": 8, "SIGTERM": 15, "SIGINT": 2, "SIGSEGV": 11}
ERRORS = {"ENOSPC": errno.ENOSPC, "EIO": errno.EIO, "ENOMEM": errno.ENOMEM, "EPIPE": errno.EPIPE}
CALLS = {"arm": 80, "flight": 800, "close": 60}
"""phases, and how many calls of the operating system one has, about"""
MODULES = {"posix", "_socket", "socket", "select", "_io", "time", "_posixsubprocess", "rclpy._rclpy_pybind11"}
CALLBACKS = ("act", "reset", "say", "add", "receive", "command", "take_pose")
ENDINGS = ("depth", "flight is over", "SIGTERM", "silence", "controller")
DISKS = ("full disk", "folder replaced", "full output")


class Injected(Exception):
    """The error of a callback."""


@dataclass
class Fault:
    """One fault."""

    kind: str
    what: str
    at: str = "flight"
    """phase, or ending"""
    count: int = 0
    """the number of the call in its phase"""
    instant: float | None = None
    """s after arming"""
    _folder: Path = field(default=Path(), init=False)
    _pilot: Any = field(default=None, init=False)
    _steps: int = field(default=0, init=False)

    @property
    def name(self) -> str:
        return f"{self.kind}: {self.what}" + (f" at {self.at}" if self.kind in ("call", "disk") else "")

    def install(self, pilot: Any, folder: Path) -> None:
        """Prepare, in the pilot's process."""
        self._pilot, self._folder = pilot, folder
        pilot.close, close = lambda reason: (self.phase("close"), close(reason)), pilot.close
        if self.kind == "callback":
            self._wrap()

    def phase(self, name: str) -> None:
        """The pilot comes to a phase."""
        if self.kind == "call" and name == self.at:
            sys.setprofile(self._count)
        if self.kind == "supervisor" and name == "flight":
            (self._folder / "struck").touch()
            os.kill(self._pilot.guard._process.pid, SIGNALS[self.what])

    def strike(self, number: int, folder: Path) -> None:
        """Send a signal to the pilot."""
        (folder / "struck").touch()
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, SIGNALS[self.what])

    def _count(self, _frame: Any, event: str, function: Any) -> None:
        if event != "c_call":
            return
        owner = getattr(function, "__self__", None)
        modules = {
            getattr(function, "__module__", None),
            type(owner).__module__,
            getattr(owner, "__name__", None),
        }
        if not modules & MODULES and function is not print:
            return
        self.count -= 1
        if self.count == 0:
            sys.setprofile(None)
            self._befall()

    def _befall(self) -> None:
        (self._folder / "struck").touch()
        if self.what in SIGNALS:
            os.kill(os.getpid(), SIGNALS[self.what])
        elif self.what == "hang":
            self._hang()
        elif self.what == "interrupted":
            raise KeyboardInterrupt
        else:
            raise OSError(ERRORS[self.what], os.strerror(ERRORS[self.what]))

    def _hang(self) -> None:
        (self._folder / "hangs").touch()
        time.sleep(3600.0)

    def _wrap(self) -> None:
        pilot = self._pilot
        place, name = {
            "act": (pilot.steering.controller, "act"),
            "reset": (pilot.steering.controller, "reset"),
            "say": (pilot, "_speak"),
            "add": (pilot.steering.logbook, "add"),
            "receive": (pilot, "_receive"),
            "command": (pilot, "_command"),
            "take_pose": (pilot, "_take_pose"),
        }[self.at]
        original = getattr(place, name)

        def wrapped(*words: Any) -> Any:
            self.count -= 1
            if self.count == 0:
                if self.what == "exception":
                    (self._folder / "struck").touch()
                    raise Injected(self.at)
                self._befall()
            return original(*words)

        setattr(place, name, wrapped)

    def goes_on(self, usual: bool) -> bool:
        """Return whether the pilot goes on, and come to an ending with a disk that fails."""
        if self.kind != "disk":
            return usual
        self._steps += 1
        mission = self._pilot.steering.mission
        if self._steps < self.count or mission is None or not mission.steps:
            return usual
        if self._steps >= self.count and not (self._folder / "struck").exists():
            (self._folder / "struck").touch()
            self._fill()
            self._end()
        return usual and self.at != "flight is over"

    def _fill(self) -> None:
        missions = self._folder / "missions"
        if self.what == "full output":
            number = os.open("/dev/full", os.O_WRONLY)
            os.dup2(number, 1)
            return
        if self.what == "folder replaced":
            shutil.rmtree(missions)
            missions.write_text("a file")
            return
        for name in ("episodes.csv", "trajectories.npz", "mission.json"):
            (missions / f".{name}.staged").symlink_to("/dev/full")

    def _end(self) -> None:
        pilot = self._pilot
        if self.at == "depth":
            object.__setattr__(pilot.limits, "depth_high", -30.0)
        elif self.at == "SIGTERM":
            os.kill(os.getpid(), signal.SIGTERM)
        elif self.at == "silence":
            pilot._take_pose = lambda *words: None
        elif self.at == "controller":
            pilot.steering.controller.act = lambda seen: 1 / 0


def draw(rng: random.Random) -> Fault:
    """Return a fault."""
    kind = rng.choices(["instant", "call", "callback", "disk", "supervisor"], [25, 40, 15, 15, 5])[0]
    if kind == "instant":
        return Fault(kind, rng.choice([*SIGNALS]), instant=rng.uniform(0.0, 0.7))
    if kind == "call":
        phase = rng.choices([*CALLS], [1, 2, 2])[0]
        what = rng.choice([*SIGNALS, *ERRORS, "hang", "interrupted"])
        return Fault(kind, what, phase, count=rng.randint(1, CALLS[phase]))
    if kind == "callback":
        at = rng.choice(CALLBACKS)
        what = rng.choice(["exception", "exception", "hang", "SIGFPE", "interrupted"])
        return Fault(kind, what, at, count=1 if at in ("reset", "add") else rng.randint(1, 12))
    if kind == "disk":
        return Fault(kind, rng.choice(DISKS), rng.choice(ENDINGS), count=rng.randint(2, 60))
    return Fault(kind, rng.choice(["SIGKILL", "SIGSTOP", "SIGTERM"]))
