"""Success under each condition of a protocol that has several, such as robustness, frequency_sweep and transfer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from auvbench.analysis.model import Agent, Condition, RunRecord
from auvbench.statistics import crossed, means
from auvbench.statistics.intervals import FloatArray

UNDISTURBED = "nominal"
UNITS = {
    "current": "m/s",
    "delay": "s",
    "frequency": "Hz",
    "noise": "times",
    "mass": "times",
    "drag": "times",
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
    tested = {label: [run.evaluations[protocol].episodes for run in runs] for label, runs in there.items()}
    return of_tables(tested, tuple(names), confidence)


def of_tables(
    tested: Mapping[str, Sequence[pd.DataFrame]], names: Sequence[str], confidence: float
) -> tuple[Condition, ...]:
    """Success rates under conditions from tables of episodes.

    Args:
        tested: by agent, the table of each seed; all of the same scenarios.
        names: of the conditions, each in at least one table.
        confidence: of the intervals.
    """
    rates = {label: [_by_condition(table) for table in seeds] for label, seeds in tested.items()}
    return tuple(_condition(name, rates, confidence) for name in names)


def rates_by_condition(agent: Agent, protocol: str) -> dict[str, FloatArray]:
    """(seeds, episodes) of 1.0 where an episode was a success, by condition of the protocol.

    A condition that not all seeds of the agent met on as many scenarios is left out, as are seeds without a policy.
    """
    tables = [
        _by_condition(run.evaluations[protocol].episodes) for run in agent.runs if protocol in run.evaluations
    ]
    if not tables:
        return {}
    shared = set.intersection(*(set(table) for table in tables))
    rows = {name: [table[name] for table in tables] for name in tables[0] if name in shared}
    return {name: np.array(found) for name, found in rows.items() if len({len(row) for row in found}) == 1}


def _names(run: RunRecord, protocol: str) -> list[str]:
    return [str(c.get("name", "")) for c in run.evaluations[protocol].summary["conditions"]]


def _by_condition(episodes: pd.DataFrame) -> dict[str, FloatArray]:
    """(E,) of 1.0 where an episode was a success, by condition, in the order of the scenarios."""
    codes, found = pd.factorize(episodes["condition"])
    order = np.lexsort((episodes["episode"].to_numpy(), codes))
    success = (episodes["outcome"].to_numpy() == "success")[order].astype(np.float64)
    ends = np.cumsum(np.bincount(codes, minlength=len(found)))
    return dict(zip(map(str, found), np.split(success, ends[:-1]), strict=True))


def _condition(
    name: str, tested: Mapping[str, Sequence[Mapping[str, FloatArray]]], confidence: float
) -> Condition:
    data = {label: [run[name] for run in runs if name in run] for label, runs in tested.items()}
    size = max(len(run) for runs in data.values() for run in runs)
    whole = {label: [run for run in runs if len(run) == size] for label, runs in data.items()}
    shown = {label: np.array(runs) for label, runs in whole.items() if runs}
    estimates = means(crossed(list(shown.values()), rate=True, paired=False), confidence)
    return Condition(name, dict(zip(shown, estimates, strict=True)))
