"""Time to goal over the best known time of the scenario (`auvbench bound`).

The best known time is that of a trajectory which arrives in the simulator: one found by optimal control, or that of the
quickest agent. The true optimum is no longer, so an agent takes at least this many times the optimum. The ratio is
over successes, as a geometric mean, which does not depend on the denominator (Fleming and Wallace 1986, CACM 29:218).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from auvbench import statistics as st
from auvbench.analysis.formatting import counted, listed
from auvbench.analysis.records import Agent, Limit, Ranking
from auvbench.evaluation.bounds import files
from auvbench.statistics import crossed
from auvbench.statistics.intervals import Estimate, FloatArray

COLUMN = "time_over_best_known"
"""name of the estimate, and of the column on request"""


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Of each episode, in the order of the agents' columns; s."""

    computed: FloatArray
    """(n,) in which the search arrived"""
    proven: FloatArray
    """(n,) below which no arrival is noticed"""
    limit: FloatArray
    """(n,) the shorter one of `computed` and what the quickest agent of the table took"""


def add_optimality(ranking: Ranking, agents: Sequence[Agent]) -> Ranking:
    """The ranking with its limit and each agent's time over it, or with the line that says why there is none."""
    name = _vehicle(agents)
    if not name or not files.is_name(name) or not files.is_name(ranking.protocol):
        return replace(ranking, no_limit="No limit: the runs do not name one vehicle.")
    limits, said = files.find(ranking.protocol, name, ranking.fingerprint, _roots(agents))
    held = [] if limits is None else limits.condition(ranking.condition)
    if not held:
        return replace(ranking, no_limit=_none(ranking, name, limits, said))
    times, beaten = _times(held, agents)
    if times is None:
        return replace(ranking, no_limit=f"The limits of protocol {ranking.protocol} are of other episodes.")
    by_label = {agent.label: agent for agent in agents}
    rows = []
    for row in ranking.rows:
        found = over(by_label[row.label], times.limit, ranking.confidence)
        rows.append(row if found is None else replace(row, estimates={**row.estimates, COLUMN: found}))
    return replace(ranking, rows=tuple(rows), limit=_limit(held, times, beaten))


def over(agent: Agent, limit: FloatArray, confidence: float) -> Estimate | None:
    """Return the geometric mean of time to goal over the best known (n,) s, over successes; None without successes."""
    times = agent.metrics.get("time_to_goal_s")
    if times is None:
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(np.asarray(times, dtype=np.float64) / limit)
    logs = np.where(np.isfinite(logs), logs, np.nan)
    if not np.isfinite(logs).any():
        return None
    # The limit is no longer than any agent's time, so a ratio is no less than 1.
    table = crossed([logs], paired=False, bounds=(0.0, np.inf))
    found = st.means(table, confidence)[0]
    return replace(found, value=math.exp(found.value), low=math.exp(found.low), high=math.exp(found.high))


def _times(
    held: Sequence[files.Bound], agents: Sequence[Agent]
) -> tuple[Times | None, tuple[tuple[str, int, float], ...]]:
    """The times of the agents' episodes, and by agent how often and by how many seconds it was quicker at most."""
    episodes = len(agents[0].outcome[0])
    # Episodes are whole numbers from 0 in the order of the columns; a table refuses others.
    if [bound.episode for bound in held] != list(range(episodes)):
        return None, ()
    steps, least, frequency = np.array([(b.steps, b.least_steps, b.frequency_hz) for b in held]).T
    computed = steps / frequency
    limit = computed.copy()
    beaten = []
    for agent in agents:
        times = agent.metrics.get("time_to_goal_s")
        if times is None or not np.isfinite(times).any():
            continue
        quickest = np.min(np.where(np.isfinite(times), times, np.inf), axis=0)
        # Times are multiples of a step: what is less is rounding.
        gained = computed - quickest
        ahead = gained > 1e-6
        if ahead.any():
            beaten.append((agent.label, int(ahead.sum()), float(gained[ahead].max())))
        limit = np.minimum(limit, np.where(ahead, quickest, np.inf))
    return Times(computed, least / frequency, limit), tuple(beaten)


def _limit(held: Sequence[files.Bound], times: Times, beaten: tuple[tuple[str, int, float], ...]) -> Limit:
    return Limit(
        seconds=float(times.limit.mean()),
        steps=float(times.limit.mean() * held[0].frequency_hz),
        proven_seconds=float(times.proven.mean()),
        gap=float(np.median(times.limit / times.proven)),
        episodes=len(times.limit),
        beaten=beaten,
        by_episode=tuple(
            zip(times.limit.tolist(), times.computed.tolist(), times.proven.tolist(), strict=True)
        ),
    )


def _vehicle(agents: Sequence[Agent]) -> str:
    names = {str(run.config.get("vehicle.name") or "") for agent in agents for run in agent.runs}
    return names.pop() if len(names) == 1 else ""


def _roots(agents: Sequence[Agent]) -> list[Path]:
    """`bounds` in the folder of the runs' experiments, where `auvbench bound` writes."""
    parents = {run.directory.absolute().parent.parent for agent in agents for run in agent.runs}
    return [parent / files.FOLDER for parent in sorted(parents)[:4]]


def _none(ranking: Ranking, vehicle: str, limits: files.Limits | None, said: Sequence[str]) -> str:
    if limits is not None:
        why = next((line for line in limits.left_out if line.startswith(f"{ranking.condition}:")), "")
        return f"No limit under condition {why or ranking.condition}."
    stale = f" What is there cannot be used: {said[0]}." if said else ""
    return (
        f"No limit for protocol {ranking.protocol} and {vehicle}: auvbench bound protocol={ranking.protocol} "
        f"vehicle={vehicle} computes it.{stale}"
    )


def sentences(limit: Limit) -> list[str]:
    """What stands below a table: the limit itself, which is no contestant, and what it says and does not say."""
    found = [
        f"Best known: {limit.seconds:.2f} s on average ({limit.steps:.1f} steps) over {limit.episodes} scenarios, by optimal "
        "control that knows the state, without noise, replayed in the simulator; it has no rank. Proven lower bound: "
        f"{limit.proven_seconds:.2f} s on average; best known is {limit.gap:.2f} times the lower bound (median)."
    ]
    if limit.beaten:
        parts = [
            f"{label} in {counted(count, 'scenario')} (by at most {seconds:.2g} s)"
            for label, count, seconds in sorted(limit.beaten, key=lambda agent: -agent[1])
        ]
        found.append(
            f"Sooner than the computed trajectory: {listed(parts, len(parts))}; there the best known time is that of the "
            "quickest agent."
        )
    return found


def explained() -> str:
    """What the column is."""
    return (
        "Time over best known: time to goal over the best known time of the scenario, geometric mean over successes; read "
        "it with the success rate. The optimum is at most the best known time, so the ratio to it is at least this one."
    )
