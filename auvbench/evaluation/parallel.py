"""Testing many runs at once: one process each, one torch thread; a run's rows do not depend on its company."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from auvbench.config import schema
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import evaluate, is_done
from auvbench.runs.directory import RunDirectory


@dataclass(frozen=True, slots=True)
class Result:
    """What became of the test of one run."""

    run: RunDirectory
    summary: dict[str, Any] | None = None
    """None where it was done already or failed"""
    error: str = ""


def evaluate_all(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    *,
    workers: int = 0,
    force: bool = False,
    report: Callable[[RunDirectory, str], None] | None = None,
) -> Iterator[Result]:
    """Tests runs and yields results as they come; what is done already is skipped.

    Args:
        workers: at once; 0: one per core.
        report: called with a run and the condition that it enters, where runs are tested in this process.
    """
    waiting = []
    for run in runs:
        try:
            if force or not is_done(run, protocol):
                waiting.append(run)
            else:
                yield Result(run)
        except AuvbenchError as error:
            yield Result(run, error=str(error))
    count = min(workers or os.cpu_count() or 1, len(waiting))
    if count <= 1:
        for run in waiting:
            yield _test(run, protocol, report)
    else:
        yield from _in_processes(waiting, protocol, count)


def _test(
    run: RunDirectory, protocol: schema.Protocol, report: Callable[[RunDirectory, str], None] | None = None
) -> Result:
    try:
        told = None if report is None else lambda name: report(run, name)
        return Result(run, evaluate(run, protocol, told))
    except AuvbenchError as error:
        return Result(run, error=str(error))


def _in_processes(runs: list[RunDirectory], protocol: schema.Protocol, count: int) -> Iterator[Result]:
    # A fork server imports torch and SB3 once; a plain fork would inherit the parent's threads and locks.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["auvbench.evaluation.evaluate", "auvbench.agents.learned.learners"])
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        jobs: dict[Future[Result], RunDirectory] = {pool.submit(_test, run, protocol): run for run in runs}
        for job in as_completed(jobs):
            try:
                yield job.result()
            except BrokenProcessPool:
                message = (
                    f"{jobs[job].id}: a worker was killed, possibly out of memory; type the command again"
                )
                yield Result(jobs[job], error=message)
