"""Send and receive messages over UDP or TCP. Bytes outside messages are dropped."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Iterator
from typing import Any

from auvbench.errors import RunError, UserError
from auvbench.integrations.ardusub.radio import dialect
from auvbench.integrations.mavlink import sender
from auvbench.pilot.guard import STARTS, Guard

Peer = tuple[str, int]
"""address and port"""

SYSTEM = 255
"""system id of the pilot; ArduSub accepts commands only from the id in its parameter MAV_GCS_SYSID (older:
SYSID_MYGCS)
"""
COMPONENT = 190
"""MAV_COMP_ID_MISSIONPLANNER, the component id of a ground station"""
LONGEST = 4096
"""largest number of bytes to read at once; no datagram with MAVLink messages is longer"""
TURN = 0.05
"""time in s after which `receive` returns, so that a flood of messages does not block the caller"""


class Link:
    """An open port or connection.

    Args:
        address: `udp:HOST:PORT` listens, as a ground station does; `tcp:HOST:PORT` connects.

    Raises:
        UserError: the address has another form, or cannot be opened.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        kind, peer = _read(address)
        self.dialect = dialect("auvbench pilot --mavlink")
        self._out = self.dialect.MAVLink(None, srcSystem=SYSTEM, srcComponent=COMPONENT)
        try:
            if kind == "udp":
                self._stream = None
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.bind(peer)
            else:
                self._stream = self._parser()
                self._socket = socket.create_connection(peer, timeout=5.0)
        except OSError as error:
            what = "cannot listen" if kind == "udp" else "cannot connect"
            raise UserError(f"--mavlink {address}: {what}: {error.strerror or error}") from error
        self._server = peer
        self.guard: Guard | None = None
        # Sending to a full buffer must not block the loop.
        self._socket.settimeout(0.5)

    def receive(self, seconds: float) -> Iterator[tuple[Peer, Any]]:
        """Yield the sender and the message for all messages that have arrived; wait at most `seconds` for the first.

        Raises:
            RunError: the other end closed the connection, or the supervisor has ended.
        """
        if self.guard is not None:
            self.guard.live()
        end = time.monotonic() + seconds + TURN
        while time.monotonic() < end:
            if not select.select([self._socket], [], [], seconds)[0]:
                return
            seconds = 0.0
            try:
                data, peer = self._socket.recvfrom(LONGEST)
            except OSError:  # a UDP error: an earlier message found no listener
                if self._stream is not None:
                    raise self._lost() from None
                continue
            if self._stream is not None and not data:
                raise self._lost()
            # A datagram has only whole messages. Each datagram gets a new parser, so that one sender's garbage cannot
            # swallow another sender's message.
            parser = self._stream or self._parser()
            for message in parser.parse_buffer(data) or ():
                if not message.get_type().startswith(("BAD_DATA", "UNKNOWN")):
                    yield peer or self._server, message

    def send(self, message: Any, peer: Peer) -> None:
        """Send a message, through the supervisor if the supervisor was started.

        A message that the network does not accept is lost.

        Raises:
            Unsupervised: the supervisor has ended or does not answer.
        """
        data = self.pack(message)
        if self.guard is not None and self.guard.forward(data):
            return
        with contextlib.suppress(OSError):
            if self._stream is None:
                self._socket.sendto(data, peer)
            else:
                self._socket.sendall(data)

    def pack(self, message: Any) -> bytes:
        """Return the bytes of the pilot's next message."""
        data = bytes(message.pack(self._out))
        self._out.seq = (self._out.seq + 1) % 256
        return data

    def supervise(self, peer: Peer, patience: float) -> Guard:
        """Start the supervisor, which sends all messages from now on; see `Guard` for `patience`.

        Raises:
            RunError: the supervisor does not start.
        """
        number = self._socket.fileno()
        words = (sender.__file__, str(number), peer[0], str(peer[1]))
        self.guard = Guard(*words, patience=patience, descriptors=[number], isolated=True)
        if not self.guard.wait_until_ready():
            raise RunError(f"the pilot's supervisor did not start in {STARTS:g} s")
        return self.guard

    def close(self) -> None:
        if self.guard is not None:
            self.guard.close()
        self._socket.close()

    def _parser(self) -> Any:
        parser = self.dialect.MAVLink(None)
        parser.robust_parsing = True
        return parser

    def _lost(self) -> RunError:
        return RunError(f"--mavlink {self.address}: the other end closed the connection")


def _read(address: str) -> tuple[str, Peer]:
    kind, _, rest = address.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("udp", "tcp") or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UserError(
            f"--mavlink {address}: must be udp:HOST:PORT to listen or tcp:HOST:PORT to connect, e.g. udp:127.0.0.1:14550"
        )
    return kind, (host, int(port))
