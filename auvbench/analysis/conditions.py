"""Success under each condition of a protocol that has several, and what changes against the undisturbed one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from auvbench.analysis.records import Agent, Condition, Evaluation, RunRecord
from auvbench.statistics import crossed, means, wilson
from auvbench.statistics.intervals import Estimate, FloatArray

UNDISTURBED = "nominal"
UNITS = {
    "current": "m/s",
    "delay": "s",
    "frequency": "Hz",
    "noise": "times",
    "mass": "times",
    "drag": "times",
    "payload": "of the mass",
}
"""of the levels of a factor"""


def split(condition: str) -> tuple[str, str]:
    """Factor and level of a condition; a condition that is no level of anything is a factor of its own.

    >>> split("current=0.5"), split("dead-thruster")
    (('current', '0.5'), ('dead-thruster', ''))
    """
    factor, _, level = condition.partition("=")
    return factor, level


def in_words(condition: str) -> tuple[str, str]:
    """Factor, and level with its unit.

    >>> in_words("current=0.5"), in_words("mass=1.3"), in_words("nominal")
    (('current', '0.5 m/s'), ('mass', '× 1.3'), ('nominal', ''))
    """
    factor, level = split(condition)
    unit = UNITS.get(factor, "")
    return factor, f"× {level}" if unit == "times" else f"{level} {unit}".strip()


def default(runs: Sequence[RunRecord], protocol: str) -> str:
    """The condition that is reported where none was asked for: the undisturbed one, else the protocol's first."""
    for run in runs:
        if protocol in run.evaluations:
            names = _names(run, protocol)
            return names[0] if names and UNDISTURBED not in names else UNDISTURBED
    return UNDISTURBED


def successes(agents: Sequence[Agent], protocol: str, confidence: float) -> tuple[Condition, ...]:
    """Success rates of the agents under every condition of the protocol, with the intervals of the ranked table.

    Args:
        agents: of one table, so that all their runs met the same scenarios.
        protocol: name of the protocol.
        confidence: of the intervals.

    Returns:
        the conditions in the order of the protocol; nothing where it has only one.
    """
    there = {a.label: [run for run in a.runs if protocol in run.evaluations] for a in agents}
    names = dict.fromkeys(name for runs in there.values() for run in runs for name in _names(run, protocol))
    if len(names) < 2:
        return ()
    tested = {label: [run.evaluations[protocol] for run in runs] for label, runs in there.items()}
    return of_evaluations(tested, tuple(names), confidence)


def of_evaluations(
    tested: Mapping[str, Sequence[Evaluation]], names: Sequence[str], confidence: float
) -> tuple[Condition, ...]:
    """Success rates under conditions, and changes against the undisturbed one where it is among them.

    Args:
        tested: by agent, the evaluation of each seed; all of the same scenarios.
        names: of the conditions, each in at least one evaluation.
        confidence: of the intervals.
    """
    found = {label: [_by_condition(evaluation) for evaluation in seeds] for label, seeds in tested.items()}
    return tuple(_condition(name, found, confidence) for name in names)


def rates_by_condition(agent: Agent, protocol: str) -> dict[str, FloatArray]:
    """(seeds, episodes) of 1.0 where an episode was a success, by condition of the protocol.

    A condition that not all seeds of the agent met on as many scenarios is left out, as are seeds without a policy.
    """
    tables = [_by_condition(run.evaluations[protocol]) for run in agent.runs if protocol in run.evaluations]
    if not tables:
        return {}
    shared = set.intersection(*(set(table) for table in tables))
    rows = {name: [table[name].success for table in tables] for name in tables[0] if name in shared}
    return {name: np.array(found) for name, found in rows.items() if len({len(row) for row in found}) == 1}


def _names(run: RunRecord, protocol: str) -> list[str]:
    return [str(c.get("name", "")) for c in run.evaluations[protocol].summary["conditions"]]


@dataclass(frozen=True, slots=True)
class _Met:
    """What one seed did under one condition, in the order of the scenarios."""

    success: FloatArray
    """(E,) 1.0 where an episode was one"""
    par1: FloatArray
    """(E,) steps, the limit where the episode was no success"""
    time: tuple[float, float] | None
    """step frequency in Hz and limit in steps: steps are compared where both are the same; None where not both are known"""


def _by_condition(evaluation: Evaluation) -> dict[str, _Met]:
    rows = evaluation.episodes
    codes, found = pd.factorize(rows["condition"])
    order = np.lexsort((rows["episode"].to_numpy(), codes))
    success = (rows["outcome"].to_numpy() == "success")[order].astype(np.float64)
    steps = rows["steps"].to_numpy(dtype=np.float64)[order]
    ends = np.cumsum(np.bincount(codes, minlength=len(found)))[:-1]
    times = {str(c["name"]): _time(c) for c in evaluation.summary["conditions"]}
    met = {}
    for name, ok, took in zip(map(str, found), np.split(success, ends), np.split(steps, ends), strict=True):
        time = times[name]
        met[name] = _Met(ok, np.where(ok > 0, took, np.nan if time is None else time[1]), time)
    return met


def _time(condition: Mapping[str, object]) -> tuple[float, float] | None:
    """As a summary has them; a foreign one may lack them."""
    frequency, limit = condition.get("frequency_hz"), condition.get("max_steps")
    if isinstance(frequency, (int, float)) and isinstance(limit, (int, float)):
        return float(frequency), float(limit)
    return None


def _condition(name: str, tested: Mapping[str, Sequence[Mapping[str, _Met]]], confidence: float) -> Condition:
    data = {label: [run[name].success for run in runs if name in run] for label, runs in tested.items()}
    size = max(len(run) for runs in data.values() for run in runs)
    whole = {label: [run for run in runs if len(run) == size] for label, runs in data.items()}
    shown = {label: np.array(runs) for label, runs in whole.items() if runs}
    estimates = means(crossed(list(shown.values()), rate=True, paired=False), confidence)
    found = Condition(name, dict(zip(shown, estimates, strict=True)))
    if name == UNDISTURBED:
        return found
    both = {label: _pairs(runs, name) for label, runs in tested.items()}
    successes = {
        label: np.array([there.success - still.success for there, still in pairs])
        for label, pairs in both.items()
        if pairs
    }
    steps = {
        label: np.array([there.par1 - still.par1 for there, still in pairs])
        for label, pairs in both.items()
        if pairs and all(still.time is not None and there.time == still.time for there, still in pairs)
    }
    return replace(
        found,
        success_change=_changes(successes, confidence, rate=True),
        par1_change=_changes(steps, confidence),
    )


def _pairs(runs: Sequence[Mapping[str, _Met]], name: str) -> list[tuple[_Met, _Met]]:
    """What each seed did under a condition and undisturbed; nothing where not all seeds met both on the same scenarios."""
    found = [(run[name], run[UNDISTURBED]) for run in runs if name in run and UNDISTURBED in run]
    sizes = {len(met.success) for pair in found for met in pair}
    return found if len(found) == len(runs) and len(sizes) == 1 else []


def _changes(
    by_agent: Mapping[str, FloatArray], confidence: float, *, rate: bool = False
) -> dict[str, Estimate]:
    """Mean change of each agent, (seeds, scenarios) by label, with its interval.

    Where no scenario changes hands, that of the rate does not end at 0: none of n trials may be 1.9 % of all with n = 200.
    """
    if not by_agent:
        return {}
    bounds = (-1.0, 1.0) if rate else (-np.inf, np.inf)
    table = crossed(list(by_agent.values()), paired=False, bounds=bounds)
    found = dict(zip(by_agent, means(table, confidence), strict=True))
    for label, changes in by_agent.items():
        if rate and not changes.any():
            most = float(wilson(0, changes.shape[1], confidence)[1])
            found[label] = replace(found[label], low=-most, high=most)
    return found
