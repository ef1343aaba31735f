"""Test many runs in parallel, or a slow run on all cores; the rows are the same as without parallel work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from auvbench.agents.base import Agent
from auvbench.config import schema
from auvbench.config.simulators import is_served
from auvbench.errors import AuvbenchError
from auvbench.evaluation.evaluate import Report, Roll, evaluate, make_agent, stale
from auvbench.evaluation.protocol import ResolvedCondition, resolve_conditions
from auvbench.evaluation.rollout import Rollout, one_episode
from auvbench.registry import AGENTS, resolve
from auvbench.runs.directory import RunDirectory
from auvbench.runs.error_file import naming_traceback
from auvbench.runs.lock import RunHeldError
from auvbench.runs.pool import Pool, WorkerDiedError

PRELOAD = (
    "auvbench.evaluation.parallel",
    "auvbench.agents.learned.sb3",
    "auvbench.envs.batch:load_compiled",
)
"""Modules that the pool's workers import at the start."""


@dataclass(frozen=True, slots=True)
class Result:
    """Outcome of the test of one run."""

    run: RunDirectory
    summary: dict[str, Any] | None = None
    """summary of the test; None if the test was finished before, or failed"""
    error: str = ""
    locked: bool = False
    """whether the test failed because another process is testing the run"""
    why: str = ""
    """Reason why a finished test had to be repeated; '' if there was no finished test, or with `force`"""


def evaluate_all(
    runs: list[RunDirectory],
    protocol: schema.Protocol,
    pool: Pool,
    *,
    force: bool = False,
    report: Callable[[RunDirectory, str, int], None] = lambda *_: None,
) -> Iterator[Result]:
    """Test runs and yield each result when it is ready; skip runs that are already tested.

    Usually one worker tests a whole run, because the episodes of a condition are computed as one batch. If a batch does
    not speed up an agent (`row_by_row` of the agent's class), all workers share the episodes of the agent's run. In
    both cases, the rows have the same bits.

    Args:
        runs: runs to test.
        protocol: protocol of the test.
        pool: worker processes; if one worker is enough, this process does the work.
        force: whether to repeat finished tests.
        report: function called with a run, the active condition and the number of the condition's episodes that have
            just ended (0 at the condition's start); not called if a worker tests the whole run.
    """
    waiting: dict[Path, RunDirectory] = {}
    why: dict[Path, str] = {}
    for run in runs:
        try:
            reason = None if force else stale(run, protocol)
        except AuvbenchError as error:
            yield Result(run, error=str(error))
            continue
        if reason == "":
            yield Result(run)
        else:
            waiting[run.path], why[run.path] = run, reason or ""
    if pool.workers > 1 and len(waiting) > 1:
        pool.start()
    # Resolve the conditions once for all workers, because composing the options of a protocol is slow.
    conditions = (
        {} if pool.workers == 1 else {path: _conditions(run, protocol) for path, run in waiting.items()}
    )
    # Only one test at a time can use the vehicles of a ROS 2 server.
    sequential = pool.workers == 1 or any(
        is_served(condition.config.simulator) for found in conditions.values() for condition in found or ()
    )
    shared = [
        path for path, run in waiting.items() if not sequential and protocol.episodes > 1 and _row_by_row(run)
    ]
    whole = {
        path: (run, protocol, not force, conditions.get(path))
        for path, run in waiting.items()
        if path not in shared
    }
    if not sequential and len(whole) > 1:
        for path, outcome in pool.results(_test, whole, "test"):
            if isinstance(outcome, WorkerDiedError):
                outcome = Result(waiting[path], error=str(outcome))
            yield replace(outcome, why=why[path])
        whole = {}
    for path in [*whole, *shared]:
        run = waiting[path]
        roll = _on_all(pool) if path in shared else None
        result = _test(run, protocol, not force, conditions.get(path), partial(report, run), roll)
        yield replace(result, why=why[path])


def _row_by_row(run: RunDirectory) -> bool:
    try:
        algo: Any = run.config().get("algo", {})
        name = str(algo.get("agent"))
        if name in AGENTS.own:
            factory = None if AGENTS[name].learns else resolve(AGENTS[name].code)
        else:
            factory = resolve(AGENTS.choose(name, str(algo.get("package"))).code)
    except (AuvbenchError, AttributeError):
        return False  # the test reports the error
    return bool(getattr(factory, "row_by_row", False))


def _conditions(run: RunDirectory, protocol: schema.Protocol) -> list[ResolvedCondition] | None:
    try:
        return resolve_conditions(protocol, run.check())
    except AuvbenchError:
        return None  # the test reports the error


def _test(
    run: RunDirectory,
    protocol: schema.Protocol,
    unless_done: bool,
    conditions: list[ResolvedCondition] | None,
    report: Report = lambda *_: None,
    roll: Roll | None = None,
) -> Result:
    try:
        summary = evaluate(run, protocol, report, unless_done=unless_done, roll=roll, conditions=conditions)
        return Result(run, summary)
    except AuvbenchError as error:
        return Result(run, error=naming_traceback(error), locked=isinstance(error, RunHeldError))


def _on_all(pool: Pool) -> Roll:
    """Return a function that rolls out a condition on all workers, with one job per episode."""

    def roll(
        run: RunDirectory, protocol: schema.Protocol, condition: ResolvedCondition, report: Report
    ) -> Rollout:
        jobs = {episode: (run, protocol, condition, episode) for episode in range(protocol.episodes)}
        parts: dict[int, Rollout] = {}
        for episode, outcome in pool.results(_episode, jobs, f"episode of {run.path}"):
            if isinstance(outcome, WorkerDiedError):
                raise WorkerDiedError(f"{run.path}, episode {outcome}")
            parts[episode] = outcome
            report(condition.name, 1)
        return Rollout.joined([parts[episode] for episode in jobs])

    return roll


_cached: tuple[tuple[Path, float], Agent] | None = None
"""Agent of the last episode in this process; building an agent may take half as long as an episode."""


def _episode(
    run: RunDirectory, protocol: schema.Protocol, condition: ResolvedCondition, episode: int
) -> Rollout:
    """Reset the agent and roll out one episode of a condition."""
    global _cached
    key = run.path, condition.config.step.frequency
    if _cached is None or _cached[0] != key:
        _cached = key, make_agent(run, condition.config.step.frequency)
    path = episode < protocol.trajectories
    return one_episode(condition.config, _cached[1], protocol, episode, path=path)
