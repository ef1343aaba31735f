"""The supervisor of a pilot: a process of its own, which sends what the pilot commands while the pilot is alive.

The pilot hands it messages, each with the time until which the next one must come. When none comes in time, whatever the
reason (the pilot was killed, halted, or hangs), or when the pilot is gone, the supervisor sends the will that the pilot
left with it: commands that bring the vehicle to rest. Then it says so, and ends. It writes no file, and imports the
standard library, and for ROS 2 rclpy and std_msgs. Nothing of auvbench is imported here: the file is a program.
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
"""bytes of a content"""
MESSAGE = struct.Struct(f"=dBH{LARGEST}s")
"""when the next message is due (s of the monotonic clock; infinity: the vehicle is at rest), kind, length, content"""
FORWARD, WILL = 0, 1
"""kinds: content that is sent at once (none: a sign of life), and content that is sent at last (none: forget the will)"""
READY = b"r"
"""what the supervisor answers when it can send"""
FIRED = b"f"
"""what it tells before it sends the will"""
SENT = 3
"""exit code after the will"""
PAUSE = 0.04
"""s between two messages of the will"""
LONGEST = 5.0
"""s for the end: after it SIGALRM ends what hangs"""


class Datagrams:
    """An open socket: packets to one vehicle, packed by the pilot."""

    done = "neutral sticks and the order to disarm were sent"

    def __init__(self, number: str, host: str, port: str) -> None:
        self.socket = socket.socket(fileno=int(number))
        self.socket.settimeout(0.1)  # a full buffer must not hold the deadline
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
        # A connection that is closed with unread bytes is reset, and the last messages may be lost.
        with contextlib.suppress(OSError):
            if self.socket.type == socket.SOCK_STREAM:
                self.socket.shutdown(socket.SHUT_WR)
                end = time.monotonic() + 1.0
                while time.monotonic() < end and self.socket.recv(1 << 16):
                    pass


class Topics:
    """Topics of ROS 2: a std_msgs/Float64 for each thruster."""

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
    """Send what the pilot hands over; return why that ended, or an empty text if the vehicle is at rest."""
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
            elif time.monotonic() < due:  # else it is too old to be sent
                heard = time.monotonic()
                if length:
                    sender.send(content[:length])


def main(control: str, kind: str, *arguments: str) -> int:
    # Ctrl-C and a closing terminal end the pilot, whose end the supervisor has to see.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    will: list[bytes] = []
    pilot = socket.socket(fileno=int(control))
    try:
        sender = (Datagrams if kind == "mavlink" else Topics)(*arguments)
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
    """Write a line to standard error, unless that is closed or full."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, f"pilot: {text}\n".encode())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
