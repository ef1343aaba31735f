"""What a trial is worth: a measure of the tables over its seeds' validation episodes, and another where that ties."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from auvbench.analysis.evaluations import Damage, read_evaluation
from auvbench.analysis.measures import Measure, to_rank_by
from auvbench.analysis.model import Agent
from auvbench.errors import RunError
from auvbench.record import OUTCOMES
from auvbench.runs.directory import RunDirectory
from auvbench.statistics import crossed, means
from auvbench.statistics.estimate import Estimate


@dataclass(frozen=True, slots=True)
class Score:
    """A trial at a rung."""

    score: float
    """what decides: higher is better"""
    objective: float
    low: float
    high: float
    """the objective's 95 % interval: over validation episodes, and seeds where there are several"""
    then: float
    runs: tuple[str, ...]
    """ids, one per seed"""

    def plain(self) -> dict[str, Any]:
        return {**asdict(self), "runs": list(self.runs)}


@dataclass(frozen=True, slots=True)
class Objective:
    """What is best."""

    measure: Measure
    then: Measure

    def of(self, runs: Sequence[RunDirectory], protocol: str) -> Score:
        """The score of a trial's runs, which were all tested by the protocol.

        Raises:
            RunError: an evaluation is missing or damaged.
        """
        agent = tested(runs, protocol)
        estimate, then = interval(agent, self.measure), interval(agent, self.then).value
        if not math.isfinite(estimate.value):
            raise RunError(f"{runs[0].path}: has no {self.measure.name} on {protocol}")
        return Score(
            self._joined(agent, estimate.value, then),
            estimate.value,
            estimate.low,
            estimate.high,
            then,
            tuple(run.id for run in runs),
        )

    def _joined(self, agent: Agent, value: float, then: float) -> float:
        """One number in the order of both: the second measure moves a rate by less than an episode does."""
        score = self.measure.sign * value
        if not self.measure.rate or not math.isfinite(then):
            return score
        least, most = (float(end[0]) for end in self.then.bounds([agent]))
        if math.isfinite(least) and math.isfinite(most) and most > least:
            share = (then - least) / (most - least)
        else:
            share = 0.5 + 0.5 * then / (1 + abs(then))
        return score + self.then.sign * 0.5 * share / agent.outcome.size


def objective(name: str, then: str) -> Objective:
    """The objective of these names.

    Raises:
        ReportError: there is no such measure.
    """
    return Objective(to_rank_by(name, "tune.objective"), to_rank_by(then, "tune.then"))


def tested(runs: Sequence[RunDirectory], protocol: str) -> Agent:
    """The runs' validation episodes as an agent of the tables.

    Raises:
        RunError: an evaluation is missing or damaged, or they are not of the same scenarios.
    """
    found = []
    for run in runs:
        try:
            found.append(read_evaluation(run.evaluation(protocol)))
        except Damage as error:
            raise RunError(
                f"{run.evaluation(protocol)}: {error}; remove the folder and type the command again"
            ) from error
    if len({evaluation.fingerprint for evaluation in found}) > 1:
        raise RunError(
            f"{runs[0].path}: the trial's runs were tested on different scenarios; remove their evaluations"
        )
    codes = {name: code for code, name in enumerate(OUTCOMES)}
    frames = [evaluation.episodes.sort_values("episode") for evaluation in found]
    columns = [
        c
        for c in frames[0].columns
        if frames[0][c].dtype.kind in "if" and c not in ("episode", "environment")
    ]
    limits = [c.get("max_steps") for c in found[0].summary["conditions"]]
    return Agent(
        label=runs[0].id,
        key={},
        runs=(),
        fingerprint=found[0].fingerprint,
        outcome=np.array([[codes[str(o)] for o in frame["outcome"]] for frame in frames], dtype=np.int8),
        metrics={c: np.array([frame[c].to_numpy(dtype=np.float64) for frame in frames]) for c in columns},
        step_limit=float(limits[0]) if isinstance(limits[0], int | float) else None,
    )


def interval(agent: Agent, measure: Measure) -> Estimate:
    """The measure with its 95 % interval."""
    table = crossed([measure.values(agent)], rate=measure.rate, paired=False, bounds=measure.bounds([agent]))
    return means(table)[0]
