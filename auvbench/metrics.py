"""Define the metrics that describe agents and episodes, for records, tables, page, LaTeX, docs and shell completion.

To add a metric, add one entry (docs/adding-a-metric.md): to METRICS for all tasks, or to a task's spec for this task only.
This module imports nothing heavy, because shell completion imports it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from auvbench.config.navigation import ESTIMATORS, FILTERS
from auvbench.registry import TASKS, WORLDS

if TYPE_CHECKING:
    from auvbench.config.tasks import TaskSpec


class Totals(NamedTuple):
    """Totals of one episode; each sum is over the episode's steps."""

    episode: int
    environment: int
    outcome: str
    steps: int
    step_s: float
    """duration of an agent step, s"""
    reward: float
    initial_distance: float
    """distance to the reference at the start, m"""
    distance: float
    """distance to the reference at the end, m"""
    deviation: float
    """sum of the task's deviations, m (waypoint task: distance to the line from start to waypoint)"""
    deviation_squared: float
    """sum of squared deviations, m^2"""
    command_norm: float
    """sum of command norms, N"""
    energy: float
    """energy, J"""
    path: float
    """length of the path, m"""
    change: float
    """sum of the norms of the changes of the normalised action"""
    depth_margin: float
    """smallest distance to a depth limit, m"""
    start_yaw: float
    """yaw at the start, rad"""
    own: Mapping[str, Any]
    """values of the columns that the task, its world or its navigation computes, by the name of the column"""

    @property
    def mean_deviation(self) -> float:
        return self.deviation / max(self.steps, 1)


Kind = Literal["rate", "penalised", "derived", "key", "scenario", "episode", "agent"]
"""kinds of metrics:

* rate, penalised: one number for each agent, from outcomes and steps (`analysis.measures`).
* derived: one number for each episode, computed from other columns when a test's records are read.
* key: a column of the records that is not a measure of agents, such as the episode's number.
* scenario: a column of the records that describes the scenario, so its values are the same for every agent.
* episode: a column of the records that describes what the agent did.
* agent: an optional column of a report (`analysis.optional_columns`).
"""


OPEN = "open"
"""name of the world without solids; records of episodes in this world lack the columns about solids"""
TRUTH = "truth"
"""value of `navigation.name` if agents observe the true state; the records then lack the columns about estimates"""
LAST = "yaw_error_rms_rad"
"""metric of METRICS that a task's own metrics follow, by default, in files and tables"""

Failed = Literal["", "high", "bounds", "time"]
"""Value of a metric in a failed episode: "" means the value that the task computes, "high" the metric's field `high`, "bounds" the
value of `task.bounds` (m), and "time" the time limit (s)
"""


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric."""

    name: str
    """name of the column in episodes.csv; for a metric that is not a column, name of the measure"""
    unit: str
    """unit in files"""
    title: str
    definition: str
    value: Callable[[Totals], float | int | str] | None = None
    """function that returns a record's value from the totals of an episode"""
    kind: Kind = "episode"
    better: Literal["higher", "lower", ""] = "lower"
    latex: str = ""
    """title in LaTeX, only for a metric whose title is a mathematical symbol there"""
    shown_unit: str | None = None
    """unit in tables, if it differs from the unit in files"""
    scale: float = 1.0
    """factor from the unit in files to the unit in tables"""
    low: float = 0.0
    high: float = math.inf
    """largest possible value; intervals stay within `low` and `high`"""
    tasks: tuple[str, ...] = ()
    """tasks that have the metric, filled in by `registered`; empty: all tasks"""
    after: str = LAST
    """for a task's own metric: metric of METRICS that this metric follows in files and tables"""
    worlds: tuple[str, ...] = ()
    """worlds that have the metric; empty: all, also open water"""
    navigation: tuple[str, ...] = ()
    """values of `navigation.name` that have the metric; empty: all, also the truth"""
    filtered: bool = False
    """whether only runs with a filter of commands have the metric"""
    counts_failures: bool = False
    """whether a failed episode gets the worst value of the metric instead of the measured value"""
    failed: Failed = ""

    def is_of(self, task: str, world: str = OPEN, navigation: str = TRUTH, filtered: bool = False) -> bool:
        """Return whether episodes have the metric, given the task, `world.name`, `navigation.name` and whether commands are filtered."""
        in_place = (not self.tasks or task in self.tasks) and (not self.worlds or world in self.worlds)
        return (
            in_place and (not self.navigation or navigation in self.navigation) and filtered >= self.filtered
        )

    @property
    def conditional(self) -> bool:
        """Return whether some conditions of a test may lack the metric, while other conditions have it."""
        return self.filtered or bool(self.navigation)

    @property
    def measure(self) -> str:
        """Return the name of the measure that compares agents: for a column, the mean of its values."""
        return f"mean_{self.name}" if self.kind in ("episode", "derived", "scenario") else self.name

    @property
    def table_unit(self) -> str:
        return self.unit if self.shown_unit is None else self.shown_unit


def _rate(
    name: str,
    title: str,
    definition: str,
    better: Literal["higher", "lower"] = "lower",
) -> Metric:
    return Metric(
        name,
        "1",
        title,
        definition,
        kind="rate",
        better=better,
        shown_unit="%",
        scale=100.0,
        high=1.0,
    )


def column(
    name: str,
    unit: str,
    title: str,
    definition: str,
    better: Literal["higher", "lower", ""] = "lower",
    *,
    low: float = 0.0,
    high: float = math.inf,
    worlds: tuple[str, ...] = (),
    navigation: tuple[str, ...] = (),
    filtered: bool = False,
    counts_failures: bool = False,
    failed: Failed = "",
    after: str = LAST,
) -> Metric:
    """Return a metric that is a column of the records; the task computes its value as `own_metrics()[name]`.

    Args:
        name: name of the column, with its unit: `pole_distance_m`.
        unit: unit in files.
        title: title in tables.
        definition: definition in tables and docs.
        better: whether higher or lower values are better; empty for a column that describes the scenario.
        low: smallest possible value.
        high: largest possible value.
        worlds: worlds that have the column; empty: all.
        navigation: values of `navigation.name` that have the column; empty: all.
        filtered: whether only runs with a filter of commands have the column.
        counts_failures: whether a failed episode gets the worst value of the metric instead of the measured value.
        failed: value of a failed episode, if the task does not compute it (`Failed`).
        after: metric that the column follows in files and tables.
    """
    return Metric(
        name,
        unit,
        title,
        definition,
        lambda t: t.own[name],
        kind="episode" if better else "scenario",
        better=better,
        low=low,
        high=high,
        after=after,
        worlds=worlds,
        navigation=navigation,
        filtered=filtered,
        counts_failures=counts_failures or bool(failed),
        failed=failed,
    )


POINTS = tuple(f"{point}_{axis}_m" for point in ("start", "goal") for axis in "xyz")
SHARED = ("position_error_rms_m", "yaw_error_rms_rad", *POINTS)
"""columns that several but not all tasks have (`TaskSpec.shared`); `TrackingTask.errors` computes their values"""
SOLID = tuple(name for name in WORLDS.own if name != OPEN)
"""worlds with solids"""


METRICS: list[Metric] = [
    _rate(
        "success_rate",
        "success",
        "share of successful episodes; docs/task.md defines success",
        "higher",
    ),
    _rate(
        "collision_rate",
        "collision",
        "share of episodes that leave the depth limits or hit an object",
    ),
    _rate("timeout_rate", "timeout", "share of episodes that reach the time limit without success"),
    _rate("out_of_bounds_rate", "out of bounds", "share of episodes that get too far from the reference"),
    *(
        Metric(
            f"par{k}_{name}",
            unit,
            f"PAR-{k} {title}",
            f"{what}; a failure counts as {limit}",
            kind="penalised",
        )
        for name, unit, title, what in (
            ("steps", "", "steps", "agent steps"),
            ("time_s", "s", "time", "simulated time"),
        )
        for k, limit in ((1, "the limit"), (2, "twice the limit"))
    ),
    Metric(
        "time_to_goal_s", "s", "time to goal", "simulated time of the successful episodes", kind="derived"
    ),
    Metric("episode", "", "episode", "", lambda t: t.episode, kind="key", better=""),
    Metric("environment", "", "environment", "", lambda t: t.environment, kind="key", better=""),
    Metric("outcome", "", "outcome", "", lambda t: t.outcome, kind="key", better=""),
    Metric("steps", "", "steps", "agent steps until the end", lambda t: t.steps, low=1.0),
    Metric("duration_s", "s", "duration", "simulated time until the end", lambda t: t.steps * t.step_s),
    Metric(
        "return",
        "",
        "return",
        "sum of raw rewards; not comparable between reward functions",
        lambda t: t.reward,
        better="higher",
        low=-math.inf,
    ),
    Metric(
        "initial_distance_m",
        "m",
        "initial distance",
        "distance from the start to the reference, in the waypoint task the waypoint",
        lambda t: t.initial_distance,
        kind="scenario",
        better="",
    ),
    Metric(
        "final_distance_m",
        "m",
        "final distance",
        "distance to the reference at the end",
        lambda t: t.distance,
    ),
    Metric(
        "command_norm_mean_N",
        "N",
        "norm u",
        "norm of the commanded forces after noise and limits, before lag: mean over the steps",
        lambda t: t.command_norm / max(t.steps, 1),
        latex=r"mean $\|u\|$",
    ),
    Metric(
        "command_norm_sum_N",
        "N",
        "sum of norm u",
        "sum of that norm over the steps",
        lambda t: t.command_norm,
        latex=r"mean $\sum\|u\|$",
    ),
    Metric(
        "energy_J",
        "J",
        "energy",
        "electrical energy of the commands, from the thruster's power table",
        lambda t: t.energy,
        shown_unit="kJ",
        scale=1e-3,
    ),
    Metric(
        "path_length_m",
        "m",
        "path length",
        "sum of the distances between the positions after each step",
        lambda t: t.path,
    ),
    Metric(
        "smoothness_per_s",
        "1/s",
        "smoothness",
        "mean norm of the change of the normalised action, per second",
        lambda t: t.change / (max(t.steps, 1) * t.step_s),
    ),
    Metric(
        "depth_margin_m",
        "m",
        "depth margin",
        "smallest distance to a depth limit; negative after a collision",
        lambda t: t.depth_margin,
        better="higher",
        low=-math.inf,
    ),
    Metric("start_yaw_rad", "rad", "start yaw", "", lambda t: t.start_yaw, kind="scenario", better=""),
    *(column(f"start_{axis}_m", "m", f"start {axis}", "", "") for axis in "xyz"),
    *(column(f"goal_{axis}_m", "m", f"goal {axis}", "", "") for axis in "xyz"),
    column(
        "position_error_rms_m",
        "m",
        "RMS position error",
        "root mean square of the distance to the reference, in station keeping after the settling time; a failed episode "
        "counts as the bounds",
        failed="bounds",
    ),
    column(
        "yaw_error_rms_rad",
        "rad",
        "RMS yaw error",
        "root mean square of the yaw error over the same steps; a failed episode counts as pi",
        high=math.pi,
        failed="high",
    ),
    *(
        Metric(name, "", name, text, lambda t, name=name: t.own[name], kind="key", better="", worlds=SOLID)  # type: ignore[misc]
        for name, text in (
            ("world", "kind of the world and a digest of its solids"),
            ("hit", "kind of the solid that the vehicle hit; empty: none"),
        )
    ),
    column(
        "clearance_min_m",
        "m",
        "smallest clearance",
        "smallest distance of the vehicle's hull from a solid; at most 0 after a contact",
        "higher",
        low=-math.inf,
        worlds=SOLID,
    ),
    column(
        "near_time_s",
        "s",
        "time near solids",
        "time with a clearance below world.near",
        worlds=SOLID,
    ),
    column(
        "way_clearance_m",
        "m",
        "clearance of the way",
        "mean clearance of the shortest way through the field",
        "",
        worlds=("field",),
    ),
    column(
        "way_ratio",
        "",
        "length of the way",
        "length of the shortest way through the field over the straight distance, seen from above",
        "",
        worlds=("field",),
    ),
    column(
        "navigation_error_rms_m",
        "m",
        "RMS navigation error",
        "root mean square of the distance between estimated and true position",
        navigation=ESTIMATORS,
    ),
    column(
        "navigation_drift",
        "1",
        "drift",
        "navigation error at the end divided by the path length",
        navigation=ESTIMATORS,
    ),
    column(
        "unlocked_share",
        "1",
        "without lock",
        "share of the time without bottom lock; 1 without a DVL",
        high=1.0,
        navigation=ESTIMATORS,
    ),
    column(
        "diverged",
        "1",
        "diverged",
        "1 if the position error exceeded 1 km or was not finite; the estimate is then frozen",
        high=1.0,
        navigation=ESTIMATORS,
    ),
    column(
        "nees",
        "",
        "NEES",
        "normalised estimation error squared of the position: mean over the steps; 3 for a consistent filter",
        navigation=FILTERS,
    ),
    column(
        "intervention_share",
        "1",
        "interventions",
        "share of the steps in which the filter changed the agent's command",
        high=1.0,
        filtered=True,
    ),
    column(
        "command_change_mean",
        "",
        "change by the filter",
        "norm of the change of the normalised command by the filter, mean over all steps",
        filtered=True,
    ),
    column(
        "infeasible_steps",
        "",
        "infeasible steps",
        "steps in which no command within the thrusters' limits met all constraints of the filter",
        filtered=True,
    ),
    Metric(
        "time_over_best_known",
        "",
        "time over best known",
        "time to goal over the best known time, geometric mean over successes; at least 1",
        kind="agent",
    ),
    Metric(
        "action_ms",
        "ms",
        "computing time",
        "processor time of one action: median, mean over runs",
        kind="agent",
    ),
    Metric(
        "training_cpu_s",
        "s",
        "a training, cores",
        "processor time of a training, mean over runs",
        kind="agent",
    ),
]
"""metrics of all tasks, or of several tasks"""


def of_failures(names: Collection[str], limits: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that replace the measured values of a failed episode, by column; omit columns without a known value.

    Args:
        names: columns.
        limits: known limits of the task: "bounds" is `task.bounds` in m, "time" is the time limit in s.
    """
    limit_of = {**limits, "": None}
    values = {
        metric.name: metric.high if metric.failed == "high" else limit_of.get(metric.failed)
        for metric in registered()
        if metric.name in names
    }
    return {name: value for name, value in values.items() if value is not None}


def _of_several(metric: Metric, specs: Sequence[TaskSpec]) -> Metric:
    """Return a metric of METRICS; if only some tasks have the metric, set its field `tasks`."""
    if metric.name in SHARED:
        return replace(metric, tasks=tuple(spec.name for spec in specs if metric.name in spec.shared))
    if metric.name == "out_of_bounds_rate":
        return replace(metric, tasks=tuple(spec.name for spec in specs if "out_of_bounds" in spec.outcomes))
    return metric


@cache
def registered() -> tuple[Metric, ...]:
    """Return METRICS and the metrics of each task, in the order of files and tables."""
    specs = tuple(TASKS.values())
    own: dict[str, list[Metric]] = {}
    for spec in specs:
        for metric in spec.metrics:
            own.setdefault(metric.after, []).append(replace(metric, tasks=(spec.name,)))
    return tuple(
        placed for metric in METRICS for placed in (_of_several(metric, specs), *own.get(metric.name, ()))
    )


def definitions() -> str:
    """Return the Markdown table of definitions in docs/protocol.md."""
    lines = ["| name | unit | better | definition |", "|---|---|---|---|"]
    lines += [
        f"| `{metric.name}` | {metric.unit.replace('1/s', 's⁻¹')} | {metric.better} | {metric.definition} |"
        for metric in registered()
        if metric.definition
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(definitions())
