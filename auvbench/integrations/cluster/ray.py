"""Carry out runs as tasks of a Ray cluster, or of a Ray started on this machine.

Each task starts the worker as a separate process instead of training inside Ray's process. A run then has the
same threads, signals and log on every machine, and gets no state from an earlier run.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from auvbench.errors import UserError
from auvbench.integrations.cluster.spec import Ray
from auvbench.runs import lock
from auvbench.scheduling.loop import Phase, Status
from auvbench.training.worker import TARGET
from auvbench.untrusted.text import first_line


@dataclass(slots=True, eq=False)
class RayJob:
    """One Ray task."""

    mark: ClassVar[str | None] = None
    run: Path
    task: Any
    backend: RayBackend
    status: Status = field(default_factory=lambda: Status(Phase.QUEUED))

    def poll(self) -> Status:
        if not self.status.ended:
            self.status = self.backend.status(self)
        return self.status

    def cancel(self, *, force: bool = False) -> None:
        if not self.status.ended:
            self.backend.ray.cancel(self.task, force=force)

    def __str__(self) -> str:
        return f"ray task {self.task.task_id().hex()[:16]}"


class RayBackend:
    """Backend for a Ray cluster whose nodes share the file system of the run directories."""

    def __init__(self, options: Ray, *, target: str = TARGET) -> None:
        # Set before the import of Ray, which would otherwise send usage statistics over the network.
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        try:
            import ray
        except ImportError as error:
            raise UserError("launcher=ray needs Ray: pip install 'auvbench[ray]'") from error
        self.ray = ray
        self.target = target
        self.limit = options.workers or None  # Ray has its own queue
        self._started = not ray.is_initialized()
        if self._started:
            try:
                ray.init(
                    address=options.address,
                    log_to_driver=False,
                    include_dashboard=False,
                    logging_level="warning",
                )
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise UserError(f"launcher.address={options.address}: {error}") from error
        resources: dict[str, Any] = {"num_cpus": options.cpus}
        if options.memory:
            resources["memory"] = options.memory * 1024**2
        # No retries by Ray: the scheduling loop resumes an interrupted run, because only the loop knows the manifest.
        self._carry_out = ray.remote(max_retries=0, **resources)(carry_out)

    def submit(self, run: Path) -> RayJob:
        return RayJob(run, self._carry_out.remote(str(run.absolute()), self.target), self)

    def adopt(self, run: Path) -> RayJob | None:
        return None  # no task remains: Ray tasks end with the sweep that started them

    def wait(self, seconds: float) -> None:
        time.sleep(seconds)

    def close(self) -> None:
        if self._started:
            self.ray.shutdown()

    def status(self, job: RayJob) -> Status:
        ready, _ = self.ray.wait([job.task], timeout=0)
        if not ready:
            # Only Ray's dashboard distinguishes queued from running tasks. A running task holds its run's lock.
            return Status(Phase.QUEUED if lock.living_holder(job.run) is None else Phase.RUNNING)
        errors = self.ray.exceptions
        try:
            return Status(Phase.ENDED, code=self.ray.get(job.task))
        except errors.TaskCancelledError:
            return Status(Phase.ENDED, code=128 + signal.SIGTERM)
        except (errors.WorkerCrashedError, errors.OutOfMemoryError) as error:
            return Status(Phase.ENDED, reason=first_line(error))
        except (errors.NodeDiedError, errors.ObjectLostError, errors.OwnerDiedError) as error:
            return Status(Phase.ENDED, reason=first_line(error), lost=True)
        except errors.RayError as error:
            return Status(Phase.ENDED, reason=first_line(error))


def carry_out(run: str, target: str) -> int:
    """Start the worker on the node of this Ray process, and return the worker's exit code."""
    worker = [sys.executable, "-P", "-m", "auvbench.training.worker", run, "--log", "--target", target]
    process = subprocess.Popen(
        [*worker, "--parent", str(os.getpid())], stdin=subprocess.DEVNULL, start_new_session=True
    )
    try:
        while process.poll() is None:
            time.sleep(0.1)  # short, because ray.cancel sets a flag that Python checks only between two calls
    except KeyboardInterrupt:
        process.send_signal(signal.SIGTERM)
    return process.wait()


def make(options: Ray, target: str, learning: bool) -> RayBackend:
    """Return the backend; see `config.launchers.LauncherSpec.factory`."""
    return RayBackend(options, target=target)
