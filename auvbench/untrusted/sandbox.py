"""Foreign binary files are read in processes of their own; this is the side of the command.

    with Child(TABLE, data, columns=None, most=100) as child:
        note, arrays = child.answer()

A server is started with the first file. It forks a child for each file, which takes a few milliseconds, and each child has
limits and no rights (`reader.py`). Whatever ends a child is a `ValueError` of one line. Nothing that a child sends is trusted:
arrays of numbers come back with a type, a shape and a length that are checked, and never a pickle.
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

from auvbench.untrusted import reader
from auvbench.untrusted.reader import ENDED, KILL, Arrays
from auvbench.untrusted.text import short

TABLE, PATHS, POLICY = b"T", b"A", b"P"
"""Jobs of a child: a Parquet file, the trajectories of an .npz, an ONNX file"""

MEMORY = 1024**3
"""bytes that a child may take, and that it may send"""
SECONDS = 60
"""s of processor time for a file, and for each answer of a policy"""
PATIENCE = 5
"""times as long as its processor time a child may take by the clock: the machine may be busy"""
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
ENVIRONMENT = ONE_THREAD | {
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    # A process with threads must not fork: a lock may be held by a thread that the child does not have.
    "JE_ARROW_MALLOC_CONF": "background_thread:false",
    "ORT_DISABLE_TELEMETRY": "1",
    "PYTHONSAFEPATH": "1",
}


class Child:
    """A process that reads one file.

    Args:
        job: `TABLE`, `PATHS` or `POLICY`.
        data: the file.
        seconds: of the processor, for the file and then for each answer; `PATIENCE` times as long by the clock.
        options: of the job.

    Raises:
        ValueError: it has ended, in one line.
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
        with contextlib.suppress(Exception):  # the interpreter may be ending
            self.close()

    def ask(self, note: Mapping[str, Any], arrays: Mapping[str, Any]) -> tuple[dict[str, Any], Arrays]:
        """Send a request, and return the answer as `answer` does, with new limits."""
        if self._why:
            raise ValueError(self._why)
        self._renew()
        self._send({**note, "seconds": self._seconds}, arrays)
        return self.answer()

    def answer(self) -> tuple[dict[str, Any], Arrays]:
        """Return the next message: a note of unchecked JSON values, and arrays.

        Raises:
            ValueError: why the file cannot be read, or the process has ended; in one line.
        """
        try:
            note, arrays = reader.receive(self._timed, self._left)  # type: ignore[arg-type]
        except (EOFError, ConnectionError):
            raise self._died() from None
        except TimeoutError:
            raise self._late() from None
        except reader.LimitError:
            raise self._end(KILL, f"it unpacks to more than {self._memory // 1024**2:,} MiB") from None
        except ValueError:
            raise self._end(KILL, "the process that reads it gave an answer of no meaning") from None
        except BaseException:  # an interruption in the middle of a message
            self._end(KILL, "reading it was interrupted")
            raise
        self._left -= sum(array.nbytes for array in arrays.values())
        if not isinstance(note, dict):
            raise self._end(KILL, "the process that reads it gave an answer of no meaning")
        if note.get("error") == "memory":
            raise self._end(ENDED, f"it needs more than {self._memory // 1024**2:,} MiB of memory")
        if "error" in note:
            raise self._end(ENDED, short(note.get("text"), 400))
        return note, arrays

    def _renew(self) -> None:
        self._left = self._memory
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
        """End the process, and return the error that says why."""
        self._why = why
        self._channel.close()
        self._server.end(letter, self.pid)
        return ValueError(why)


class _Timed:
    """A channel on which all parts of a message come within some seconds, and each is waited for no longer than that."""

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
    """The process that forks children; a thread at a time talks to it."""

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
                start_new_session=True,  # Ctrl-C reaches the command alone
            )

    def fork(self, job: bytes) -> tuple[socket.socket, int]:
        """Return the connection to a new child, and its number.

        Raises:
            OSError: the server has ended.
        """
        mine, theirs = socket.socketpair()
        with theirs:
            return mine, self._transact(lambda: socket.send_fds(self._control, [job], [theirs.fileno()]))

    def end(self, letter: bytes, pid: int) -> int:
        """End a child; return the signal that has ended it, 0 where there is none."""
        if self.owner != os.getpid():  # a fork of the command has no children of its own
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
                self._control.close()  # an answer that nobody took would be taken for the next one
                raise
            if not answer:
                raise BrokenPipeError
        return int(reader.PID.unpack(answer)[0])

    def stop(self) -> None:
        """End the server, and with it its children."""
        self._control.close()
        if self.owner == os.getpid():
            self._process.kill()
            self._process.wait()


_server: _Server | None = None
_starting = threading.Lock()


def _fork(job: bytes) -> tuple[socket.socket, int, _Server]:
    """Return a new child of the server, which is started where it does not run.

    Raises:
        ValueError: no process can be started.
    """
    global _server
    with _starting:
        for _ in range(2):
            try:
                if _server is None or _server.owner != os.getpid():
                    _server = _Server()
                return *_server.fork(job), _server
            except OSError as error:  # it was killed
                why = error
                if _server is not None:
                    _server.stop()
                _server = None
    raise ValueError(f"no process can be started that reads it: {short(why)}")


def stop() -> None:
    """End the server of this process; the next file starts another one."""
    global _server
    if _server is not None:
        _server.stop()
        _server = None


atexit.register(stop)
