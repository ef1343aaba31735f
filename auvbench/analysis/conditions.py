"""Compute success and the primary measure under each condition of a protocol, and their change from the
undisturbed condition.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from auvbench.analysis.grouping import failed_training
from auvbench.analysis.measures import UNKNOWN, Measure, metric_of
from auvbench.analysis.records import Agent, Condition, Evaluation, RunRecord
from auvbench.statistics import crossed, means, wilson
from auvbench.statistics.intervals import Estimate, FloatArray
from auvbench.untrusted.text import short

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
"""units of a factor's levels"""


def split(condition: str) -> tuple[str, str]:
    """Return factor and level of a condition; a condition without a level is a factor with the level ''.

    >>> split("current=0.5"), split("dead-thruster")
    (('current', '0.5'), ('dead-thruster', ''))
    """
    factor, _, level = condition.partition("=")
    return factor, level


def in_words(condition: str) -> tuple[str, str]:
    """Return factor and level, the level with its unit.

    >>> in_words("current=0.5"), in_words("mass=1.3"), in_words("nominal")
    (('current', '0.5 m/s'), ('mass', '× 1.3'), ('nominal', ''))
    """
    factor, level = split(condition)
    unit = UNITS.get(factor, "")
    return factor, f"× {level}" if unit == "times" else f"{level} {unit}".strip()


def sealed_note(runs: Sequence[RunRecord], protocol: str) -> str:
    """Return a note on the files of a sealed protocol and the untested conditions; '' for other protocols."""
    files: dict[str, None] = {}
    missing: dict[str, None] = {}
    for run in runs:
        evaluation = run.evaluations.get(protocol)
        if evaluation is None or not (seal := evaluation.summary.get("sealed")):
            continue
        files |= {f"{short(name, 60)} {short(digest, 12)}": None for name, digest in seal["sha256"].items()}
        missing |= dict.fromkeys(short(what) for what in seal["not_tested"])
    if not files:
        return ""
    tested = f" Not tested: {'; '.join(missing)}." if missing else ""
    return f"Sealed protocol (SHA-256: {', '.join(files)}).{tested}"


def default(runs: Sequence[RunRecord], protocol: str) -> str:
    """Return the condition to report by default: the undisturbed one, else the protocol's first."""
    for run in runs:
        if protocol in run.evaluations:
            names = [c["name"] for c in run.evaluations[protocol].summary["conditions"]]
            return names[0] if names and UNDISTURBED not in names else UNDISTURBED
    return UNDISTURBED


def results(
    agents: Sequence[Agent], protocol: str, confidence: float, by: Measure | None = None
) -> tuple[Condition, ...]:
    """Return the results under each condition, in the protocol's order; empty for a protocol with one condition.

    A failed training counts as a seed without a success, as in `grouping.agents`. `by` is the measure whose means
    are computed (see `of_evaluations`).
    """
    tested = {a.label: [r.evaluations[protocol] for r in a.runs if protocol in r.evaluations] for a in agents}
    names = {
        c["name"]
        for evaluations in tested.values()
        for evaluation in evaluations
        for c in evaluation.summary["conditions"]
    }
    if len(names) < 2:
        return ()
    failed = {
        a.label: (n, by.failure(a) if by else math.nan)
        for a in agents
        if (n := sum(failed_training(r) and protocol not in r.evaluations for r in a.runs))
    }
    return of_evaluations(tested, confidence, by, failed)


def of_evaluations(
    tested: Mapping[str, Sequence[Evaluation]],
    confidence: float,
    by: Measure | None = None,
    failed: Mapping[str, tuple[int, float]] = {},
) -> tuple[Condition, ...]:
    """Return success rates and means under each condition, with changes from the undisturbed condition (if any).

    Args:
        tested: evaluations of each agent's seeds, by the agent's label; all with the same scenarios.
        confidence: confidence of the intervals.
        by: measure whose means are computed; ignored if it is a rate or a penalised time.
        failed: for an agent's label, the number of the agent's failed trainings, and the value of `by` that an
            episode of a failed training gets.
    """
    column = by.column if by and not by.rate and not by.penalty else ""
    kind = metric_of(column) or UNKNOWN
    met = {label: by_condition(evaluations, column) for label, evaluations in tested.items()}
    names = dict.fromkeys(name for conditions in met.values() for name in conditions)
    for label, (n, value) in failed.items():
        for name in names:
            example = next(conditions[name] for conditions in met.values() if name in conditions)
            met[label][name] = met[label].get(name, example.without_seeds()).with_failed(n, value)
    return tuple(_condition(name, met, confidence, (kind.low, kind.high)) for name in names)


@dataclass(frozen=True, slots=True)
class Met:
    """Results of an agent's seeds under one condition; columns are scenarios."""

    success: FloatArray
    """Successes (seeds, E): 1.0 for a successful episode, else 0.0"""
    par1: FloatArray
    """Steps (seeds, E) of each episode; the step limit for a failed episode"""
    time: tuple[float, float]
    """Step frequency in Hz, and step limit; two conditions are compared in steps only if both numbers are equal"""
    measured: FloatArray | None = None
    """Values (seeds, E) of the primary measure; None if the episodes do not have the measure's column"""

    def without_seeds(self) -> Met:
        """Return the results without any seed, as arrays (0, E)."""
        return Met(
            self.success[:0], self.par1[:0], self.time, None if self.measured is None else self.measured[:0]
        )

    def with_failed(self, n: int, value: float) -> Met:
        """Add `n` seeds that fail in every scenario; the primary measure of a failed episode is `value`."""

        def more(rows: FloatArray, fill: float) -> FloatArray:
            return np.concatenate([rows, np.full((n, rows.shape[1]), fill)])

        measured = None if self.measured is None else more(self.measured, value)
        return Met(more(self.success, 0.0), more(self.par1, self.time[1]), self.time, measured)


def by_condition(evaluations: Sequence[Evaluation], column: str) -> dict[str, Met]:
    """Return the results of seeds by condition, in the protocol's order.

    Args:
        evaluations: evaluations of the seeds of one agent.
        column: column of the primary measure; '' for none.
    """
    rows: dict[str, list[pd.DataFrame]] = {}
    times: dict[str, tuple[float, float]] = {}
    for evaluation in evaluations:
        frames = dict(iter(evaluation.episodes.groupby("condition", observed=True)))
        for condition in evaluation.summary["conditions"]:
            name = condition["name"]
            times[name] = condition["frequency_hz"], condition["max_steps"]
            rows.setdefault(name, []).append(frames[name].sort_values("episode"))
    results = {}
    for name, seeds in rows.items():
        success = np.array([(seed["outcome"] == "success").to_numpy(np.float64) for seed in seeds])
        steps = np.array([seed["steps"].to_numpy(np.float64) for seed in seeds])
        present = column and all(column in seed for seed in seeds)
        measured = np.array([seed[column].to_numpy(np.float64) for seed in seeds]) if present else None
        results[name] = Met(success, np.where(success > 0, steps, times[name][1]), times[name], measured)
    return results


def _condition(
    name: str,
    met: Mapping[str, Mapping[str, Met]],
    confidence: float,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> Condition:
    met_here = {label: conditions[name] for label, conditions in met.items() if name in conditions}
    measured = {label: m.measured for label, m in met_here.items() if m.measured is not None}
    # An agent has a change only if each of its seeds was tested under this and under the undisturbed condition.
    pairs = {
        label: (m, still)
        for label, m in met_here.items()
        if name != UNDISTURBED
        and (still := met[label].get(UNDISTURBED))
        and m.success.shape == still.success.shape
    }
    successes = {label: m.success - still.success for label, (m, still) in pairs.items()}
    steps = {label: m.par1 - still.par1 for label, (m, still) in pairs.items() if m.time == still.time}
    return Condition(
        name,
        success=_means({label: m.success for label, m in met_here.items()}, confidence, rate=True),
        success_change=_changes(successes, confidence, rate=True),
        par1_change=_changes(steps, confidence),
        measured=_means(measured, confidence, bounds=bounds),
    )


def _means(
    by_agent: Mapping[str, FloatArray],
    confidence: float,
    *,
    rate: bool = False,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> dict[str, Estimate]:
    """Return the mean of each agent's values (seeds, scenarios) with its interval, by label."""
    if not by_agent:
        return {}
    table = crossed(list(by_agent.values()), rate=rate, paired=False, bounds=bounds)
    return dict(zip(by_agent, means(table, confidence), strict=True))


def _changes(
    by_agent: Mapping[str, FloatArray], confidence: float, *, rate: bool = False
) -> dict[str, Estimate]:
    """Return the mean of each agent's changes (seeds, scenarios) with its interval, by label.

    The interval of a rate's change has a width even if no outcome changes: no change in n = 200 trials still
    allows a change of 1.9 %.
    """
    means_of_changes = _means(by_agent, confidence, bounds=(-1.0, 1.0) if rate else (-np.inf, np.inf))
    for label, changes in by_agent.items():
        if rate and not changes.any():
            most = float(wilson(0, changes.shape[1], confidence)[1])
            means_of_changes[label] = replace(means_of_changes[label], low=-most, high=most)
    return means_of_changes
