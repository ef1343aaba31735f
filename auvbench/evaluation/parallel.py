"""Testing many runs at once: one process each, one torch thread; a run's rows do not depend on its company."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

from auvbench.config import schema
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import evaluate, stale
from auvbench.runs import interruption, processes
from auvbench.runs.directory import RunDirectory

LOOK = 0.1  # s between two looks at whether somebody asked to leave
GRACE = 0.8  # s for the tests under way to end once somebody has


@dataclass(frozen=True, slots=True)
class Result:
    """What became of the test of one run."""

    run: RunDirectory
    summary: dict[str, Any] | None = None
    """None where it was done already or failed"""
    error: str = ""
    why: str = ""
    """why what was there was not good any more, where it was tested again"""


def evaluate_all(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    *,
    workers: int = 0,
    force: bool = False,
    report: Callable[[RunDirectory, str], None] | None = None,
    leaving: Callable[[int], None] = lambda _: None,
) -> Iterator[Result]:
    """Tests runs and yields results as they come; what is done already is skipped.

    Ctrl-C and SIGTERM give the tests under way a second to end; a second one ends them at once.

    Args:
        workers: at once; 0: one per core.
        report: called with a run and the condition that it enters, where runs are tested in this process.
        leaving: called at the first Ctrl-C with the number of tests that may still end.

    Raises:
        Interrupted: somebody asked to leave; what was yielded by then is kept.
    """
    waiting = []
    why: dict[Path, str] = {}
    for run in runs:
        try:
            reason = "" if force else stale(run, protocol)
        except AuvbenchError as error:
            yield Result(run, error=str(error))
            continue
        if reason == "" and not force:
            yield Result(run)
            continue
        waiting.append(run)
        why[run.path] = reason or ""
    count = min(workers or os.cpu_count() or 1, len(waiting))
    if count <= 1:
        found: Iterator[Result] = (_here(run, protocol, force, report) for run in waiting)
    else:
        found = _in_processes(waiting, protocol, force, count, leaving)
    for result in found:
        yield replace(result, why=why[result.run.path])


def _here(
    run: RunDirectory,
    protocol: schema.Protocol,
    force: bool,
    report: Callable[[RunDirectory, str], None] | None,
) -> Result:
    with interruption.immediate():
        return _test(run, protocol, force, report)


def _test(
    run: RunDirectory,
    protocol: schema.Protocol,
    force: bool,
    report: Callable[[RunDirectory, str], None] | None = None,
) -> Result:
    try:
        told = None if report is None else lambda name: report(run, name)
        return Result(run, evaluate(run, protocol, told, unless_done=not force))
    except AuvbenchError as error:
        return Result(run, error=str(error))


def _in_processes(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    force: bool,
    count: int,
    leaving: Callable[[int], None],
) -> Iterator[Result]:
    # A fork server imports torch and SB3 once; a plain fork would inherit the parent's threads and locks.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["auvbench.evaluation.evaluate", "auvbench.agents.learned.learners"])
    # Workers die with this process, however it ends: killed, it could not tell them.
    us = (os.getpid(), processes.start_mark(os.getpid()) or "")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=processes.die_with, initargs=us)
    try:
        with interruption.immediate():
            with _deaf_to_the_terminal():
                forkserver.ensure_running()
            ready = context.Process(target=int)  # the server imports for seconds before it answers
            ready.start()
            ready.join()
        with interruption.deferred() as request:
            jobs = {pool.submit(_test, run, protocol, force): run for run in runs}
            yield from _as_they_end(jobs, request)
            if request.signal is not None:
                waiting = [job for job in jobs if not job.done() and not job.cancel()]
                under_way = waiting[:count]  # the pool counts one more, which waits in its queue
                leaving(len(under_way))
                wait(under_way, timeout=GRACE)
                for job in under_way:
                    if job.done():
                        yield _result(job, jobs[job])
                raise interruption.Interrupted(request.signal)
    finally:
        # An evaluation is there whole or not at all: nothing is lost by ending it half way.
        for process in list((pool._processes or {}).values()):
            process.kill()
        pool.shutdown(wait=False, cancel_futures=True)
        _end_server()


def _end_server() -> None:
    """At once: it may still be importing, and what it then said of our absence would come after the prompt."""
    pid = getattr(getattr(forkserver, "_forkserver", None), "_forkserver_pid", None)
    if isinstance(pid, int):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@contextmanager
def _deaf_to_the_terminal() -> Iterator[None]:
    """Processes started here never see a Ctrl-C; what it means is decided by the one that was typed."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _as_they_end(
    jobs: Mapping[Future[Result], RunDirectory], request: interruption.Request
) -> Iterator[Result]:
    """Results until all are there, or somebody asks to leave."""
    waiting = set(jobs)
    while waiting and request.signal is None:
        ended, waiting = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
        for job in ended:
            yield _result(job, jobs[job])


def _result(job: Future[Result], run: RunDirectory) -> Result:
    try:
        return job.result()
    except BrokenProcessPool:
        return Result(
            run, error=f"{run.id}: a worker was killed, possibly out of memory; type the command again"
        )
