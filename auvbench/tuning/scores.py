"""The score of a trial: a measure of the tables over its validation episodes, and a second measure that breaks ties."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

from auvbench.analysis.grouping import agents
from auvbench.analysis.load import load
from auvbench.analysis.measures import Measure, to_rank_by
from auvbench.analysis.records import Agent
from auvbench.errors import RunError
from auvbench.runs.directory import RunDirectory
from auvbench.statistics import crossed, means
from auvbench.statistics.intervals import Estimate


@dataclass(frozen=True, slots=True)
class Score:
    """A trial at a rung."""

    score: float
    """decides; higher is better"""
    objective: float
    low: float
    high: float
    """95 % interval of the objective over validation episodes, and over seeds where there are several"""
    then: float

    @property
    def estimate(self) -> Estimate:
        """Return the objective with its interval."""
        return Estimate(self.objective, self.low, self.high)

    def plain(self) -> list[float | None]:
        """Return the score as the journal holds it; JSON has no NaN."""
        return [value if math.isfinite(value) else None for value in astuple(self)]


def of_plain(plain: Any) -> Score:
    """Return the score that the journal holds.

    Raises:
        TypeError, ValueError: It is not a score.
    """
    return Score(*(math.nan if value is None else float(value) for value in plain))


@dataclass(frozen=True, slots=True)
class Objective:
    """The measures that decide which trial is best."""

    measure: Measure
    then: Measure

    def of(self, runs: Sequence[RunDirectory], protocol: str) -> Score:
        """Return the score of a trial's runs, all tested by the protocol.

        Raises:
            RunError: An evaluation is missing or damaged.
        """
        agent = tested(runs, protocol)
        estimate, then = interval(agent, self.measure), interval(agent, self.then).value
        if not math.isfinite(estimate.value):
            raise RunError(f"{runs[0].path}: has no {self.measure.name} on {protocol}")
        score = self._joined(agent, estimate.value, then)
        return Score(score, estimate.value, estimate.low, estimate.high, then)

    def _joined(self, agent: Agent, value: float, then: float) -> float:
        """Return one number in the order of both measures: the second moves a rate by less than one episode does."""
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
    """Return the objective of these measures.

    Raises:
        ReportError: A measure is unknown.
    """
    return Objective(to_rank_by(name, "tune.objective"), to_rank_by(then, "tune.then"))


def tested(runs: Sequence[RunDirectory], protocol: str) -> Agent:
    """Return the runs' validation episodes as an agent of the tables, with the digests of their files checked.

    Raises:
        RunError: An evaluation is missing or damaged, or the runs have different scenarios.
        ReportError: A run is missing.
    """
    records, problems = load([run.path for run in runs], protocol)
    episodes = [r.evaluations[protocol].episodes for r in records if protocol in r.evaluations]
    if len(episodes) == len(runs):
        condition = str(episodes[0]["condition"].iloc[0])
        found, more = agents(records, protocol=protocol, condition=condition)
        if len(found) == 1 and len(found[0].runs) == len(runs):
            return found[0]
        problems += more
    why = "; ".join(f"{problem.where}: {problem.message}" for problem in problems[:3])
    raise RunError(f"{why or runs[0].path}: remove the evaluation {protocol!r} and type the command again")


def interval(agent: Agent, measure: Measure) -> Estimate:
    """Return the measure with its 95 % interval."""
    table = crossed([measure.values(agent)], rate=measure.rate, paired=False, bounds=measure.bounds([agent]))
    return means(table)[0]
