"""Compute optional columns: computing time of actions and trainings, time over the best known time, and any
measure.

The best known time of a scenario is the time of the quickest known trajectory to the goal in the simulator. This
trajectory comes from optimal control (`auvbench bound`) or from an agent. The optimum is at most this time, so
an agent's ratio to the optimum is at least the ratio shown. The average over successes is the geometric mean,
because comparisons of geometric means do not depend on the denominator (Fleming and Wallace 1986, CACM 29:218).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench import statistics as st
from auvbench.analysis.measures import measures
from auvbench.analysis.records import Agent, Limit, Ranking, learns
from auvbench.errors import ReportError, closest
from auvbench.evaluation.bounds import files
from auvbench.statistics import crossed
from auvbench.statistics.intervals import Estimate, FloatArray

ACTION, TRAINING, OVER_BEST_KNOWN = "action_ms", "training_cpu_s", "time_over_best_known"
COLUMNS = (ACTION, TRAINING, OVER_BEST_KNOWN)
"""names that --columns accepts in addition to measures; `add_optimality` computes the last one"""


def action_time(agent: Agent, protocol: str) -> Estimate | None:
    """Return the median processor time per action in ms, averaged over runs; None if a run was not timed."""
    timed = _timed(agent, protocol)
    return _mean([timing["median_ms"] for timing in timed]) if all(timed) else None


def training_time(agent: Agent) -> Estimate | None:
    """Return the processor time of a training in s, averaged over runs; None for a controller, or if a time is unknown."""
    times = [run.manifest.get("cpu_time_s") for run in agent.runs]
    return _mean([time for time in times if time]) if learns(agent) and all(times) else None


def _timed(agent: Agent, protocol: str) -> list[Any]:
    """Return the timing of actions from the summary of each run's test; an entry is None if the timing failed."""
    return [r.evaluations[protocol].summary["inference"] for r in agent.runs if protocol in r.evaluations]


def _mean(values: Sequence[float]) -> Estimate | None:
    return Estimate(float(np.mean(values)), np.nan, np.nan, 0.95) if values else None


def machines(agents: Sequence[Agent], protocol: str, columns: Sequence[str]) -> tuple[str, ...]:
    """Return a caution for each column whose times were measured on different processors."""
    processors = {"an action": {t["cpu"] for agent in agents for t in _timed(agent, protocol) if t}}
    if TRAINING in columns:
        hosts = (run.manifest.get("host") for agent in agents if learns(agent) for run in agent.runs)
        processors["a training"] = {str(host.get("cpu")) for host in hosts if host}
    return tuple(
        f"Times of {what} are of different processors and do not compare: {', '.join(sorted(names))}."
        for what, names in processors.items()
        if len(names) > 1
    )


def validate_columns(names: Sequence[str]) -> None:
    """Validate the names of --columns: optional columns and measures.

    Raises:
        ReportError: a name is unknown.
    """
    available = [*COLUMNS, *measures()]
    for name in names:
        if name not in available:
            raise ReportError(f"--columns {name!r} is not a column; {closest(name, available)}")


def with_columns(ranking: Ranking, agents: Sequence[Agent], names: Sequence[str]) -> Ranking:
    """Return the ranking with the processor time per action and the columns `names`.

    An agent without a value has an empty cell. `names` must be valid (`validate_columns`).
    """
    rows = []
    for row, agent in zip(ranking.rows, ranking.ordered(agents), strict=True):
        times = {ACTION: action_time(agent, ranking.protocol)}
        if TRAINING in names:
            times[TRAINING] = training_time(agent)
        columns = {name: time for name, time in times.items() if time is not None}
        rows.append(replace(row, estimates={**row.estimates, **columns}))
    return replace(
        ranking, rows=tuple(rows), columns=tuple(names), machines=machines(agents, ranking.protocol, names)
    )


def add_optimality(ranking: Ranking, agents: Sequence[Agent]) -> Ranking:
    """Return the ranking with the best known time (`Limit`), and with each agent's time divided by the best known time.

    If no best known time is available, `Ranking.no_limit` gives the reason.
    """
    vehicles = {str(run.config.get("vehicle.name") or "") for agent in agents for run in agent.runs}
    name = vehicles.pop()
    if vehicles or not files.is_name(name) or not files.is_name(ranking.protocol):
        return replace(ranking, no_limit="No limit: all runs must have the same vehicle.")
    # `auvbench bound` writes to the folder `bounds` next to the runs' experiments.
    parents = {run.directory.absolute().parent.parent for agent in agents for run in agent.runs}
    roots = [parent / files.FOLDER for parent in sorted(parents)[:4]]
    limits, unusable = files.find(ranking.protocol, name, ranking.fingerprint, roots)
    bounds = [] if limits is None else limits.condition(ranking.condition)
    # Bound i must belong to the scenario of column i, so the bounds of all episodes must be present and in order.
    if [bound.episode for bound in bounds] != list(range(len(agents[0].outcome[0]))):
        return replace(ranking, no_limit=_none(ranking, name, limits, unusable))
    steps, least, frequency = np.array([(b.steps, b.least_steps, b.frequency_hz) for b in bounds]).T
    best, proven = steps / frequency, least / frequency
    for agent in agents:
        times = agent.metrics.get("time_to_goal_s")
        if times is not None:
            quickest = np.min(np.where(np.isfinite(times), times, np.inf), axis=0)
            # Times are multiples of a step, so a difference below 1e-6 s is a rounding error.
            best = np.where(best - quickest > 1e-6, quickest, best)
    rows = []
    for row, agent in zip(ranking.rows, ranking.ordered(agents), strict=True):
        ratio = over(agent, best, ranking.confidence)
        rows.append(
            row if ratio is None else replace(row, estimates={**row.estimates, OVER_BEST_KNOWN: ratio})
        )
    limit = Limit(
        seconds=float(best.mean()),
        steps=float(best.mean() * bounds[0].frequency_hz),
        proven_seconds=float(proven.mean()),
        gap=float(np.median(best / proven)),
        episodes=len(best),
    )
    return replace(ranking, rows=tuple(rows), limit=limit)


def over(agent: Agent, limit: FloatArray, confidence: float) -> Estimate | None:
    """Return the time to the goal divided by the best known time, as a geometric mean over successful episodes.

    Args:
        agent: agent whose times are divided by the best known times.
        limit: (n,) best known time of each scenario, s.
        confidence: confidence of the interval.

    Returns:
        Mean ratio with its interval; None if no episode succeeds.
    """
    times = agent.metrics.get("time_to_goal_s")
    if times is None:
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(np.asarray(times, dtype=np.float64) / limit)
    logs = np.where(np.isfinite(logs), logs, np.nan)
    if not np.isfinite(logs).any():
        return None
    # The limit is at most any agent's time, so a ratio is at least 1.
    table = crossed([logs], paired=False, bounds=(0.0, np.inf))
    estimate = st.means(table, confidence)[0]
    return replace(
        estimate, value=math.exp(estimate.value), low=math.exp(estimate.low), high=math.exp(estimate.high)
    )


def _none(ranking: Ranking, vehicle: str, limits: files.Limits | None, unusable: Sequence[str]) -> str:
    if limits is not None:
        why = next((line for line in limits.about.left_out if line.startswith(f"{ranking.condition}:")), "")
        return f"No limit under condition {why or ranking.condition}."
    stale = f" The existing bounds cannot be used: {unusable[0]}." if unusable else ""
    return (
        f"No limit for protocol {ranking.protocol} and {vehicle}: auvbench bound protocol={ranking.protocol} "
        f"vehicle={vehicle} computes it.{stale}"
    )


def sentences(limit: Limit) -> list[str]:
    """Return the notes below a table on the column "time over best known" and on the best known times."""
    return [
        "Time over best known: time to goal over the best known time of the scenario, geometric mean over successes; read "
        "it with the success rate. The optimum is at most the best known time, so the ratio to it is at least this one.",
        f"Best known: {limit.seconds:.2f} s on average ({limit.steps:.1f} steps) over {limit.episodes} scenarios, by optimal "
        "control that knows the state, without noise, replayed in the simulator; it has no rank. Proven lower bound: "
        f"{limit.proven_seconds:.2f} s on average; best known is {limit.gap:.2f} times the lower bound (median).",
    ]
