"""Supervise a pilot from a separate process, which sends the pilot's commands while the pilot is alive.

The pilot hands over messages, each with the time by which the next message must come. The pilot also leaves a will:
commands that bring the vehicle to rest. The supervisor sends the will in three cases:

* No message comes in time: the pilot was killed, stopped, or hangs.
* The pilot ends while the vehicle is not at rest.
* The pilot reports that the vehicle is at rest, but its last command came too late to be sent.

Then the supervisor prints a line and ends. It writes no file. It imports only the standard library and the imports of
the integration's file with the class `Sender`. Neither file may import auvbench, since the supervisor runs this file as a separate program.
"""

import contextlib
import math
import os
import runpy
import select
import signal
import socket
import struct
import sys
import time
from typing import Protocol

LARGEST = 501
"""largest content of a message in bytes"""
MESSAGE = struct.Struct(f"=dBH{LARGEST}s")
"""Layout of a message: time when the next message is due (s of the monotonic clock; infinity: the vehicle is at rest), kind,
length, content
"""
FORWARD, WILL = 0, 1
"""kinds of content: a command to send at once (empty: the pilot is alive), and a command of the will (empty: delete the will)"""
READY = b"r"
"""answer of the supervisor when it can send"""
FIRED = b"f"
"""answer of the supervisor before it sends the will"""
SENT = 3
"""exit code after the will was sent"""
PAUSE = 0.04
"""time between two messages of the will, s"""
LONGEST = 5.0
"""longest time in s from the return of `watch` to the end of the supervisor; after this time, SIGALRM kills the supervisor"""


class Sender(Protocol):
    """Connection to a vehicle: the class `Sender` in an integration's file. Its arguments follow the file on the command line."""

    done: str
    """effect of the will as text, for the supervisor's last line"""

    def ready(self) -> bool:
        """Return whether the vehicle can receive commands."""

    def send(self, data: bytes) -> None:
        """Send one command of the pilot, or of the will, to the vehicle."""

    def close(self) -> None:
        """Wait until all sent data have left this machine, and close the connection."""


def watch(control: socket.socket, sender: Sender, will: list[bytes]) -> str:
    """Send the pilot's messages until the will is due or the pilot ends.

    Return the reason for sending the will, or '' if the pilot ended with the vehicle at rest.
    """
    due, received, ready = math.inf, b"", False
    unsent = False  # whether the pilot's last command came too late
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
                    unsent = False
                elif unsent and due == math.inf:  # the pilot believes that the vehicle is at rest
                    return "the pilot's last commands came too late to be sent"
            elif length:
                unsent = True


def main(control: str, file: str, *arguments: str) -> int:
    # Ctrl-C and a closing terminal end the pilot; the supervisor must survive to notice the pilot's end.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    will: list[bytes] = []
    pilot = socket.socket(fileno=int(control))
    try:
        sender: Sender = runpy.run_path(file)["Sender"](*arguments)
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
    """Write a line to standard error, unless standard error is closed or full."""
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, f"pilot: {text}\n".encode())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
