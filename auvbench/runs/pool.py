"""Run the worker processes of a command: one fork server, and a pool whose jobs survive the death of a
worker.

The server imports modules once, so that a worker starts in milliseconds. On Linux the kernel kills the
workers when the server ends, and the server when the command ends, for any reason. A signal from the terminal
reaches only the command.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import multiprocessing
import os
import signal
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver, resource_tracker
from typing import Any, TypeVar

from auvbench import isolation, registry
from auvbench.errors import AuvbenchWarning, TrainingError
from auvbench.runs import interruption

COMMAND, MODULES = "AUVBENCH_COMMAND_PID", "AUVBENCH_PRELOAD"
"""environment variables of the server: the pid of its command, and the comma-separated modules to preload"""

PID = os.getpid()
"""pid of the process that imported this module; in a worker, the pid of the server that forked the worker"""

CONTEXT = multiprocessing.get_context("forkserver")
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment of a worker; numerical libraries read it when they are first imported."""

K = TypeVar("K")
T = TypeVar("T")


class WorkerDiedError(TrainingError):
    """The process of a job was killed."""


def start_server(preload: Sequence[str]) -> None:
    """Start the fork server and return; in the background the server imports and calls what `preload` names.

    Args:
        preload: modules, and functions written as module:function.
    """
    stop_server()
    environment = dict(os.environ)
    os.environ |= isolation.ENVIRONMENT
    resource_tracker.ensure_running()  # start it before the signals are blocked: it unblocks them
    os.environ |= ONE_THREAD | {COMMAND: str(os.getpid()), MODULES: ",".join(preload)}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, interruption.SIGNALS)
    try:
        CONTEXT.set_forkserver_preload([__name__])
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.environ.clear()
        os.environ |= environment


def stop_server() -> None:
    """Kill the fork server and all its workers, and wait for its end; the next call of `start_server` starts
    a new one.
    """
    server: Any = forkserver._forkserver
    if server._forkserver_pid is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(server._forkserver_pid, signal.SIGKILL)
        server._stop()


def begin_worker(folder: str) -> None:
    """Prepare a worker process; the worker must call this first.

    Args:
        folder: working directory.
    """
    os.setsid()
    interruption.die_with_parent(PID)
    interruption.prefer_in_memory_shortage()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, interruption.SIGNALS)
    with contextlib.suppress(OSError):  # the folder was removed meanwhile
        os.chdir(folder)
    gc.freeze()  # A garbage collection would copy the pages that the workers share.


PATIENCE = 10.0
"""longest wait in s for the end of the pool's thread after its workers were killed"""


class Pool:
    """Worker processes for the jobs of a command, started with the first job.

    Args:
        workers: largest number of workers; 0: one per core.
        preload: modules and functions that all jobs need, as for `start_server`.
    """

    def __init__(self, workers: int = 0, preload: Sequence[str] = ()) -> None:
        self.workers = workers or interruption.cores()
        self._preload = preload
        self._serving = False
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def start(self) -> None:
        """Start the fork server, unless it runs. It imports modules while the caller prepares the first job."""
        if not self._serving:
            start_server(self._preload)
            self._serving = True

    def results(
        self, function: Callable[..., T], jobs: Mapping[K, tuple[Any, ...]], what: str
    ) -> Iterator[tuple[K, T | WorkerDiedError]]:
        """Yield the key and the result of each job as the jobs end.

        When a worker dies, all active jobs are repeated one by one, since any active job may have killed the worker. A job
        whose worker dies a second time yields a `WorkerDiedError`; the other jobs continue.

        Args:
            function: function that a worker calls with a job's arguments.
            jobs: arguments by key; `str(key)` names the job to the user.
            what: word for a job in messages, e.g. "run".

        Raises:
            Exception: any exception that `function` raises; jobs that have not started are dropped.
        """
        waiting = deque(jobs)
        running: dict[Future[T], K] = {}
        try:
            while waiting or running:
                while waiting and len(running) < self.workers:
                    key = waiting.popleft()
                    running[self._submit(function, jobs[key])] = key
                ended = wait(running, return_when=FIRST_COMPLETED).done
                if any(isinstance(future.exception(), BrokenProcessPool) for future in ended):
                    ended = wait(running).done  # A broken pool ends all jobs.
                lost = {}
                for future in ended:
                    key = running.pop(future)
                    try:
                        yield key, future.result()
                    except BrokenProcessPool:
                        lost[key] = jobs[key]
                if lost:
                    yield from self._again(function, lost, what)
        finally:
            for future in running:
                future.cancel()

    def _again(
        self, function: Callable[..., T], jobs: Mapping[K, tuple[Any, ...]], what: str
    ) -> Iterator[tuple[K, T | WorkerDiedError]]:
        """Repeat the jobs one by one after the workers have died; yield as `results` does."""
        self._end()
        names = ", ".join(map(str, jobs))
        reason = f"a worker was killed, possibly out of memory; each active {what} is repeated: {names}"
        warnings.warn(AuvbenchWarning(reason), stacklevel=2)
        for key, arguments in jobs.items():
            try:
                yield key, self._submit(function, arguments).result()
            except BrokenProcessPool:
                self._end()
                yield key, WorkerDiedError(f"{key}: a worker was killed twice, possibly out of memory")

    def _submit(self, function: Callable[..., T], arguments: tuple[Any, ...]) -> Future[T]:
        try:
            if self._executor is None:
                self.start()
                self._executor = self._make()
            return self._executor.submit(function, *arguments)
        except (BrokenProcessPool, EOFError, OSError) as error:  # a worker or the server has died meanwhile
            failed: Future[T] = Future()
            failed.set_exception(BrokenProcessPool(str(error)))
            return failed

    def _make(self) -> ProcessPoolExecutor:
        try:
            return ProcessPoolExecutor(
                self.workers, CONTEXT, initializer=begin_worker, initargs=(os.getcwd(),)
            )
        except OSError as error:  # the pool's queues need semaphores
            raise TrainingError(
                f"cannot create semaphores for worker processes ({error.strerror}): check that /dev/shm is "
                "writable, or use "
                "--workers 1 where the command has it"
            ) from error

    def _end(self) -> None:
        if self._serving:
            stop_server()
            self._serving = False
        if self._executor is not None:
            manager: Any = self._executor._executor_manager_thread
            self._executor.shutdown(wait=False, cancel_futures=True)
            self._executor = None
            if manager is not None:
                # When Python exits, it wakes the thread through a pipe; when the thread ends, it closes the pipe. If both happen
                # at the same time, Python raises an OSError, so wait for the thread. The wait is limited, since the thread
                # never ends if a worker was killed while it sent a result.
                manager.join(PATIENCE)


# In the fork server: preload the modules. They may import this module, since all its definitions are above this line.
if COMMAND in os.environ:
    isolation.isolate()
    interruption.die_with_parent(int(os.environ.pop(COMMAND)))
    for _name in os.environ.pop(MODULES).split(","):
        with contextlib.suppress(Exception):  # the worker that needs the module reports the error
            if ":" in _name:
                registry.resolve(_name)()
            else:
                importlib.import_module(_name)
