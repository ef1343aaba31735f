"""Supervise a pilot from a separate process, which sends the pilot's commands while the pilot is alive.

The pilot hands over messages, each with the time by which the next one must come. If none comes in time (the
pilot was killed, stopped, or hangs), or if the pilot is gone, the supervisor sends the will that the pilot
left: commands that bring the vehicle to rest. Then it prints a line and ends. It writes no file. It imports
only the standard library and, for ROS 2, rclpy and std_msgs; it must not import auvbench, since this file is
a program of its own.
"""

import contextlib
import math
import os
import select
import signal
import socket
import struct
import sys
import time
from typing import Any

LARGEST = 501
"""largest content in bytes"""
MESSAGE = struct.Struct(f"=dBH{LARGEST}s")
"""time when the next message is due (s of the monotonic clock; infinity: the vehicle is at rest), kind,
length, content
"""
FORWARD, WILL = 0, 1
"""kinds of content: sent at once (empty: a sign of life), and sent at the end (empty: forget the will)"""
READY = b"r"
"""answer of the supervisor when it can send"""
FIRED = b"f"
"""answer of the supervisor before it sends the will"""
SENT = 3
"""exit code after the will was sent"""
PAUSE = 0.04
"""s between two messages of the will"""
LONGEST = 5.0
"""time in s for the end; after it, SIGALRM kills a supervisor that hangs"""


class Datagrams:
    """Sender over an open socket: packets to one vehicle, packed by the pilot."""

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
        # Closing a connection with unread bytes resets it, and the last messages may be lost.
        with contextlib.suppress(OSError):
            if self.socket.type == socket.SOCK_STREAM:
                self.socket.shutdown(socket.SHUT_WR)
                end = time.monotonic() + 1.0
                while time.monotonic() < end and self.socket.recv(1 << 16):
                    pass


class Topics:
    """Sender over ROS 2 topics: a std_msgs/Float64 for each thruster."""

    done = "zero thrust was sent"

    def __init__(self, depth: str, node: str, *topics: str) -> None:
        from rclpy import init
        from rclpy.context import Context
        from rclpy.duration import Duration
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions
        from std_msgs.msg import Float64

        self.message, self.share = Float64, Duration(seconds=1.0 / len(topics))
        context = Context()
        init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        options: dict[str, Any] = {"use_global_arguments": False, "start_parameter_services": False}
        self.node: Any = Node(node, context=context, enable_rosout=False, **options)
        self.publishers = [self.node.create_publisher(Float64, topic, int(depth)) for topic in topics]
        self.shutdown = context.shutdown

    def ready(self) -> bool:
        return all(publisher.get_subscription_count() > 0 for publisher in self.publishers)

    def send(self, data: bytes) -> None:
        for publisher, (value,) in zip(self.publishers, struct.iter_unpack("=d", data), strict=True):
            publisher.publish(self.message(data=value))

    def close(self) -> None:
        for publisher in self.publishers:
            publisher.wait_for_all_acked(self.share)
        self.node.destroy_node()
        self.shutdown()


def watch(control: socket.socket, sender: Datagrams | Topics, will: list[bytes]) -> str:
    """Send the pilot's messages; return why that ended, or '' if the vehicle is at rest."""
    due, received, ready = math.inf, b"", False
    heard = time.monotonic()
    while True:
        if not ready and sender.ready():
            ready = True
            control.send(READY)
        wait = min(due - time.monotonic(), math.inf if ready else 0.02)
        if not select.select([control], [], [], None if wait == math.inf else max(wait, 0.0))[0]:
            if (now := time.monotonic()) >= due:
                return f"the pilot has been silent for {now - heard:.2f} s"
            continue
        news = b""
        with contextlib.suppress(ConnectionError):
            news = control.recv(1 << 16)
        if not news:
            return "the pilot has ended" if due < math.inf else ""
        received += news
        while len(received) >= MESSAGE.size:
            due, kind, length, content = MESSAGE.unpack(received[: MESSAGE.size])
            received = received[MESSAGE.size :]
            if kind == WILL:
                will[:] = [*will, content[:length]] if length else []
            elif time.monotonic() < due:  # otherwise the message is too old to send
                heard = time.monotonic()
                if length:
                    sender.send(content[:length])


def main(control: str, kind: str, *arguments: str) -> int:
    # Ctrl-C and a closing terminal end the pilot; the supervisor must survive to see that.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    will: list[bytes] = []
    pilot = socket.socket(fileno=int(control))
    try:
        sender = (Datagrams if kind == "datagrams" else Topics)(*arguments)
    except Exception as error:
        say(f"its supervisor cannot start: {error!r}")
        return 1
    try:
        reason = watch(pilot, sender, will)
    except Exception as error:
        reason = f"its supervisor failed: {error!r}"
    signal.alarm(math.ceil(LONGEST))
    if reason:
        with contextlib.suppress(OSError):
            pilot.send(FIRED)
        for content in will:
            with contextlib.suppress(Exception):
                sender.send(content)
            time.sleep(PAUSE)
    with contextlib.suppress(Exception):
        sender.close()
    if reason:
        say(f"{reason}; {sender.done}")
    return SENT if reason else 0


def say(text: str) -> None:
    """Write a line to standard error, unless it is closed or full."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, f"pilot: {text}\n".encode())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
