"""Columns of metrics: names, units and scales as every format prints them."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.analysis import limit

DAGGER = "†"


@dataclass(frozen=True, slots=True)
class Column:
    """One metric as it stands in a table."""

    metric: str
    """key of `Row.estimates`"""
    title: str
    unit: str = ""
    tex: str = ""
    """the title in LaTeX where it has a symbol"""
    scale: float = 1.0

    @property
    def heading(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


_USUAL = (
    Column("success_rate", "success", "%", scale=100.0),
    Column("collision_rate", "collision", "%", scale=100.0),
    Column("timeout_rate", "timeout", "%", scale=100.0),
    Column("par1_steps", "PAR-1 steps"),
    Column("par2_steps", "PAR-2 steps"),
    Column("par1_time_s", "PAR-1 time", "s"),
    Column("par2_time_s", "PAR-2 time", "s"),
    Column("mean_steps", "steps"),
    Column("mean_time_to_goal_s", "time to goal", "s"),
    Column("mean_final_distance_m", "final distance", "m"),
    Column("mean_deviation_mean_m", "deviation", "m", r"mean $d_\delta$"),
    Column("mean_deviation_std_m", "std of deviation", "m", r"std $d_\delta$"),
    Column("mean_command_norm_mean_N", "norm u", "N", r"mean $\|u\|$"),
    Column("mean_command_norm_sum_N", "sum of norm u", "N", r"mean $\sum\|u\|$"),
    Column("mean_energy_J", "energy", "kJ", scale=1e-3),
    Column("iqm_success", "IQM of success", "%", scale=100.0),
    Column("optimality_gap", "optimality gap", "%", scale=100.0),
    Column("success_over_conditions", "success over conditions", "%", scale=100.0),
    Column("next_training", "next training", "%", scale=100.0),
    Column("auc_steps", "AUC over steps", "%", scale=100.0),
    Column("auc_wall_time", "AUC over wall time", "%", scale=100.0),
    Column("auc_simulated_time", "AUC over simulated time", "%", scale=100.0),
    Column("action_ms", "computing time", "ms"),
    Column("action_p95_ms", "computing time, 95th percentile", "ms"),
    Column("training_cpu_s", "a training, cores", "s"),
    Column(limit.COLUMN, "time over best known"),
)
COLUMNS = {column.metric: column for column in _USUAL}
"""by metric"""


def column_of(metric: str) -> Column:
    """Return the column of a metric, named after its key where it has none of its own.

    >>> column_of("mean_path_length_m").heading, column_of("success_rate").heading
    ('path length (m)', 'success (%)')
    """
    if metric in COLUMNS:
        return COLUMNS[metric]
    stem, unit = metric.removeprefix("mean_"), ""
    for suffix, name in (("_per_s", "1/s"), ("_s", "s"), ("_m", "m"), ("_N", "N"), ("_J", "J")):
        if stem.endswith(suffix):
            stem, unit = stem.removesuffix(suffix), name
            break
    return Column(metric, stem.replace("_", " "), unit)
