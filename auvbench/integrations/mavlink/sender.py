"""Send a pilot's MAVLink packets: the `Sender` of the pilot's supervisor, whose process must not import auvbench."""

import contextlib
import socket
import time


class Sender:
    """Sends packets, which the pilot has packed, to one vehicle over an open socket."""

    done = "neutral sticks and the order to disarm were sent"

    def __init__(self, number: str, host: str, port: str) -> None:
        self.socket = socket.socket(fileno=int(number))
        self.socket.settimeout(0.1)  # a full buffer must not delay the deadline
        self.peer = (host, int(port))

    def ready(self) -> bool:
        return True

    def send(self, data: bytes) -> None:
        with contextlib.suppress(OSError):
            if self.socket.type == socket.SOCK_DGRAM:
                self.socket.sendto(data, self.peer)
            else:
                self.socket.sendall(data)

    def close(self) -> None:
        # Closing a connection that has unread bytes resets the connection, and the last messages may be lost.
        with contextlib.suppress(OSError):
            if self.socket.type == socket.SOCK_STREAM:
                self.socket.shutdown(socket.SHUT_WR)
                end = time.monotonic() + 1.0
                while time.monotonic() < end and self.socket.recv(1 << 16):
                    pass
