"""ROS 2 in tests: domains that no other test uses, and servers in processes of their own."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from auvbench.errors import ConfigError
from auvbench.integrations.ros2 import middleware
from tests.waiting import LIMIT


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

_claims: list[socket.socket] = []
"""of the domains in use; servers inherit them, so that a domain is taken while any process of a test lives in it"""


def occupied(number: int) -> bool:
    """Return whether a process that claims no domain, such as a server left over, listens on this domain's ports."""
    for participant in range(20):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7410 + 250 * number + 2 * participant))  # DDSI-RTPS 2.5, section 9.6.2.3
            except OSError:
                return True
    return False


@contextlib.contextmanager
def domain() -> Iterator[int]:
    """Use a ROS domain that no other test in this network namespace has."""
    if ABSENT is not None:
        pytest.fail(f"ROS 2 should be here (make install): {ABSENT}")
    numbers = list(DOMAINS)
    random.SystemRandom().shuffle(numbers)
    for number in numbers:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0auvbench-test-domain-{number}")  # exclusive, and gone with its last holder
        except OSError:
            claim.close()
            continue
        if occupied(number):
            claim.close()
            continue
        _claims.append(claim)
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv("ROS_DOMAIN_ID", str(number))
            environment.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            try:
                yield number
            finally:
                _claims.remove(claim)
                claim.close()
        return
    pytest.fail("all ROS domains of this machine are taken")


def command(*arguments: str, before: str = "") -> list[str]:
    """Return the command line of `auvbench ...` in a process that dies with this one.

    Args:
        arguments: those of auvbench.
        before: Python that runs first.
    """
    code = (
        f"import sys; from auvbench.runs import interruption; interruption.die_with_parent({os.getpid()}); {before}\n"
        "from auvbench.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    return [sys.executable, "-c", code, *arguments]


def original(arguments: Sequence[str]) -> Sequence[str]:
    """Return the words that give a command the original study's vehicle, whose topics the tests name."""
    if any(word.startswith("vehicle=") or word == "--vehicle" for word in arguments):
        return ()
    return {"serve": ("vehicle=bluerov2",), "pilot": ("--vehicle", "bluerov2")}.get(arguments[0], ())


class Process:
    """`auvbench ...` in a process of its own, in the present domain, with open `descriptors`; its output is kept."""

    def __init__(self, *arguments: str, before: str = "", descriptors: Sequence[int] = ()) -> None:
        self.process = subprocess.Popen(
            command(*arguments, *original(arguments), before=before),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            pass_fds=[*(claim.fileno() for claim in _claims), *descriptors],
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

    def says(self, text: str) -> None:
        """Wait until a line holds `text`."""

        def there() -> bool:
            return any(text in line for line in self.lines) or not self._reader.is_alive()

        with self._news:
            self._news.wait_for(there, LIMIT)
        assert any(text in line for line in self.lines), f"{text!r} is not in:\n{self.output}"

    def send(self, number: int) -> None:
        self.process.send_signal(number)

    def ends(self) -> int:
        """Wait for its end; return the exit code."""
        code = self.process.wait(LIMIT)
        self._reader.join(LIMIT)
        return code

    def stop(self) -> None:
        if self.process.poll() is None:
            self.send(signal.SIGCONT)
            self.send(signal.SIGTERM)
        self.ends()


def matched(*ends: Any) -> bool:
    """Return whether each publisher, subscription and client has its other end.

    A reliable publisher sends a message again until the readers that it knows have it. A reader that it discovers later
    gets none of the earlier messages, and a service drops the answer to a client that it does not know yet.
    """
    count = ("get_subscription_count", "get_publisher_count", "service_is_ready")
    return all(getattr(end, next(name for name in count if hasattr(end, name)))() for end in ends)


@contextlib.contextmanager
def serving(*arguments: str) -> Iterator[Process]:
    """Run `auvbench serve`, once it answers."""
    server = Process("serve", *arguments)
    try:
        server.says("services ")
        yield server
    finally:
        server.stop()
