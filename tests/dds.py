"""ROS 2 in tests: a domain that nobody else on this machine has, and servers in processes of their own."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from auvbench.errors import ConfigError
from auvbench.ros2 import middleware


def missing() -> str | None:
    """Why there is no ROS 2 here; None where there is. Where the extra has wheels, its absence is a failure."""
    try:
        middleware.load()
    except ConfigError as error:
        return str(error)
    except Exception as error:
        return str(error)
    return None


ABSENT = missing()
HAS_WHEELS = sys.platform == "linux" and os.uname().machine == "x86_64"
needs_ros = pytest.mark.skipif(
    ABSENT is not None and not HAS_WHEELS, reason=f"no ROS 2 on this machine: {ABSENT}"
)
"""Skips where no wheels of ROS 2 are made for; where they are, a test without ROS 2 fails."""

DOMAINS = range(1, 101)
"""Above, ports would lie among those that the system hands out."""


@contextlib.contextmanager
def domain() -> Iterator[int]:
    """A ROS domain that no other test on this machine has: its lock is held while it is used."""
    if ABSENT is not None:
        pytest.fail(f"ROS 2 should be here (make install): {ABSENT}")
    numbers = list(DOMAINS)
    random.SystemRandom().shuffle(numbers)
    for number in numbers:
        path = Path(tempfile.gettempdir()) / f"auvbench-test-domain-{number}.lock"
        try:
            handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        except OSError:  # another user's
            continue
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(handle)
            continue
        before = {name: os.environ.get(name) for name in ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")}
        os.environ |= {"ROS_DOMAIN_ID": str(number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        try:
            yield number
        finally:
            for name, value in before.items():
                os.environ.pop(name, None) if value is None else os.environ.__setitem__(name, value)
            os.close(handle)
        return
    pytest.fail("all ROS domains of this machine are taken")


class Process:
    """`auvbench ...` in a process of its own, in the present domain; its output is kept."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "auvbench", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self._news = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._news:
                self.lines.append(line.rstrip())
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    @property
    def output(self) -> str:
        return "\n".join(self.lines)

    def says(self, text: str, seconds: float = 60.0) -> None:
        """Waits until a line holds `text`."""

        def there() -> bool:
            return any(text in line for line in self.lines) or not self._reader.is_alive()

        with self._news:
            self._news.wait_for(there, seconds)
        assert any(text in line for line in self.lines), f"{text!r} is not in:\n{self.output}"

    def send(self, number: int) -> None:
        self.process.send_signal(number)

    def ends(self, seconds: float = 30.0) -> int:
        """Waits for its end; the exit code."""
        code = self.process.wait(seconds)
        self._reader.join(5.0)
        return code

    def stop(self) -> None:
        if self.process.poll() is None:
            self.send(signal.SIGCONT)
            self.send(signal.SIGTERM)
            try:
                self.process.wait(15.0)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self._reader.join(5.0)


@contextlib.contextmanager
def serving(*arguments: str) -> Iterator[Process]:
    """`auvbench serve`, once it answers."""
    server = Process("serve", *arguments)
    try:
        server.says("does ")
        yield server
    finally:
        server.stop()
