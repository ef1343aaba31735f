"""A stand-in for ArduSub's JSON backend: it sends the same bytes and reads the replies, written apart from auvbench's own."""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import threading
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.validate import train_config
from auvbench.integrations.ardusub.physics import Physics
from auvbench.integrations.ardusub.server import Server
from auvbench.integrations.commands.serve import ARDUSUB_START
from tests.waiting import LIMIT, until

NEUTRAL = (1500,) * 16


@cache
def configuration(*overrides: str) -> schema.TrainConfig:
    """Return the configuration as `auvbench serve --face ardusub` has it."""
    return train_config(compose("train", [*ARDUSUB_START, *overrides], folder=None))


class Peer:
    """An ArduSub that flies the vehicle on a port."""

    def __init__(self, port: int, rate: int = 400) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(LIMIT)
        self.port = port
        self.rate = rate
        self.count = 0

    def send(self, pwm: Sequence[int] = NEUTRAL, count: int | None = None) -> None:
        """Send a packet as libraries/SITL/SIM_JSON.h declares it."""
        magic = {16: 18458, 32: 29569}[len(pwm)]
        number = self.count if count is None else count
        self.raw(struct.pack(f"<HHI{len(pwm)}H", magic, self.rate, number, *pwm))

    def raw(self, datagram: bytes) -> None:
        self.socket.sendto(datagram, ("127.0.0.1", self.port))

    def receive(self) -> dict[str, Any]:
        line = self.socket.recv(65000)
        assert line[:1] == b"\n"
        assert line[-1:] == b"\n"
        assert line.count(b"\n") == 2
        return json.loads(line)

    def step(self, pwm: Sequence[int] = NEUTRAL) -> dict[str, Any]:
        """Exchange a packet for its reply."""
        self.send(pwm)
        self.count += 1
        return self.receive()

    def silent(self, seconds: float = 0.2) -> bool:
        """Return whether nothing arrives for a while."""
        self.socket.settimeout(seconds)
        try:
            self.socket.recv(65000)
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(LIMIT)
        return False

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()


class Serving:
    """A server in a thread, with the lines that it says and the error that ended it."""

    def __init__(self, vehicles: Sequence[Physics], **options: Any) -> None:
        self.lines: list[str] = []
        self.progress: list[str] = []
        self.error: Exception | None = None
        self._stop = threading.Event()
        options = {"port": 0, "report": self.progress.append, **options}
        self.server = Server(vehicles, say=self.lines.append, **options)
        self.server.compile()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.server.run(lambda: not self._stop.is_set())
        except Exception as error:
            self.error = error

    @property
    def port(self) -> int:
        return self.server.ports[0].number

    def said(self, words: str) -> str:
        """Wait for a line with these words, and return it."""
        return until(
            lambda: next((line for line in self.lines if words in line), ""), f"a line with {words!r}"
        )

    def failure(self) -> Exception:
        """Wait for the error that ends the server."""
        return until(lambda: self.error, "an error")

    def close(self) -> None:
        self._stop.set()
        with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
            waker.sendto(b"", ("127.0.0.1", self.port))  # so that it looks at once
        self._thread.join(LIMIT)
        self.server.close()


@contextlib.contextmanager
def serving(*overrides: str, **options: Any) -> Iterator[Serving]:
    """Serve one vehicle on a free port."""
    server = Serving([Physics(configuration(*overrides))], **options)
    try:
        yield server
    finally:
        server.close()
