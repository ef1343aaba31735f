"""Testing many runs at once: one process each, one torch thread; a run's rows do not depend on its company."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from auvbench.config import schema
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import evaluate, stale
from auvbench.runs import processes
from auvbench.runs.directory import RunDirectory


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
) -> Iterator[Result]:
    """Tests runs and yields results as they come; what is done already is skipped.

    Args:
        workers: at once; 0: one per core.
        report: called with a run and the condition that it enters, where runs are tested in this process.
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
        found: Iterator[Result] = (_test(run, protocol, force, report) for run in waiting)
    else:
        found = _in_processes(waiting, protocol, force, count)
    for result in found:
        yield replace(result, why=why[result.run.path])


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
    runs: list[RunDirectory], protocol: schema.Protocol, force: bool, count: int
) -> Iterator[Result]:
    # A fork server imports torch and SB3 once; a plain fork would inherit the parent's threads and locks.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["auvbench.evaluation.evaluate", "auvbench.agents.learned.learners"])
    # Workers die with this process, however it ends: killed, it could not tell them.
    us = (os.getpid(), processes.start_mark(os.getpid()) or "")
    with ProcessPoolExecutor(count, mp_context=context, initializer=processes.die_with, initargs=us) as pool:
        jobs: dict[Future[Result], RunDirectory] = {
            pool.submit(_test, run, protocol, force): run for run in runs
        }
        for job in as_completed(jobs):
            try:
                yield job.result()
            except BrokenProcessPool:
                message = (
                    f"{jobs[job].id}: a worker was killed, possibly out of memory; type the command again"
                )
                yield Result(jobs[job], error=message)
