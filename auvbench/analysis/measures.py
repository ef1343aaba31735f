"""Define the measures by which agents are ranked: values per episode, better direction, possible range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.analysis.records import NO_POLICY, Agent
from auvbench.errors import ReportError, closest
from auvbench.metrics import Metric, registered
from auvbench.record import OUTCOMES, columns
from auvbench.registry import TASKS
from auvbench.runs.identity import DEFAULT_TASK
from auvbench.statistics import Crossed, crossed
from auvbench.statistics.intervals import FloatArray

UNKNOWN = Metric("unknown", "", "", "", better="higher", low=-math.inf)
"""metric of an unregistered column"""

LIMITED_BY_STEPS = ("steps", "duration_s", "time_to_goal_s")
"""Columns that the task's step limit bounds from above; the bound of a time is step limit / frequency"""

SUCCESS, TIMEOUT = OUTCOMES.index("success"), OUTCOMES.index("timeout")


def metric_of(column: str) -> Metric | None:
    """Return the metric of a column that describes the agent; None if it is not registered."""
    return next((m for m in registered() if m.name == column and m.kind in ("episode", "derived")), None)


def of_the_scenario() -> tuple[str, ...]:
    """Return the columns of the scenario, which are the same for every agent."""
    return ("frequency_hz", *columns("scenario"))


@dataclass(frozen=True, slots=True)
class Measure:
    """Measure of an agent: the mean over test episodes of one value per episode."""

    name: str
    """Name: success_rate, collision_rate, timeout_rate, mean_<column>, par1_steps, par2_time_s, ..."""
    column: str
    """column of episodes.csv that has the values; `outcome` for a rate"""
    higher_is_better: bool
    rate: bool
    penalty: float = 0.0
    """Value of a failed episode as a multiple of the step or time limit; 0: the episode keeps its measured value"""

    def values(self, agent: Agent) -> FloatArray:
        """Return the values (seeds, episodes) of an agent; NaN if the agent's episodes lack the column."""
        if self.rate:
            return np.asarray(
                agent.outcome == OUTCOMES.index(self.name.removesuffix("_rate")), dtype=np.float64
            )
        if self.column not in agent.metrics:
            return np.full(agent.outcome.shape, np.nan)
        measured = np.asarray(agent.metrics[self.column], dtype=np.float64)
        if not self.penalty:
            # A failed training has no policy and no measured values, so its episodes get the value of a failure.
            return np.where(agent.outcome == NO_POLICY, self.failure(agent), measured)
        failed = agent.outcome != SUCCESS
        limit = _limit(agent, self.column)
        if (
            failed.any() and not np.isfinite(limit).all()
        ):  # without a limit, failed episodes have no penalised value
            return np.full(agent.outcome.shape, np.nan)
        return np.where(failed, self.penalty * limit, measured)

    def failure(self, agent: Agent) -> float:
        """Return the value that replaces the value of a failed episode; NaN if the measured value is used."""
        if self.rate:
            return float(self.name != "success_rate")
        if self.penalty:
            return float(np.mean(self.penalty * _limit(agent, self.column)))
        metric = metric_of(self.column)
        bounds = agent.runs[0].config.get("task.bounds") if metric and metric.counts_failures else None
        return float(bounds) if isinstance(bounds, int | float) else math.nan

    def bounds(self, agents: Sequence[Agent]) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest possible mean of each agent, two arrays (n,)."""
        kind = metric_of(self.column) or UNKNOWN
        least, most = np.full(len(agents), kind.low), np.full(len(agents), kind.high)
        if self.penalty:
            limits = [np.max(self.penalty * _limit(agent, self.column)) for agent in agents]
            return least, np.nan_to_num(np.array(limits), nan=math.inf)
        if self.column in LIMITED_BY_STEPS:
            most[:] = max(agent.step_limit for agent in agents)
        if self.column in LIMITED_BY_STEPS[1:]:
            slowest = [a.metrics.get("frequency_hz", np.zeros(1)).min() for a in agents]
            most = np.divide(most, slowest, out=np.full(len(agents), math.inf), where=np.array(slowest) > 0)
        return least, most

    def table(self, agents: Sequence[Agent], *, paired: bool = True) -> Crossed:
        """Return the agents' means, with their variances and possible ranges."""
        data = [self.values(agent) for agent in agents]
        return crossed(data, rate=self.rate, paired=paired, bounds=self.bounds(agents))

    @property
    def sign(self) -> float:
        """Return 1 if higher is better, else -1."""
        return 1.0 if self.higher_is_better else -1.0

    @property
    def scale(self) -> float:
        """Return 100 for a rate, which tables show in percent, else 1."""
        return 100.0 if self.rate else 1.0


RATES = tuple(Measure(f"{name}_rate", "outcome", name == "success", True) for name in OUTCOMES)
PENALISED = tuple(
    Measure(f"par{penalty}_{name}", column, False, False, float(penalty))
    for name, column in (("steps", "steps"), ("time_s", "duration_s"))
    for penalty in (1, 2)
)
"""Penalised means: a failure counts as the limit (PAR-1) or twice the limit (PAR-2), like the penalised average
runtime (PAR-10) of algorithm selection (Hutter, Hoos & Leyton-Brown 2011, LION 5).
"""
RANKED_AS = {
    "mean_steps": "par1_steps",
    "mean_duration_s": "par1_time_s",
    "mean_time_to_goal_s": "par1_time_s",
}
"""For each mean, the penalised measure that replaces it in a ranking. Quick failures would improve a mean of steps or
durations, and a mean time to the goal ignores failures.
"""


def measures() -> dict[str, Measure]:
    """Return all measures by name."""
    means = (m for m in registered() if m.kind in ("episode", "derived"))
    return {m.name: m for m in (*RATES, *PENALISED)} | {
        m.measure: Measure(m.measure, m.name, m.better == "higher", False) for m in means
    }


def _limit(agent: Agent, column: str) -> FloatArray:
    """Return the limit of an episode's length in the unit of `column`: an array (seeds, episodes), or one number for all episodes."""
    limit = np.asarray(agent.step_limit)
    if column == "steps":
        return limit
    # Convert to seconds. A seed without a policy has no frequency, so it gets the lowest frequency of the other seeds.
    frequency = np.asarray(agent.metrics.get("frequency_hz", np.nan), dtype=np.float64)
    frequencies = frequency[np.isfinite(frequency)]
    return limit / np.where(
        np.isfinite(frequency), frequency, frequencies.min() if frequencies.size else np.nan
    )


def measure(name: str, option: str = "--rank-by") -> Measure:
    """Return a measure by name.

    Raises:
        ReportError: the name is unknown; the error suggests the closest one.
    """
    available = measures()
    if name not in available:
        raise ReportError(
            f"{option} {name!r} is not a measure; {closest(name, available)} (auvbench report --help explains each)"
        )
    return available[name]


def to_rank_by(name: str, option: str = "--rank-by") -> Measure:
    """Return the measure that ranks agents for `name`: its penalised measure in `RANKED_AS`, else the measure itself.

    Raises:
        ReportError: see `measure`.
    """
    return measure(RANKED_AS.get(name, name), option)


def in_unit(margin: float | None, name: str) -> float | None:
    """Return a margin from the command line in the measure's unit: percentage points of a rate become a fraction.

    >>> in_unit(2.0, "success_rate"), in_unit(30.0, "mean_steps")
    (0.02, 30.0)
    """
    return margin / 100 if margin is not None and to_rank_by(name).rate else margin


def all_measures(agents: Sequence[Agent]) -> list[Measure]:
    """Return the measures that at least one agent has.

    The list includes means of unregistered columns, by which agents cannot be ranked.
    """
    scenario, registered = of_the_scenario(), measures()
    measured = {c: None for agent in agents for c in agent.metrics if c not in scenario}
    means = [registered.get(f"mean_{c}", Measure(f"mean_{c}", c, True, False)) for c in measured]
    named = {str(agent.runs[0].config.get("task.name")) for agent in agents if agent.runs}
    ends = {end for name in named for end in TASKS.get(name, TASKS[DEFAULT_TASK]).outcomes}
    rates = [m for m in RATES if m.name.removesuffix("_rate") in ends] if ends else RATES
    return [*rates, *means, *(m for m in PENALISED if m.column in measured)]
