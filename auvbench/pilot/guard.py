"""The pilot's end of its supervisor (`auvbench.pilot.supervisor`)."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import subprocess
import sys
import time
from collections.abc import Sequence

from auvbench.errors import RunError
from auvbench.pilot import supervisor
from auvbench.pilot.supervisor import FIRED, FORWARD, MESSAGE, READY, SENT, WILL

STARTS = 30.0
"""s in which a supervisor starts on a busy machine"""
BUFFER = 16_384
"""bytes on the way to the supervisor: about twelve messages, so that a supervisor that hangs is noticed"""


class Unsupervised(RunError):
    """The supervisor is gone, and the pilot must end.

    Attributes:
        fired: the supervisor has brought the vehicle to rest, and the pilot must not command any more.
    """

    def __init__(self, text: str, *, fired: bool) -> None:
        self.fired = fired
        super().__init__(text)


class Guard:
    """A running supervisor.

    Args:
        words: what it sends with: `mavlink NUMBER HOST PORT` or `ros DEPTH NODE TOPIC ...`.
        patience: s without a message of the pilot after which it brings the vehicle to rest.
        descriptors: open files that it inherits.

    Raises:
        RunError: it cannot be started.
    """

    def __init__(self, *words: str, patience: float, descriptors: Sequence[int] = ()) -> None:
        self.patience = patience
        self.lost: Unsupervised | None = None
        self._holds = self._ready = False
        self._handed = -math.inf
        self._socket, theirs = socket.socketpair()
        # A supervisor of MAVLink needs no package; one of ROS 2 finds rclpy where the pilot does.
        flags = ["-I", "-S"] if words[0] == "mavlink" else ["-P"]
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            self._socket.settimeout(patience)
            self._process = subprocess.Popen(
                [sys.executable, *flags, supervisor.__file__, str(theirs.fileno()), *words],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=[theirs.fileno(), *descriptors],
                start_new_session=True,
            )
        except OSError as error:
            self._socket.close()
            raise RunError(f"the pilot's supervisor cannot be started: {error.strerror or error}") from error
        finally:
            theirs.close()

    def leave_will(self, contents: Sequence[bytes]) -> None:
        """Set the messages that bring the vehicle to rest, in place of those before."""
        for content in (b"", *contents):
            self._hand(WILL, content)

    def wait_until_ready(self, seconds: float = STARTS) -> bool:
        """Wait until the supervisor can send, at most `seconds`; return whether it can.

        Raises:
            Unsupervised: it has ended.
        """
        self._hand(FORWARD, b"")
        if not self._ready and select.select([self._socket], [], [], seconds)[0]:
            self._ready = self._heard() == READY
            if not self._ready:
                raise self._fail()
        return self._ready

    def _heard(self) -> bytes:
        """Return the supervisor's next byte; none if it has ended or has not sent one."""
        with contextlib.suppress(OSError):
            return self._socket.recv(1)
        return b""

    def hold(self) -> None:
        """From now on the will is sent if the pilot falls silent.

        Raises:
            Unsupervised: the supervisor has ended.
        """
        self._holds = True
        self._hand(FORWARD, b"")

    def release(self) -> None:
        """The vehicle is at rest: the pilot may be silent, and end."""
        self._holds = False
        if self.lost is None:
            self._hand(FORWARD, b"")

    def live(self) -> None:
        """Tell the supervisor that the pilot is alive.

        Raises:
            Unsupervised: the supervisor has ended.
        """
        if self._holds and self.lost is None and time.monotonic() - self._handed > 0.1 * self.patience:
            self._hand(FORWARD, b"")

    def forward(self, content: bytes) -> bool:
        """Let the supervisor send; return False if it is gone and the caller must send.

        Raises:
            Unsupervised: the supervisor has ended; raised once.
        """
        if self.lost is not None:
            return self.lost.fired
        self._hand(FORWARD, content)
        return True

    def _hand(self, kind: int, content: bytes) -> None:
        if self.lost is not None:
            raise self.lost
        assert len(content) <= supervisor.LARGEST
        self._handed = time.monotonic()
        due = self._handed + self.patience if self._holds else math.inf
        try:
            self._socket.sendall(MESSAGE.pack(due, kind, len(content), content))
        except OSError:
            raise self._fail() from None

    def _fail(self) -> Unsupervised:
        """Note that the supervisor is gone, and whether it brought the vehicle to rest."""
        self._socket.settimeout(0.0)
        fired = FIRED in (self._heard(), self._heard())
        if not fired:
            self._process.kill()  # where it hangs
        code = self._process.wait(2 * supervisor.LONGEST)
        if fired and code == SENT:
            text = f"the pilot was silent for more than {self.patience:g} s, and its supervisor brought the vehicle to rest"
        else:
            text = f"the pilot's supervisor ended (exit code {code}), and a pilot does not steer without one"
        self.lost = Unsupervised(text, fired=fired and code == SENT)
        return self.lost

    def close(self) -> None:
        """Let the supervisor end, and wait for it; it sends the will unless it was released."""
        self._socket.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(2 * supervisor.LONGEST)
