"""The columns of the table: the thesis's, and what it would have needed; names, units and order of weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from auvbench.analysis import limit
from auvbench.analysis.model import Ranking, Row
from auvbench.analysis.rounding import NOTHING, rounded
from auvbench.statistics.estimate import Estimate


@dataclass(frozen=True, slots=True)
class Column:
    """One metric as it stands in a table."""

    metric: str
    """key of `Row.estimates`"""
    title: str
    unit: str
    tex: str
    """the title in LaTeX, with the thesis's symbol where it has one"""
    scale: float = 1.0

    @property
    def heading(self) -> str:
        return f"{self.title} ({self.unit})" if self.unit else self.title


SUCCESS = Column("success_rate", "success", "%", r"success (\%)", 100.0)
PAR1 = Column("par1_steps", "PAR-1 steps", "", "PAR-1 steps")
STEPS = Column("mean_steps", "steps", "", "steps")
OUTCOMES = (
    SUCCESS,
    Column("collision_rate", "collision", "%", r"collision (\%)", 100.0),
    Column("timeout_rate", "timeout", "%", r"timeout (\%)", 100.0),
    PAR1,
    STEPS,
    Column("mean_time_to_goal_s", "time to goal", "s", "time to goal (s)"),
    Column("mean_final_distance_m", "final distance", "m", "final distance (m)"),
)
"""where episodes end"""
MOTION = (
    Column("mean_deviation_mean_m", "deviation", "m", r"mean $d_\delta$ (m)"),
    Column("mean_deviation_std_m", "std of deviation", "m", r"std $d_\delta$ (m)"),
    Column("mean_command_norm_mean_N", "norm u", "N", r"mean $\|u\|$ (N)"),
    Column("mean_command_norm_sum_N", "sum of norm u", "N", r"mean $\sum\|u\|$ (N)"),
    Column("mean_energy_J", "energy", "kJ", "energy (kJ)", 1e-3),
)
"""how they get there, and at what cost"""
COLUMNS = OUTCOMES + MOTION

BY_WEIGHT = (0, 3, 1, 2, 7, 4, 5, 11, 8, 6, 9, 10)
"""which columns a narrow terminal keeps first, as indices into `COLUMNS`"""

FURTHER = {
    "iqm_success": Column("iqm_success", "IQM of success", "%", r"IQM of success (\%)", 100.0),
    "optimality_gap": Column("optimality_gap", "optimality gap", "%", r"optimality gap (\%)", 100.0),
    "success_over_conditions": Column(
        "success_over_conditions", "success over conditions", "%", r"success over conditions (\%)", 100.0
    ),
    "next_training": Column("next_training", "next training", "%", r"next training (\%)", 100.0),
    "auc_steps": Column("auc_steps", "AUC over steps", "%", r"AUC over steps (\%)", 100.0),
    "auc_wall_time": Column("auc_wall_time", "AUC over wall time", "%", r"AUC over wall time (\%)", 100.0),
    "auc_simulated_time": Column(
        "auc_simulated_time", "AUC over simulated time", "%", r"AUC over simulated time (\%)", 100.0
    ),
    "action_ms": Column("action_ms", "action, median", "ms", "action, median (ms)"),
    "action_p95_ms": Column("action_p95_ms", "action, 95th percentile", "ms", "action, 95th percentile (ms)"),
    "training_cpu_s": Column("training_cpu_s", "a training, cores", "s", "a training, cores (s)"),
    limit.COLUMN: Column(limit.COLUMN, "time over optimum", "", "time over optimum"),
}
"""columns on request, by their name in --columns"""

DAGGER = "†"

MOST_LETTERS = 8
"""of an agent's group; beyond, a column of letters says nothing to a reader that the rank intervals do not"""


def present(columns: Sequence[Column], ranking: Ranking) -> tuple[Column, ...]:
    """The columns that at least one row has a number for; what the table is ranked by is always among them."""
    known = {metric for row in ranking.rows for metric in row.estimates}
    return tuple(c for c in columns if c.metric in known)


def extra(ranking: Ranking) -> tuple[Column, ...]:
    """Columns for what the table is ranked by, where it is none of the usual ones."""
    usual = {c.metric for c in COLUMNS}
    wanted = dict.fromkeys((ranking.rank_by, ranking.then))
    ranked_by = tuple(
        Column(m, m.replace("_", " "), "", m.replace("_", r"\_")) for m in wanted if m and m not in usual
    )
    return ranked_by + tuple(FURTHER[name] for name in ranking.columns if name in FURTHER)


def cell(row: Row, column: Column) -> tuple[str, str]:
    """Value and interval of a row as text: ('98.0', '[96.4, 98.9]'); an absent number is a dash, never zero."""
    estimate: Estimate | None = row.estimates.get(column.metric)
    if estimate is None:
        return NOTHING, ""
    value, low, high = rounded(estimate, column.scale)
    return value, f"[{low}, {high}]" if low else ""


def rank(row: Row) -> str:
    """'1', or '2 (1–3)' where resampling leaves the rank open."""
    low, high = row.rank_interval
    return str(row.rank) if low == high == row.rank else f"{row.rank} ({low}–{high})"


def letters(ranking: Ranking) -> bool:
    """Whether the column of group letters can be read. The CSV has them always."""
    return all(len(row.group) <= MOST_LETTERS for row in ranking.rows)


def lead(ranking: Ranking) -> tuple[str, ...]:
    """Headings of the columns before the first metric."""
    return ("rank", "group", "agent", "seeds") if letters(ranking) else ("rank", "agent", "seeds")


def lead_cells(row: Row, lead: Sequence[str], marked: frozenset[str]) -> list[str]:
    """The row's texts under these headings; a label in `marked` gets a dagger."""
    label = row.label + (f" {DAGGER}" if row.label in marked else "")
    texts = {
        "rank": rank(row),
        "group": row.group if row.compared else NOTHING,
        "agent": label,
        "seeds": NOTHING if not row.trained else row.runs_in_words if row.pooled else str(len(row.seeds)),
    }
    return [texts[heading] for heading in lead]


def policies(ranking: Ranking) -> frozenset[str]:
    """Labels to mark: rows of one training seed, which describe a policy and are not compared."""
    return frozenset(row.label for row in ranking.rows if not row.compared)
