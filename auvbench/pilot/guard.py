"""Start a pilot's supervisor and talk to it (`auvbench.pilot.supervisor`)."""

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
"""longest time in s to wait until a supervisor is ready; on a busy machine, a supervisor starts slowly"""
HANGS = 2.0
"""time in s after which `Guard.close` kills a lost supervisor that has not ended; the vehicle is at rest by then"""
BUFFER = 16_384
"""size of the send buffer in bytes; only about twelve messages fit, so that sending to a hanging supervisor soon times out"""


class Unsupervised(RunError):
    """The supervisor has ended or does not answer, so the pilot must end too.

    Attributes:
        fired: whether the supervisor has brought the vehicle to rest; if so, the pilot must not send commands any more.
    """

    def __init__(self, text: str, *, fired: bool) -> None:
        self.fired = fired
        super().__init__(text)


class Guard:
    """A running supervisor.

    Args:
        sender: path of an integration's file that defines the class `Sender` (`supervisor.Sender`).
        words: arguments with which the supervisor creates the `Sender`.
        patience: time in s without a message from the pilot after which the supervisor brings the vehicle to
            rest.
        descriptors: open files that the supervisor inherits.
        isolated: whether to start the supervisor without installed packages; must be False if the sender needs an installed
            package.

    Raises:
        RunError: the supervisor cannot be started.
    """

    def __init__(
        self,
        sender: str,
        *words: str,
        patience: float,
        descriptors: Sequence[int] = (),
        isolated: bool = False,
    ) -> None:
        self.patience = patience
        self.lost: Unsupervised | None = None
        self._holds = self._ready = False
        self._handed = -math.inf
        self._socket, theirs = socket.socketpair()
        flags = ["-I", "-S"] if isolated else ["-P"]
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
            self._socket.settimeout(patience)
            self._process = subprocess.Popen(
                [sys.executable, *flags, supervisor.__file__, str(theirs.fileno()), sender, *words],
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
        """Replace the will: the messages with which the supervisor brings the vehicle to rest."""
        for content in (b"", *contents):
            self._hand(WILL, content)

    def wait_until_ready(self, seconds: float = STARTS) -> bool:
        """Wait at most `seconds` until the supervisor can send to the vehicle; return whether the supervisor can send.

        Raises:
            Unsupervised: the supervisor has ended or does not answer.
        """
        self._hand(FORWARD, b"")
        if not self._ready and select.select([self._socket], [], [], seconds)[0]:
            self._ready = self._heard() == READY
            if not self._ready:
                raise self._fail()
        return self._ready

    def _heard(self) -> bytes:
        """Return the supervisor's next byte; b"" if the supervisor has ended or has sent no byte."""
        with contextlib.suppress(OSError):
            return self._socket.recv(1)
        return b""

    def hold(self) -> None:
        """Arm the supervisor: from now on, it sends the will if the pilot sends no message for `patience` s.

        Raises:
            Unsupervised: the supervisor has ended or does not answer.
        """
        self._holds = True
        self._hand(FORWARD, b"")

    def release(self) -> None:
        """Disarm the supervisor: the vehicle is at rest, so the pilot may stop sending messages or end."""
        self._holds = False
        if self.lost is None:
            self._hand(FORWARD, b"")

    def live(self) -> None:
        """Tell an armed supervisor that the pilot is alive, if the last message is older than a tenth of `patience`.

        Raises:
            Unsupervised: the supervisor has ended or does not answer.
        """
        if self._holds and self.lost is None and time.monotonic() - self._handed > 0.1 * self.patience:
            self._hand(FORWARD, b"")

    def forward(self, content: bytes) -> bool:
        """Send a command through the supervisor; return False if the caller must send the command itself.

        The caller must send the command if the supervisor is lost and has not brought the vehicle to rest.

        Raises:
            Unsupervised: the supervisor has ended or does not answer; only the first call that notices this raises.
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
        except OSError as error:
            raise self._fail(hangs=not isinstance(error, ConnectionError)) from None

    def _fail(self, *, hangs: bool = False) -> Unsupervised:
        """Record that the supervisor has ended or hangs, and whether it brought the vehicle to rest; return the error."""
        self._socket.settimeout(0.0)
        fired = FIRED in (self._heard(), self._heard())
        if hangs and not fired:
            # The supervisor may only be late. When it reads the end of the stream, it sends the will. The vehicle thus comes to rest
            # even if the pilot dies first. Commands that the supervisor reads before the end are too old to be sent.
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_WR)
            text = "the pilot's supervisor does not answer"
        else:
            if not fired:
                self._process.kill()  # the supervisor may have closed its socket, but still run
            code = self._process.wait(2 * supervisor.LONGEST)
            text = f"the pilot's supervisor ended (exit code {code})"
            fired = fired and code == SENT
        text = (
            f"the pilot was silent for more than {self.patience:g} s, and its supervisor brought the vehicle to rest"
            if fired
            else f"{text}; a pilot does not steer without a supervisor"
        )
        self.lost = Unsupervised(text, fired=fired)
        return self.lost

    def close(self) -> None:
        """Let the supervisor end, and wait for its end. An armed supervisor (`hold` without `release`) first sends the will."""
        self._socket.close()
        try:
            self._process.wait(2 * supervisor.LONGEST if self.lost is None else HANGS)
        except subprocess.TimeoutExpired:
            if self.lost is not None:
                self._process.kill()
