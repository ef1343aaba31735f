"""Runs as processes of this machine, forked from one process that has imported everything (see `zygote`)."""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from auvbench.scheduling.base import Phase, Status, SubmitError
from auvbench.training.worker import ONE_THREAD, TARGET

KERNELS = ("auvbench.scheduling.warm:kernels",)
"""What every run does first."""

PRELOAD = (
    "auvbench.training.learning",
    "stable_baselines3",
    "torch.utils.tensorboard",
    "torch._dynamo",  # which the first optimiser of a process imports, unasked
    *KERNELS,
)
"""What a learner imports sooner or later besides."""


@dataclass(slots=True, eq=False)
class LocalJob:
    """A worker process."""

    mark: ClassVar[str | None] = None
    run: Path
    number: int
    server: _Server
    pid: int | None = None
    status: Status = field(default_factory=lambda: Status(Phase.QUEUED))

    def poll(self) -> Status:
        self.server.receive(0)
        return self.status

    def cancel(self, *, force: bool = False) -> None:
        if not self.status.ended and self.server.abandoned(force=force):
            return
        if not self.status.ended:
            number = signal.SIGKILL if force else signal.SIGTERM
            with contextlib.suppress(OSError):  # the server is gone, and the worker with it
                self.server.send({"signal": int(number), "job": self.number})

    def __str__(self) -> str:
        return f"pid {self.pid}" if self.pid else "a process of this machine"


class _Server:
    """The zygote process, seen from here."""

    def __init__(self, run: Path, preload: Sequence[str]) -> None:
        self.connection, theirs = socket.socketpair()
        arguments = [sys.executable, "-P", "-m", "auvbench.scheduling.zygote", str(theirs.fileno())]
        # Not to the terminal: what the server prints there would tear the live table apart.
        self.said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the server
        self.process = subprocess.Popen(
            [*arguments, str(run), *preload],
            stdout=self.said,
            stderr=self.said,
            pass_fds=[theirs.fileno()],
            # Its own session: the terminal's Ctrl-C comes to us alone, and we tell the workers.
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            env={**os.environ, **ONE_THREAD},
        )
        theirs.close()
        self.jobs: dict[int, LocalJob] = {}
        self.alive = True
        self.buffer = b""
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.connection, selectors.EVENT_READ)

    def send(self, message: dict[str, Any]) -> None:
        self.connection.sendall(json.dumps(message).encode() + b"\n")

    def receive(self, seconds: float) -> None:
        """Takes in what the server says, waiting for it no longer than `seconds`."""
        while self.alive and self.selector.select(seconds):
            try:
                data = self.connection.recv(65536)
            except ConnectionError:
                data = b""
            *lines, self.buffer = (self.buffer + data).split(b"\n")
            for line in lines:
                self._note(json.loads(line))
            if not data:
                self._died()
            seconds = 0

    def _note(self, message: dict[str, Any]) -> None:
        if "job" not in message:
            return
        job = self.jobs[message["job"]]
        if "pid" in message:
            job.pid = message["pid"]
            job.status = Status(Phase.RUNNING)
        else:
            job.status = Status(Phase.ENDED, code=message["code"], reason=message.get("reason", ""))
            del self.jobs[job.number]

    def _died(self) -> None:
        self.alive = False
        code = self.process.wait()
        how = ": ".join(filter(None, [Status(Phase.ENDED, code).describe(), self._last_words()]))
        reason = f"the process that starts the workers ended ({how})"
        for job in self.jobs.values():
            job.status = Status(Phase.ENDED, reason=reason, lost=True)
        self.jobs.clear()

    def _last_words(self) -> str:
        self.said.seek(0)
        lines = self.said.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def abandoned(self, *, force: bool) -> bool:
        """Ends the server where it has not started any worker yet: whoever leaves need not wait for its imports."""
        self.receive(0)
        if not self.jobs or any(job.pid is not None for job in self.jobs.values()) or not self.alive:
            return False
        self.alive = False
        self.process.kill()
        self.process.wait()
        code = 128 + (signal.SIGKILL if force else signal.SIGTERM)
        for job in self.jobs.values():
            job.status = Status(Phase.ENDED, code=code)
        self.jobs.clear()
        return True

    def close(self) -> None:
        self.selector.close()
        self.connection.close()  # which it takes as its end
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.said.close()


class LocalBackend:
    """As many workers at once as this machine has cores, or as `workers` says."""

    name = "local"

    def __init__(self, workers: int = 0, *, target: str = TARGET, preload: Sequence[str] = PRELOAD) -> None:
        self.limit: int | None = workers or cores()
        self.target = target
        self.preload = preload
        self._server: _Server | None = None
        self._count = 0

    def submit(self, run: Path) -> LocalJob:
        if self._server is None or not self._server.alive:
            if self._server is not None:
                self._server.close()
            self._server = _Server(run, self.preload)
        self._count += 1
        job = LocalJob(run, self._count, self._server)
        try:
            self._server.send({"start": job.number, "run": str(run.absolute()), "target": self.target})
        except OSError as error:
            self._server.receive(0)
            raise SubmitError(f"the process that starts the workers does not answer: {error}") from error
        self._server.jobs[job.number] = job
        return job

    def adopt(self, run: Path) -> LocalJob | None:
        return None  # workers do not outlive the sweep that started them

    def wait(self, seconds: float) -> None:
        if self._server is not None and self._server.alive:
            self._server.receive(seconds)
        else:
            time.sleep(seconds)

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None


def cores() -> int:
    """The cores this process may use (a cluster or container may grant fewer than there are)."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
