"""Carry out runs as processes of this machine, one per run, forked from the server of `runs.pool`."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import ClassVar

from auvbench.config.launchers import Local
from auvbench.runs import interruption, pool
from auvbench.scheduling.loop import Phase, Status
from auvbench.training import worker
from auvbench.training.worker import TARGET

CONTROLLERS = ("auvbench.training.execute", "auvbench.evaluation.evaluate")
"""Modules that every run needs."""

LEARNERS = (
    *CONTROLLERS,
    "auvbench.training.learning",
    "auvbench.agents.learned.sb3",
    "sb3_contrib",
    "torch.utils.tensorboard",
    "torch._dynamo",  # imported by the first optimiser of a process
    "auvbench.envs.batch:load_compiled",
)
"""Modules that a run of a learner needs, and functions (`module:function`) that must be called before the run"""

_SERVER_ENDED = 255
"""exit code that multiprocessing reports for a worker whose fork server has ended; no worker exits with this code"""


@dataclass(slots=True, eq=False)
class LocalJob:
    """A worker process."""

    mark: ClassVar[str | None] = None
    run: Path
    process: BaseProcess
    status: Status = field(default_factory=lambda: Status(Phase.QUEUED))

    def start(self) -> None:
        """Fork the worker; the server must be ready."""
        try:
            self.process.start()
            self.status = Status(Phase.RUNNING)
        except (EOFError, OSError) as error:
            self.status = Status(Phase.ENDED, reason=f"no worker could be forked ({error})", lost=True)

    def poll(self) -> Status:
        if self.status.phase is Phase.RUNNING and (code := self.process.exitcode) is not None:
            lost = code == _SERVER_ENDED
            self.status = Status(
                Phase.ENDED, None if lost else code, "the fork server ended" if lost else "", lost=lost
            )
        return self.status

    def cancel(self, *, force: bool = False) -> None:
        number = signal.SIGKILL if force else signal.SIGTERM
        if self.status.phase is Phase.QUEUED:
            self.status = Status(Phase.ENDED, code=128 + number)
        elif self.process.is_alive() and self.process.pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.process.pid, number)

    def __str__(self) -> str:
        return f"pid {self.process.pid}" if self.process.pid else "a process of this machine"


class LocalBackend:
    """Backend with up to `workers` simultaneous worker processes on this machine; 0: one worker per core."""

    def __init__(self, workers: int = 0, *, target: str = TARGET, preload: Sequence[str] = LEARNERS) -> None:
        self.limit: int | None = workers or interruption.cores()
        self.target = target
        self.preload = preload
        self._jobs: list[LocalJob] = []
        self._server: threading.Thread | None = None
        """Thread that waits until the fork server has imported its modules, so that the main thread can handle signals"""

    def submit(self, run: Path) -> LocalJob:
        if self._server is None or any(job.poll().lost for job in self._jobs):
            self._jobs.clear()
            pool.start_server(self.preload)
            self._server = threading.Thread(target=_await_server, daemon=True)
            self._server.start()
        arguments = (os.getcwd(), str(run.absolute()), self.target)
        job = LocalJob(run, pool.CONTEXT.Process(target=_work, args=arguments))
        self._jobs.append(job)
        return job

    def adopt(self, run: Path) -> LocalJob | None:
        return None  # No job of an earlier sweep exists: a sweep's workers end with the sweep.

    def wait(self, seconds: float) -> None:
        self._jobs = [job for job in self._jobs if not job.poll().ended or job.status.lost]
        if self._server is not None and self._server.is_alive():
            self._server.join(seconds)
            return
        for job in self._jobs:
            if job.status.phase is Phase.QUEUED:
                job.start()
        sentinels = [job.process.sentinel for job in self._jobs if job.status.phase is Phase.RUNNING]
        if sentinels:
            connection.wait(sentinels, seconds)
        else:
            time.sleep(seconds)

    def close(self) -> None:
        pool.stop_server()
        self._server = None


def _await_server() -> None:
    with contextlib.suppress(EOFError, OSError):  # The start of the first job raises the same error.
        process = pool.CONTEXT.Process(target=int)
        process.start()
        process.join()


def _work(folder: str, run: str, target: str) -> None:
    """Run the worker's function in the forked process."""
    pool.begin_worker(folder)
    sys.exit(worker.work(run, target=target, log=True))


def make(options: Local, target: str, learning: bool) -> LocalBackend:
    """Return the backend of this machine; `config.launchers.LauncherSpec.factory` describes the arguments."""
    return LocalBackend(options.workers, target=target, preload=LEARNERS if learning else CONTROLLERS)
