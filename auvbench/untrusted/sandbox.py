"""Read untrusted binary files in separate processes. This module runs in the command, `reader.py` in these processes.

    with Child(TABLE, data, columns=None, most=100) as child:
        note, arrays = child.answer()

The first file starts a server, which forks a child for each file in a few milliseconds. Each child has limits of memory
and time, and can open neither files nor sockets. If a child ends too early, for any reason, the command gets a
`ValueError` of one line. Nothing that a child sends is trusted: the command checks type, shape and length of the arrays
of numbers, and never unpickles.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from auvbench.errors import RunError

try:
    from auvbench.untrusted import reader
except ModuleNotFoundError as _error:
    if _error.name != "resource":
        raise
    raise RunError(
        "models are read with limits of POSIX (resource), which Windows does not have; use WSL"
    ) from _error

from auvbench.untrusted.reader import ENDED, KILL, Arrays
from auvbench.untrusted.text import short

TABLE, PATHS, POLICY = b"T", b"A", b"P"
"""Jobs of a child: read a Parquet file, the trajectories of an .npz, or an ONNX file"""

MEMORY = 1024**3
"""largest number of bytes that a child may allocate or send"""
SECONDS = 60
"""Limit of processor time in s for a file, and for each answer of a policy"""
PATIENCE = 5
"""Ratio of a child's wall-time limit to its processor-time limit; above 1, since the machine may be busy"""
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
ENVIRONMENT = ONE_THREAD | {
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    # A process with threads must not fork: a lock may be held by a thread that does not exist in the child.
    "JE_ARROW_MALLOC_CONF": "background_thread:false",
    "ORT_DISABLE_TELEMETRY": "1",
    "PYTHONSAFEPATH": "1",
}


class Child:
    """Process that reads one file.

    Args:
        job: `TABLE`, `PATHS` or `POLICY`.
        data: content of the file.
        seconds: limit of processor time in s, first for the file and then for each answer. The limit of wall time is
            `PATIENCE` times as long.
        options: options of the job.

    Raises:
        ValueError: the process cannot be started or has ended; the message is one line.
    """

    def __init__(self, job: bytes, data: bytes, *, seconds: int | None = None, **options: Any) -> None:
        import numpy as np

        self._seconds = seconds or SECONDS
        self._memory = MEMORY
        self._why = ""
        self._channel, self.pid, self._server = _fork(job)
        self._renew()
        request = {"seconds": self._seconds, "memory": self._memory, "options": options}
        self._send(request, {"data": np.frombuffer(data, dtype=np.uint8)})

    def __enter__(self) -> Child:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if not self._why:
            self._end(ENDED, "it was closed")

    def __del__(self) -> None:
        with contextlib.suppress(Exception):  # the interpreter may be exiting
            self.close()

    def ask(self, note: Mapping[str, Any], arrays: Mapping[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """Send a request and return the child's answer (see `answer`); the limits of time and bytes start anew."""
        if self._why:
            raise ValueError(self._why)
        self._renew()
        self._send({**note, "seconds": self._seconds}, arrays)
        return self.answer()

    def answer(self) -> tuple[dict[str, Any], Arrays]:
        """Return the next message: a note of unchecked JSON values, and arrays.

        Raises:
            ValueError: the file cannot be read, or the process has ended; the message is one line.
        """
        try:
            note, arrays = reader.receive(self._timed, self._remaining)  # type: ignore[arg-type]
        except (EOFError, ConnectionError):
            raise self._died() from None
        except TimeoutError:
            raise self._late() from None
        except reader.LimitError:
            raise self._end(KILL, f"it unpacks to more than {self._memory // 1024**2:,} MiB") from None
        except ValueError:
            raise self._end(KILL, "the process that reads it gave an invalid answer") from None
        except BaseException:  # an interruption in the middle of a message
            self._end(KILL, "reading it was interrupted")
            raise
        self._remaining -= sum(array.nbytes for array in arrays.values())
        if not isinstance(note, dict):
            raise self._end(KILL, "the process that reads it gave an invalid answer")
        if note.get("error") == "memory":
            raise self._end(ENDED, f"it needs more than {self._memory // 1024**2:,} MiB of memory")
        if "error" in note:
            raise self._end(ENDED, short(note.get("text"), 400))
        return note, arrays

    def _renew(self) -> None:
        self._remaining = self._memory
        self._timed = _Timed(self._channel, PATIENCE * self._seconds)

    def _send(self, note: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
        try:
            reader.send(self._timed, note, arrays)  # type: ignore[arg-type]
        except ConnectionError:
            raise self._died() from None
        except TimeoutError:
            raise self._late() from None

    def _died(self) -> ValueError:
        number = self._server.end(ENDED, self.pid)
        if number == signal.SIGXCPU:
            return self._late()
        how = f" ({signal.Signals(number).name})" if number else ""
        return self._end(ENDED, f"the process that read it has died{how}")

    def _late(self) -> ValueError:
        return self._end(KILL, f"it takes longer than {self._seconds} s")

    def _end(self, letter: bytes, why: str) -> ValueError:
        """End the process and return the error with the reason."""
        self._why = why
        self._channel.close()
        self._server.end(letter, self.pid)
        return ValueError(why)


class _Timed:
    """Channel with one deadline for all parts of a message."""

    def __init__(self, channel: socket.socket, seconds: float) -> None:
        self._channel, self._until = channel, time.monotonic() + seconds
        channel.settimeout(seconds)

    def recv_into(self, view: memoryview) -> int:
        self._check()
        return self._channel.recv_into(view)

    def sendall(self, data: Any) -> None:
        self._check()
        self._channel.sendall(data)

    def _check(self) -> None:
        if time.monotonic() > self._until:
            raise TimeoutError


class _Server:
    """Process that forks children; only one thread at a time talks to it."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._lock = threading.Lock()
        self._control, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, reader.__file__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                cwd=Path(reader.__file__).anchor,
                env=os.environ | ENVIRONMENT,
                start_new_session=True,  # Ctrl-C reaches only the command
            )

    def fork(self, job: bytes) -> tuple[socket.socket, int]:
        """Return the connection to a new child, and its pid.

        Raises:
            OSError: the server has ended.
        """
        mine, theirs = socket.socketpair()
        with theirs:
            return mine, self._transact(lambda: socket.send_fds(self._control, [job], [theirs.fileno()]))

    def end(self, letter: bytes, pid: int) -> int:
        """End a child; return the signal that ended it, or 0."""
        if self.owner != os.getpid():  # this process was forked from the command, which owns the child
            return 0
        try:
            return self._transact(lambda: self._control.sendall(letter + reader.PID.pack(pid)))
        except OSError:  # the server has ended, and its children with it
            return 0

    def _transact(self, ask: Any) -> int:
        with self._lock:
            try:
                ask()
                answer = self._control.recv(reader.PID.size)
            except BaseException:
                self._control.close()  # without closing, the next request would read this request's answer
                raise
            if not answer:
                raise BrokenPipeError
        return int(reader.PID.unpack(answer)[0])

    def stop(self) -> None:
        """End the server and its children."""
        self._control.close()
        if self.owner == os.getpid():
            self._process.kill()
            self._process.wait()


_server: _Server | None = None
_starting = threading.Lock()


def _fork(job: bytes) -> tuple[socket.socket, int, _Server]:
    """Return the connection to a new child, its pid and its server; start the server if it is not running.

    Raises:
        ValueError: a process cannot be started.
    """
    global _server
    with _starting:
        for _ in range(2):
            try:
                if _server is None or _server.owner != os.getpid():
                    _server = _Server()
                return *_server.fork(job), _server
            except OSError as error:  # the server was killed
                why = error
                if _server is not None:
                    _server.stop()
                _server = None
    raise ValueError(f"cannot start a process to read it: {short(why)}")


def stop() -> None:
    """End the server of this process; the next file starts a new one."""
    global _server
    if _server is not None:
        _server.stop()
        _server = None


atexit.register(stop)
