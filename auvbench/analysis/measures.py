"""What agents can be ranked by: the measures of an agent, which direction is better, and what is possible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from auvbench.analysis.model import Agent
from auvbench.errors import ReportError, closest
from auvbench.statistics import Crossed, crossed
from auvbench.statistics.intervals import FloatArray
from auvbench.tasks.record import OUTCOMES


class Kind(NamedTuple):
    """What is known of a column of episodes.csv."""

    higher_is_better: bool
    least: float
    most: float
    """the range of possible values: no interval leaves it"""


COLUMNS = {
    "steps": Kind(False, 1, math.inf),
    "duration_s": Kind(False, 0, math.inf),
    "time_to_goal_s": Kind(False, 0, math.inf),
    "return": Kind(True, -math.inf, math.inf),
    "final_distance_m": Kind(False, 0, math.inf),
    "deviation_mean_m": Kind(False, 0, math.inf),
    "deviation_std_m": Kind(False, 0, math.inf),
    "command_norm_mean_N": Kind(False, 0, math.inf),
    "command_norm_sum_N": Kind(False, 0, math.inf),
    "energy_J": Kind(False, 0, math.inf),
    "path_length_m": Kind(False, 0, math.inf),
    "path_efficiency": Kind(True, -1, 1),  # no path is shorter than the distance it gains or loses
    "smoothness_per_s": Kind(False, 0, math.inf),
    "depth_margin_m": Kind(True, -math.inf, math.inf),
}
"""The columns of episodes.csv that say something of the agent."""
UNKNOWN = Kind(True, -math.inf, math.inf)
"""of a column that auvbench does not know"""

LIMITED_BY_STEPS = ("steps", "duration_s", "time_to_goal_s")
"""These have a most that the task sets: its step limit, the times by the frequency."""

TIMEOUT = OUTCOMES.index("timeout")

OF_THE_SCENARIO = (
    "frequency_hz",
    "initial_distance_m",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)
"""Columns that say something of the scenario, the same for every agent: nothing to rank by."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A number per agent: the mean of a value per episode."""

    name: str
    """success_rate, collision_rate, timeout_rate, or mean_<column>"""
    column: str
    """outcome or a column of episodes.csv"""
    higher_is_better: bool
    rate: bool

    def values(self, agent: Agent) -> FloatArray:
        """(seeds, episodes) of the agent; NaN throughout where it has no such column."""
        if self.rate:
            return np.asarray(
                agent.outcome == OUTCOMES.index(self.name.removesuffix("_rate")), dtype=np.float64
            )
        if self.column not in agent.metrics:
            return np.full(agent.outcome.shape, np.nan)
        return np.asarray(agent.metrics[self.column], dtype=np.float64)

    def bounds(self, agents: Sequence[Agent]) -> tuple[FloatArray, FloatArray]:
        """Least and most (n,) that the mean of each agent can be, whatever its seeds and scenarios."""
        kind = COLUMNS.get(self.column, UNKNOWN)
        least, most = np.full(len(agents), kind.least), np.full(len(agents), kind.most)
        if self.column in LIMITED_BY_STEPS:
            most[:] = _step_limit(agents)
        if self.column in LIMITED_BY_STEPS[1:]:
            slowest = [a.metrics.get("frequency_hz", np.zeros(1)).min() for a in agents]
            most = np.divide(most, slowest, out=np.full(len(agents), math.inf), where=np.array(slowest) > 0)
        return least, most

    def table(self, agents: Sequence[Agent], *, paired: bool = True) -> Crossed:
        """The agents' means and their variances, with the range of what is possible."""
        data = [self.values(agent) for agent in agents]
        return crossed(data, rate=self.rate, paired=paired, bounds=self.bounds(agents))

    @property
    def sign(self) -> float:
        """1 where higher is better, else -1."""
        return 1.0 if self.higher_is_better else -1.0


RATES = tuple(Measure(f"{name}_rate", "outcome", name == "success", True) for name in OUTCOMES)
MEASURES = {m.name: m for m in RATES} | {
    f"mean_{column}": Measure(f"mean_{column}", column, kind.higher_is_better, False)
    for column, kind in COLUMNS.items()
}


def _step_limit(agents: Sequence[Agent]) -> float:
    """Steps of the episodes that timed out, infinite where none did.

    Not that of the runs' configuration: a protocol may set another one than training had.
    """
    timed_out = [a.metrics["steps"][a.outcome == TIMEOUT] for a in agents if "steps" in a.metrics]
    return max((float(steps.max()) for steps in timed_out if steps.size), default=math.inf)


def measure(name: str, option: str = "--rank-by") -> Measure:
    """The measure of that name.

    Raises:
        ReportError: there is none; names the closest.
    """
    if name not in MEASURES:
        raise ReportError(f"{option} {name!r} is not something to rank by; {closest(name, MEASURES)}")
    return MEASURES[name]


def all_measures(agents: Sequence[Agent]) -> list[Measure]:
    """The measures that at least one agent has, those of columns unknown to auvbench included (never ranked by)."""
    columns = {c: None for agent in agents for c in agent.metrics if c not in OF_THE_SCENARIO}
    means = [
        MEASURES.get(f"mean_{c}", Measure(f"mean_{c}", c, UNKNOWN.higher_is_better, False)) for c in columns
    ]
    return [*RATES, *means]
