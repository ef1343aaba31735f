"""A process that imports what training needs once and then forks a worker for each run.

A worker so starts in milliseconds instead of the seconds that torch and Stable-Baselines3 take to import, and
the workers share the memory of those modules. The standard library's forkserver does nearly the same, but
imports the caller's `__main__` again in each worker, blocks the caller while it preloads, and dies of the
terminal's Ctrl-C while it does; this one sits in a session of its own.

It speaks JSON lines over a socket: `{"start": 3, "run": "...", "target": "..."}` and `{"signal": 15, "job": 3}`
come in, `{"job": 3, "pid": 4711}` and `{"job": 3, "code": -9}` go out. When the other end is gone, however that
came about, it and its workers end.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import select
import selectors
import signal
import socket
import sys
from typing import Any

from auvbench.runs import processes
from auvbench.runs.directory import RunDirectory
from auvbench.training import worker

LOOK = 0.25
"""s between two looks, while it prepares itself, at whether anybody is still there"""


class Zygote:
    """The server's loop."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.jobs: dict[int, int] = {}  # pid -> job
        self.buffer = b""

    def preload(self, items: list[str], run: RunDirectory) -> None:
        """Imports each `module`, and calls each `module:function` with the run."""
        # Takes seconds, or half a minute where it compiles: whoever asked for it may be gone by then.
        signal.signal(signal.SIGALRM, self.leave_if_alone)
        signal.setitimer(signal.ITIMER_REAL, LOOK, LOOK)
        for item in items:
            # What fails here is reported by the worker that needs it, in its run's manifest.
            with contextlib.suppress(Exception):
                worker.load(item)(run) if ":" in item else importlib.import_module(item)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        worker.limit_torch()
        # Collections in the workers then leave these objects, and with them the shared pages, alone.
        gc.collect()
        gc.freeze()

    def leave_if_alone(self, *_: object) -> None:
        """Ends this process when the other end of the connection is gone."""
        # Reading would not tell: the first commands lie before the end.
        hung_up = select.POLLHUP | select.POLLERR
        poll = select.poll()
        poll.register(self.connection, 0)
        if any(event & hung_up for _, event in poll.poll(0)):
            os._exit(0)

    def serve(self) -> None:
        """Until the other end of the connection closes."""
        reading, writing = os.pipe()
        for end in (reading, writing):
            os.set_blocking(end, False)
        signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        with selectors.DefaultSelector() as selector:
            selector.register(self.connection, selectors.EVENT_READ)
            selector.register(reading, selectors.EVENT_READ)
            while True:
                ready = {key.fileobj for key, _ in selector.select()}
                if reading in ready:
                    os.read(reading, 4096)
                    self.collect()
                if self.connection in ready and not self.receive():
                    break
        for pid in self.jobs:  # where the kernel does not do it for us
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def receive(self) -> bool:
        try:
            data = self.connection.recv(65536)
        except ConnectionError:
            data = b""
        *lines, self.buffer = (self.buffer + data).split(b"\n")
        for line in lines:
            message = json.loads(line)
            if "start" in message:
                self.start(message["start"], message["run"], message["target"])
            else:
                for pid in [pid for pid, job in self.jobs.items() if job == message["job"]]:
                    os.kill(pid, message["signal"])  # ours and not collected yet: cannot be another process
        return bool(data)

    def start(self, job: int, run: str, target: str) -> None:
        parent = os.getpid()
        try:
            pid = os.fork()
        except OSError as error:  # no memory or no process left
            self.send({"job": job, "code": 1, "reason": f"no process could be started: {error.strerror}"})
            return
        if pid == 0:
            self.become_worker(parent, run, target)
        self.jobs[pid] = job
        self.send({"job": job, "pid": pid})

    def become_worker(self, parent: int, run: str, target: str) -> None:
        """In the child; does not return."""
        code = 1
        try:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            self.connection.close()
            processes.die_with_parent(parent)
            processes.prefer_in_memory_shortage()
            code = worker.work(run, target=target, log=True)
        finally:
            # Nothing of the server's, such as its exit handlers, is for the worker to carry out.
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):
                    stream.flush()
            os._exit(code)

    def collect(self) -> None:
        while self.jobs:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            job = self.jobs.pop(pid, None)
            if job is not None:
                self.send({"job": job, "code": os.waitstatus_to_exitcode(status)})

    def send(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(ConnectionError):  # the end of the connection is noticed when reading
            self.connection.sendall(json.dumps(message).encode() + b"\n")


def main(arguments: list[str]) -> None:
    """`zygote FD RUN ITEM...`: prepares itself with the items and a first run, serves on the inherited socket."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    descriptor, run, *items = arguments
    with socket.socket(fileno=int(descriptor)) as connection:
        zygote = Zygote(connection)
        zygote.preload(items, RunDirectory(run))
        zygote.send({"ready": True})
        zygote.serve()


if __name__ == "__main__":
    main(sys.argv[1:])
