"""What agents can be ranked by: the measures of an agent, and which direction is better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from auvbench.errors import ReportError, closest
from auvbench.reporting.model import Agent
from auvbench.reporting.statistics.intervals import FloatArray
from auvbench.tasks.record import OUTCOMES

HIGHER_IS_BETTER = {
    "steps": False,
    "duration_s": False,
    "time_to_goal_s": False,
    "return": True,
    "final_distance_m": False,
    "deviation_mean_m": False,
    "deviation_std_m": False,
    "command_norm_mean_N": False,
    "command_norm_sum_N": False,
    "energy_J": False,
    "path_length_m": False,
    "path_efficiency": True,
    "smoothness_per_s": False,
    "depth_margin_m": True,
}
"""Direction of each column of episodes.csv that says something of the agent."""

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

    @property
    def sign(self) -> float:
        """1 where higher is better, else -1."""
        return 1.0 if self.higher_is_better else -1.0


RATES = tuple(Measure(f"{name}_rate", "outcome", name == "success", True) for name in OUTCOMES)
MEASURES = {m.name: m for m in RATES} | {
    f"mean_{column}": Measure(f"mean_{column}", column, higher, False)
    for column, higher in HIGHER_IS_BETTER.items()
}


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
    means = [MEASURES.get(f"mean_{c}", Measure(f"mean_{c}", c, True, False)) for c in columns]
    return [*RATES, *means]
