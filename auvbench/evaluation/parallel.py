"""Testing many runs at once, or one slow one on all cores; a row does not depend on what it is computed beside."""

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

import numpy as np

from auvbench.agents import base as agents
from auvbench.agents.base import Agent
from auvbench.config import installed, plugins, schema
from auvbench.config.agents import AGENTS
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import Report, Roll, evaluate, in_process, make_agent, stale
from auvbench.evaluation.protocol import Circumstance
from auvbench.evaluation.rollout import Rollout, roll_out
from auvbench.runs import interruption, processes
from auvbench.runs.directory import RunDirectory
from auvbench.runs.lock import RunHeldError

LOOK = 0.1  # s between two looks at whether somebody asked to leave
GRACE = 0.8  # s for the tests under way to end once somebody has


@dataclass(frozen=True, slots=True)
class Result:
    """What became of the test of one run."""

    run: RunDirectory
    summary: dict[str, Any] | None = None
    """None where it was done already or failed"""
    error: str = ""
    held: bool = False
    """whether the error is that another process is testing it"""
    why: str = ""
    """why what was there was not good any more, where it was tested again"""


def evaluate_all(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    *,
    workers: int = 0,
    force: bool = False,
    report: Callable[[RunDirectory, str, int], None] = lambda *_: None,
    leaving: Callable[[int], None] = lambda _: None,
) -> Iterator[Result]:
    """Tests runs and yields results as they come; what is done already is skipped.

    A run is tested in one process, for its episodes are computed together. Those of an agent whose actions take as
    long together as alone (its class has `row_by_row`) are shared among all processes instead, one run after the
    other; the rows are the same to the bit.

    Ctrl-C and SIGTERM give the tests under way a second to end; a second one ends them at once.

    Args:
        workers: at once; 0: one per core.
        report: called with a run, the condition under way and how many of its episodes have just ended (0 where it
            begins); not of runs that another process tests as a whole.
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
    cores = workers or os.cpu_count() or 1
    if any(_on_a_server(run, protocol) for run in waiting):
        cores = 1  # a server's vehicles are moved by one test at a time
    shared = [run for run in waiting if cores > 1 and protocol.episodes > 1 and _row_by_row(run)]
    whole = [run for run in waiting if run not in shared]
    found: Iterator[Result]
    if min(cores, len(whole)) > 1:
        found = _in_processes(whole, protocol, force, min(cores, len(whole)), leaving)
    else:
        found = (_here(run, protocol, force, report) for run in whole)
    for result in found:
        yield replace(result, why=why[result.run.path])
    if shared:
        for result in _shared(shared, protocol, force, min(cores, protocol.episodes), report):
            yield replace(result, why=why[result.run.path])


def _row_by_row(run: RunDirectory) -> bool:
    try:
        algo = run.config().get("algo")
        name = str(algo.get("agent")) if isinstance(algo, dict) else ""
        spec = AGENTS.get(name)
        if spec is not None and not spec.learns:
            return bool(getattr(agents.resolve(spec.factory), "row_by_row", False))
        if not isinstance(algo, dict) or "package" not in algo:
            return False
        entered = installed.thing_of(plugins.AGENTS, name, str(algo["package"]))
        return bool(getattr(entered, "row_by_row", False))
    except AuvbenchError:
        return False  # its test will say what is wrong with it


def _on_a_server(run: RunDirectory, protocol: schema.Protocol) -> bool:
    """Whether a test of the run goes over ROS 2, as far as names tell."""
    words = [*protocol.overrides, *(word for one in protocol.conditions for word in one.overrides)]
    if "simulator=ros2" in words:
        return True
    if any(word.startswith("simulator=") for word in protocol.overrides):
        return False
    try:
        simulator = run.config().get("simulator")
    except AuvbenchError:
        return False  # its test will say what is wrong with it
    return isinstance(simulator, dict) and simulator.get("name") == "ros2"


def _here(
    run: RunDirectory,
    protocol: schema.Protocol,
    force: bool,
    report: Callable[[RunDirectory, str, int], None],
) -> Result:
    with interruption.immediate():
        return _test(run, protocol, force, lambda name, ended: report(run, name, ended))


def _test(
    run: RunDirectory,
    protocol: schema.Protocol,
    force: bool,
    report: Report = lambda *_: None,
    roll: Roll = in_process,
) -> Result:
    try:
        return Result(run, evaluate(run, protocol, report, unless_done=not force, roll=roll))
    except AuvbenchError as error:
        return Result(run, error=str(error), held=isinstance(error, RunHeldError))


@contextmanager
def _pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that die with this one, and are ended at the end of the context whatever they do."""
    # A fork server imports torch and SB3 once; a plain fork would inherit the parent's threads and locks.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["auvbench.evaluation.evaluate", "auvbench.agents.learned.sb3"])
    # Workers die with this process, however it ends: killed, it could not tell them.
    pool = ProcessPoolExecutor(
        count, mp_context=context, initializer=processes.die_with, initargs=processes.myself()
    )
    try:
        # An evaluation is there whole or not at all: nothing is lost by ending it half way.
        with processes.killed(pool):
            with interruption.immediate():
                with _deaf_to_the_terminal():
                    forkserver.ensure_running()
                ready = context.Process(target=int)  # the server imports for seconds before it answers
                ready.start()
                ready.join()
            yield pool
    finally:
        _end_server()


def _in_processes(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    force: bool,
    count: int,
    leaving: Callable[[int], None],
) -> Iterator[Result]:
    with _pool(count) as pool, interruption.deferred() as request:
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


def _shared(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    force: bool,
    count: int,
    report: Callable[[RunDirectory, str, int], None],
) -> Iterator[Result]:
    """One run after the other, each by all processes: an episode is a job."""
    with _pool(count) as pool, interruption.deferred() as request:

        def roll(
            run: RunDirectory, protocol: schema.Protocol, condition: Circumstance, report: Report
        ) -> Rollout:
            jobs = [
                pool.submit(_episode, run, protocol, condition, episode)
                for episode in range(protocol.episodes)
            ]
            waiting = set(jobs)
            try:
                while waiting and request.signal is None:
                    ended, waiting = wait(waiting, timeout=LOOK, return_when=FIRST_COMPLETED)
                    for job in ended:
                        job.result()  # raises what the episode raised
                        report(condition.name, 1)
            finally:
                for job in waiting:
                    job.cancel()
            if request.signal is not None:
                raise interruption.Interrupted(request.signal)
            return Rollout.joined([job.result() for job in jobs])

        for run in runs:

            def told(name: str, ended: int, run: RunDirectory = run) -> None:
                report(run, name, ended)

            try:
                result = _test(run, protocol, force, told, roll)
            except BrokenProcessPool:  # and so will the following ones be
                result = _killed(run)
            yield result
            if request.signal is not None:
                raise interruption.Interrupted(request.signal)


_made: tuple[tuple[Path, str], Agent] | None = None
"""The agent of the last episode in this process: to build one may take as long as half an episode"""


def _episode(run: RunDirectory, protocol: schema.Protocol, condition: Circumstance, episode: int) -> Rollout:
    """One episode of a condition; its agent has forgotten all others."""
    global _made
    key = run.path, condition.name
    if _made is None or _made[0] != key:
        _made = key, make_agent(run, condition.config.step.frequency)
    return roll_out(
        condition.config,
        _made[1],
        episodes=np.array([episode]),
        seed=protocol.seed,
        batch=1,
        trajectories=int(episode < protocol.trajectories),
        scenarios=protocol.scenarios,
    )


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
        return _killed(run)


def _killed(run: RunDirectory) -> Result:
    return Result(run, error=f"{run.id}: a worker was killed, possibly out of memory; type the command again")
