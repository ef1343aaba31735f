"""The ranked table as the page shows it: columns, cells, small interval plots, comparisons."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from auvbench.reporting.model import Comparison, Estimate, Ranking, Row
from auvbench.reporting.page import numbers
from auvbench.reporting.page.links import Links

PLOT_WIDTH = 132
"""px of an interval plot; its ends keep `PLOT_MARGIN` for the dot"""
PLOT_MARGIN = 6


@dataclass(frozen=True, slots=True)
class Column:
    """One metric of the table."""

    metric: str
    """name in `Row.estimates`"""
    title: str
    unit: str
    definition: str
    factor: float = 1.0
    """from the metric's unit to the printed one"""
    rate: bool = False


COLUMNS = (
    Column("success_rate", "Success", "%", "episodes that reach the waypoint", 100.0, True),
    Column("mean_steps", "Steps", "", "mean number of agent steps of an episode"),
    Column("collision_rate", "Collision", "%", "episodes that leave the depth limits", 100.0, True),
    Column("timeout_rate", "Timeout", "%", "episodes that use up their steps", 100.0, True),
    Column(
        "mean_deviation_mean_m",
        "Deviation",
        "m",
        "mean perpendicular distance from the straight line between start and waypoint (the thesis's d_delta)",
    ),
    Column(
        "mean_command_norm_mean_N",
        "Command",
        "N",
        "mean norm of the thruster commands (the thesis's norm of u)",
    ),
    Column("mean_energy_J", "Energy", "kJ", "electrical energy of an episode by the thruster's table", 1e-3),
    Column("mean_path_efficiency", "Efficiency", "", "straight line divided by the path travelled"),
)
"""The columns of the main table, in order."""

FURTHER = (
    Column("mean_duration_s", "Duration", "s", "simulated time of an episode"),
    Column("mean_return", "Return", "", "sum of the rewards of an episode"),
    Column("mean_initial_distance_m", "Initial distance", "m", "from the start to the waypoint"),
    Column("mean_final_distance_m", "Final distance", "m", "to the waypoint when the episode ends"),
    Column(
        "mean_deviation_std_m", "Deviation, std", "m", "standard deviation of the deviation over the steps"
    ),
    Column("mean_command_norm_sum_N", "Command, sum", "kN", "sum over an episode of the norm of the commands", 1e-3),
    Column("mean_path_length_m", "Path length", "m", "length of the path travelled"),
    Column("mean_smoothness_per_s", "Command change", "1/s", "mean change of the commands per second"),
    Column("mean_depth_margin_m", "Depth margin", "m", "smallest distance to the depth limits"),
)
"""The columns of the second table; metrics that are in neither list follow under their own names."""


@dataclass(frozen=True, slots=True)
class Plot:
    """An interval plot, in px from the left."""

    low: float
    high: float
    value: float


@dataclass(frozen=True, slots=True)
class Axis:
    """The scale that the interval plots of a column share."""

    low: float
    high: float
    unit: str

    @property
    def ends(self) -> tuple[str, str]:
        places = 0 if self.high - self.low >= 2 else 2
        return (
            numbers.fixed(self.low, places),
            numbers.fixed(self.high, places) + ("\u202f" + self.unit if self.unit else ""),
        )

    def plot(self, estimate: Estimate, factor: float) -> Plot | None:
        numbers_ = [estimate.low * factor, estimate.high * factor, estimate.value * factor]
        if not all(map(math.isfinite, numbers_)):
            return None
        span = (self.high - self.low) or 1.0
        width = PLOT_WIDTH - 2 * PLOT_MARGIN
        low, high, value = (
            round(PLOT_MARGIN + width * min(1.0, max(0.0, (number - self.low) / span)), 1)
            for number in numbers_
        )
        return Plot(low, high, value)


@dataclass(frozen=True, slots=True)
class Cell:
    """One number of the table."""

    text: str
    interval: str
    sort: float | None
    href: str
    plot: Plot | None = None


@dataclass(frozen=True, slots=True)
class Line:
    """One agent's row."""

    index: int
    """index of the agent among those the page was given; -1 where there is none"""
    label: str
    colour: str
    rank: int
    rank_interval: str
    rank_sort: float
    group: str
    best: str
    best_sort: float | None
    seeds: int
    one_seed: bool
    href: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """The ranked table: one line per agent, one cell per column."""

    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    axis: Axis | None
    """of the first column, which is drawn"""
    one_seed: bool
    """some row's interval covers test episodes only"""


@dataclass(frozen=True, slots=True)
class Pair:
    """One comparison, printed."""

    first: str
    second: str
    metric: str
    difference: str
    interval: str
    difference_sort: float | None
    p_adjusted: str
    p_sort: float | None
    improvement: str
    improvement_interval: str
    improvement_sort: float | None
    resolved: bool


def main_table(ranking: Ranking, colours: Mapping[str, str], links: Links) -> Table:
    """The metric ranked by first, then the usual columns that the ranking holds."""
    known = {column.metric: column for column in (*COLUMNS, *FURTHER)}
    held = _held(ranking)
    first = known.get(ranking.rank_by) or _unknown(ranking.rank_by)
    columns = [first] if first.metric in held else []
    columns += [column for column in COLUMNS if column.metric in held and column is not first]
    return _table(ranking, tuple(columns), colours, links)


def further_table(ranking: Ranking, shown: Table, colours: Mapping[str, str], links: Links) -> Table | None:
    """Every metric that the main table leaves out."""
    known = {column.metric: column for column in (*COLUMNS, *FURTHER)}
    there = {column.metric for column in shown.columns}
    rest = [metric for metric in _held(ranking) if metric not in there]
    order = {column.metric: place for place, column in enumerate(FURTHER)}
    rest.sort(key=lambda metric: (order.get(metric, len(order)), metric))
    if not rest:
        return None
    return _table(ranking, tuple(known.get(m) or _unknown(m) for m in rest), colours, links, draw=False)


def pairs(comparisons: Iterable[Comparison], *, alpha: float = 0.05) -> list[Pair]:
    """The comparisons; differences of rates in percentage points; resolved where the adjusted p is below alpha."""
    known = {column.metric: column for column in (*COLUMNS, *FURTHER)}
    found = []
    for comparison in comparisons:
        column = known.get(comparison.metric) or _unknown(comparison.metric)
        unit = "points" if column.rate else column.unit
        text = numbers.value(comparison.difference, column.factor)
        improvement = comparison.probability_of_improvement
        found.append(
            Pair(
                first=comparison.first,
                second=comparison.second,
                metric=f"{column.title} ({unit})" if unit else column.title,
                difference=text if text.startswith((numbers.MINUS, numbers.DASH)) else f"+{text}",
                interval=numbers.interval(comparison.difference, column.factor),
                difference_sort=_sortable(comparison.difference.value),
                p_adjusted=numbers.p_value(comparison.p_adjusted),
                p_sort=_sortable(comparison.p_adjusted),
                improvement=numbers.value(improvement),
                improvement_interval=numbers.interval(improvement),
                improvement_sort=_sortable(improvement.value),
                resolved=comparison.p_adjusted < alpha,
            )
        )
    return found


def _held(ranking: Ranking) -> list[str]:
    return list(dict.fromkeys(metric for row in ranking.rows for metric in row.estimates))


def _unknown(metric: str) -> Column:
    return Column(metric, metric.removeprefix("mean_").replace("_", " "), "", metric)


def _table(
    ranking: Ranking,
    columns: tuple[Column, ...],
    colours: Mapping[str, str],
    links: Links,
    *,
    draw: bool = True,
) -> Table:
    axis = _axis(ranking.rows, columns[0]) if draw and columns else None
    lines = tuple(_line(row, columns, axis, colours, links) for row in ranking.rows)
    return Table(columns, lines, axis, any(line.one_seed for line in lines))


def _line(
    row: Row, columns: Sequence[Column], axis: Axis | None, colours: Mapping[str, str], links: Links
) -> Line:
    href = links.of_runs(row.label, row.run_ids)
    low, high = row.rank_interval
    return Line(
        index=links.index_of(row.label),
        label=row.label,
        colour=colours.get(row.label, ""),
        rank=row.rank,
        rank_interval=f"{low}" if low == high else f"{low} {numbers.DASH} {high}",
        rank_sort=row.rank + (low + high) / 1e6,
        group=row.group,
        best=numbers.probability(row.probability_best),
        best_sort=_sortable(row.probability_best),
        seeds=len(row.seeds),
        one_seed=len(row.seeds) == 1,
        href=href,
        cells=tuple(
            _cell(row.estimates.get(column.metric), column, href, axis if place == 0 else None)
            for place, column in enumerate(columns)
        ),
    )


def _cell(estimate: Estimate | None, column: Column, href: str, axis: Axis | None) -> Cell:
    if estimate is None or not math.isfinite(estimate.value):
        return Cell(numbers.DASH, "", None, "")
    return Cell(
        text=numbers.value(estimate, column.factor),
        interval=numbers.interval(estimate, column.factor),
        sort=estimate.value,
        href=href,
        plot=axis.plot(estimate, column.factor) if axis else None,
    )


def _axis(rows: Iterable[Row], column: Column) -> Axis | None:
    """Round ends around all intervals of a column; rates stay within 0 to 100."""
    found = [row.estimates[column.metric] for row in rows if column.metric in row.estimates]
    ends = [v * column.factor for e in found for v in (e.low, e.high, e.value) if math.isfinite(v)]
    if not ends:
        return None
    low, high = min(ends), max(ends)
    step = 10.0 ** math.floor(math.log10((high - low) or 1.0))
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    if column.rate:
        low, high = max(0.0, low), min(100.0, high)
    return Axis(low, high if high > low else low + step, column.unit)


def _sortable(value: float) -> float | None:
    return value if math.isfinite(value) else None
