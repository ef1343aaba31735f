"""The metrics of agents: one entry each, from which records, tables, page, LaTeX, docs and completion are made.

A new metric is one entry here (docs/adding-a-metric.md). Nothing heavy is imported: shell completion reads this file.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple


class Totals(NamedTuple):
    """What a task keeps of an episode; sums run over its steps."""

    episode: int
    environment: int
    outcome: str
    steps: int
    step_s: float
    """s of an agent step"""
    reward: float
    initial_distance: float
    """m"""
    distance: float
    """m, at the end"""
    deviation: float
    """sum of m"""
    deviation_squared: float
    """sum of m^2"""
    command_norm: float
    """sum of N"""
    energy: float
    """J"""
    path: float
    """m"""
    change: float
    """sum of norms of the change of the normalised action"""
    depth_margin: float
    """m, smallest"""
    waypoint: tuple[float, float, float]
    """m"""
    start_yaw: float
    """rad"""

    @property
    def mean_deviation(self) -> float:
        return self.deviation / max(self.steps, 1)


Kind = Literal["rate", "penalised", "derived", "key", "scenario", "episode", "agent"]
"""rate, penalised: of an agent, from outcomes and steps (`analysis.measures`)
derived: per episode, computed from other columns where a test is read
key, scenario, episode: a column of the records; what identifies a row, what every agent meets, what an agent did
agent: an optional column of a report (`analysis.optional_columns`)"""


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric."""

    name: str
    """of the column of episodes.csv, or of the measure"""
    kind: Kind
    unit: str
    """in files"""
    better: Literal["higher", "lower", ""]
    title: str
    definition: str
    value: Callable[[Totals], float | int | str] | None = None
    """the column of a record from the totals of an episode"""
    latex: str = ""
    """title in LaTeX where it has a symbol"""
    shown_unit: str | None = None
    """in tables, where it is another one"""
    scale: float = 1.0
    """from the unit in files to that in tables"""
    low: float = 0.0
    high: float = math.inf
    """the range of possible values: no interval leaves it"""

    @property
    def measure(self) -> str:
        """The name by which agents are compared: a column is compared by its mean."""
        return f"mean_{self.name}" if self.kind in ("episode", "derived", "scenario") else self.name

    @property
    def table_unit(self) -> str:
        return self.unit if self.shown_unit is None else self.shown_unit


def _share(
    name: str,
    title: str,
    definition: str,
    kind: Kind = "agent",
    better: Literal["higher", "lower"] = "higher",
) -> Metric:
    return Metric(name, kind, "1", better, title, definition, shown_unit="%", scale=100.0, high=1.0)


METRICS: tuple[Metric, ...] = (
    _share("success_rate", "success", "episodes that reach the waypoint", "rate"),
    _share("collision_rate", "collision", "episodes that leave the depth limits", "rate", "lower"),
    _share("timeout_rate", "timeout", "episodes that use up their steps", "rate", "lower"),
    Metric(
        "par1_steps", "penalised", "", "lower", "PAR-1 steps", "agent steps; a failure counts as the limit"
    ),
    Metric(
        "par2_steps",
        "penalised",
        "",
        "lower",
        "PAR-2 steps",
        "agent steps; a failure counts as twice the limit",
    ),
    Metric(
        "par1_time_s",
        "penalised",
        "s",
        "lower",
        "PAR-1 time",
        "simulated time; a failure counts as the limit",
    ),
    Metric(
        "par2_time_s",
        "penalised",
        "s",
        "lower",
        "PAR-2 time",
        "simulated time; a failure counts as twice the limit",
    ),
    Metric(
        "time_to_goal_s", "derived", "s", "lower", "time to goal", "simulated time of the successful episodes"
    ),
    Metric("episode", "key", "", "", "episode", "", lambda t: t.episode),
    Metric("environment", "key", "", "", "environment", "", lambda t: t.environment),
    Metric("outcome", "key", "", "", "outcome", "", lambda t: t.outcome),
    Metric("steps", "episode", "", "lower", "steps", "agent steps until the end", lambda t: t.steps, low=1.0),
    Metric(
        "duration_s",
        "episode",
        "s",
        "lower",
        "duration",
        "simulated time until the end",
        lambda t: t.steps * t.step_s,
    ),
    Metric(
        "return",
        "episode",
        "",
        "higher",
        "return",
        "sum of raw rewards; not comparable between reward functions",
        lambda t: t.reward,
        low=-math.inf,
    ),
    Metric(
        "initial_distance_m",
        "scenario",
        "m",
        "",
        "initial distance",
        "distance from start to waypoint",
        lambda t: t.initial_distance,
    ),
    Metric(
        "final_distance_m",
        "episode",
        "m",
        "lower",
        "final distance",
        "distance to the waypoint at the end",
        lambda t: t.distance,
    ),
    Metric(
        "deviation_mean_m",
        "episode",
        "m",
        "lower",
        "deviation",
        "mean distance to the line through start and waypoint",
        lambda t: t.mean_deviation,
        latex=r"mean $d_\delta$",
    ),
    Metric(
        "deviation_std_m",
        "episode",
        "m",
        "lower",
        "std of deviation",
        "population standard deviation of the distance to that line",
        lambda t: (
            max(t.deviation_squared / max(t.steps, 1) - t.mean_deviation * t.mean_deviation, 0.0) ** 0.5
        ),
        latex=r"std $d_\delta$",
    ),
    Metric(
        "command_norm_mean_N",
        "episode",
        "N",
        "lower",
        "norm u",
        "norm of the commanded forces after noise and limits, before lag: mean over the steps",
        lambda t: t.command_norm / max(t.steps, 1),
        latex=r"mean $\|u\|$",
    ),
    Metric(
        "command_norm_sum_N",
        "episode",
        "N",
        "lower",
        "sum of norm u",
        "sum of that norm over the steps",
        lambda t: t.command_norm,
        latex=r"mean $\sum\|u\|$",
    ),
    Metric(
        "energy_J",
        "episode",
        "J",
        "lower",
        "energy",
        "electrical energy of the commands by the thruster's table of power",
        lambda t: t.energy,
        shown_unit="kJ",
        scale=1e-3,
    ),
    Metric(
        "path_length_m",
        "episode",
        "m",
        "lower",
        "path length",
        "sum of the distances between the positions after each step",
        lambda t: t.path,
    ),
    Metric(
        "path_efficiency",
        "episode",
        "",
        "higher",
        "path efficiency",
        "(initial - final distance) / path length; at most 1: a straight path",
        lambda t: (t.initial_distance - t.distance) / t.path if t.path > 0.0 else 0.0,
        low=-1.0,
        high=1.0,
    ),
    Metric(
        "smoothness_per_s",
        "episode",
        "1/s",
        "lower",
        "smoothness",
        "mean norm of the change of the normalised action, per second",
        lambda t: t.change / (max(t.steps, 1) * t.step_s),
    ),
    Metric(
        "depth_margin_m",
        "episode",
        "m",
        "higher",
        "depth margin",
        "smallest distance to a depth limit; negative after a collision",
        lambda t: t.depth_margin,
        low=-math.inf,
    ),
    Metric("waypoint_x_m", "scenario", "m", "", "waypoint x", "", lambda t: t.waypoint[0]),
    Metric("waypoint_y_m", "scenario", "m", "", "waypoint y", "", lambda t: t.waypoint[1]),
    Metric("waypoint_z_m", "scenario", "m", "", "waypoint z", "", lambda t: t.waypoint[2]),
    Metric("start_yaw_rad", "scenario", "rad", "", "start yaw", "", lambda t: t.start_yaw),
    _share("iqm_success", "IQM of success", "interquartile mean of success over seeds and conditions"),
    _share(
        "optimality_gap",
        "optimality gap",
        "mean shortfall of success below 100 % over seeds and conditions",
        better="lower",
    ),
    Metric(
        "time_over_best_known",
        "agent",
        "",
        "lower",
        "time over best known",
        "time to goal over the best known time, geometric mean over successes; at least 1",
    ),
    Metric(
        "action_ms",
        "agent",
        "ms",
        "lower",
        "computing time",
        "processor time of one action: median, mean over runs",
    ),
    Metric(
        "action_p95_ms",
        "agent",
        "ms",
        "lower",
        "computing time, 95th percentile",
        "processor time of one action: 95th percentile",
    ),
    Metric(
        "training_cpu_s",
        "agent",
        "s",
        "lower",
        "a training, cores",
        "processor time of a training, mean over runs",
    ),
)


def definitions() -> str:
    """Return the Markdown table of definitions in docs/protocol.md."""
    lines = ["| name | unit | better | definition |", "|---|---|---|---|"]
    lines += [
        f"| `{metric.name}` | {metric.unit.replace('1/s', 's⁻¹')} | {metric.better} | {metric.definition} |"
        for metric in METRICS
        if metric.definition
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(definitions())
