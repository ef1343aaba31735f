"""The ranked table as the page shows it: columns, cells, small interval plots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from auvbench.analysis import limit
from auvbench.analysis.model import Ranking, Row
from auvbench.reporting.page import numbers
from auvbench.reporting.page.links import Links
from auvbench.reporting.tables.blocks import blocks
from auvbench.reporting.tables.columns import COLUMNS, FURTHER, letters
from auvbench.reporting.tables.notes import remarks, resolution
from auvbench.statistics.estimate import Estimate

PLOT_WIDTH = 108
"""px of an interval plot; its ends keep `PLOT_MARGIN` for the dot"""
PLOT_MARGIN = 6


DEFINITIONS = {
    "success_rate": "episodes that reach the waypoint",
    "collision_rate": "episodes that leave the depth limits",
    "timeout_rate": "episodes that use up their steps",
    "par1_steps": "agent steps of an episode; a failure counts as the step limit (PAR-1)",
    "par2_steps": "agent steps of an episode; a failure counts as twice the step limit (PAR-2)",
    "par1_time_s": "simulated time of an episode; a failure counts as the time limit (PAR-1)",
    "par2_time_s": "simulated time of an episode; a failure counts as twice the time limit (PAR-2)",
    "mean_steps": "agent steps of an episode, however it ended",
    "mean_time_to_goal_s": "simulated time of the successful episodes",
    limit.COLUMN: "time to goal over the limit of the scenario, geometric mean over successes: no agent is below 1",
    "mean_duration_s": "simulated time of an episode",
    "mean_return": "sum of the rewards of an episode",
    "mean_final_distance_m": "distance to the waypoint when the episode ends",
    "mean_deviation_mean_m": "perpendicular distance from the straight line between start and waypoint",
    "mean_deviation_std_m": "standard deviation over the steps of the distance from the straight line",
    "mean_command_norm_mean_N": "mean over the steps of the norm of the commands",
    "mean_command_norm_sum_N": "sum over the steps of the norm of the commands",
    "mean_energy_J": "electrical energy of an episode by the thrusters' table",
    "mean_path_length_m": "length of the path travelled",
    "mean_path_efficiency": "straight line divided by the path travelled",
    "mean_smoothness_per_s": "mean change of the commands per second",
    "mean_depth_margin_m": "smallest distance to the depth limits",
}
"""What a metric is, shown with its heading."""

MAIN = (
    "success_rate",
    "par1_steps",
    "mean_steps",
    limit.COLUMN,
    "collision_rate",
    "timeout_rate",
    "mean_deviation_mean_m",
    "mean_command_norm_mean_N",
    "mean_energy_J",
)
"""The metrics of the main table, in order; all others stand in the second one."""


@dataclass(frozen=True, slots=True)
class Heading:
    """A column's metric, the words over it, and how its numbers are printed."""

    metric: str
    title: str
    unit: str
    definition: str
    scale: float

    @property
    def rate(self) -> bool:
        return self.unit == "%"


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
    places: int
    """decimals of the ends"""

    @property
    def ends(self) -> tuple[str, str]:
        return (
            numbers.fixed(self.low, self.places),
            numbers.fixed(self.high, self.places) + ("\u202f" + self.unit if self.unit else ""),
        )

    def plot(self, estimate: Estimate, scale: float) -> Plot | None:
        shown = [estimate.low * scale, estimate.high * scale, estimate.value * scale]
        if not all(map(math.isfinite, shown)):
            return None
        span = (self.high - self.low) or 1.0
        width = PLOT_WIDTH - 2 * PLOT_MARGIN
        low, high, value = (
            round(PLOT_MARGIN + width * min(1.0, max(0.0, (number - self.low) / span)), 1) for number in shown
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
    pad: str = ""
    """digits set invisibly behind the text, so that the decimal points of a column stand in line"""


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
    training: str
    """'3 seeds', or 'not trained'"""
    one_seed: bool
    """one policy: another training might give another row, and it is not compared"""
    href: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """The ranked table: one line per agent, one cell per column."""

    headings: tuple[Heading, ...]
    lines: tuple[Line, ...]
    axis: Axis | None
    """of the first column, which is drawn"""
    remarks: tuple[str, ...]
    """what a row stands for, which rows are not compared, which trainings failed"""
    letters: bool
    """the group letters can be read"""
    resolution: str
    """how a reader sees who is resolved from whom"""


def main_table(ranking: Ranking, colours: Mapping[str, str], links: Links) -> Table:
    """The metric ranked by first and drawn, then as many of the usual ones as the page is wide."""
    held = _held(ranking)
    metrics = dict.fromkeys((ranking.rank_by, *MAIN))
    whole = table_of(ranking, [heading_of(m) for m in metrics if m in held], colours, links, draw=True)
    longest = max((len(line.group) for line in whole.lines), default=0) if whole.letters else 0
    room = room_of(whole) - PLOTTED - RANKS - (20 + 8.2 * max(longest, len("Group")) if whole.letters else 0)
    shown = 0
    while shown < len(whole.headings) and (shown == 0 or room >= width_of(whole, shown)):
        room -= width_of(whole, shown)
        shown += 1
    return part_of(whole, range(shown))


def further_tables(ranking: Ranking, shown: Table, colours: Mapping[str, str], links: Links) -> list[Table]:
    """Every metric that the main table leaves out, in as many tables of like size as the page's width asks for."""
    there = {heading.metric for heading in shown.headings}
    rest = [metric for metric in _held(ranking) if metric not in there]
    order = {metric: place for place, metric in enumerate(DEFINITIONS)}
    rest.sort(key=lambda metric: (order.get(metric, len(order)), metric))
    if not rest:
        return []
    whole = table_of(ranking, [heading_of(m) for m in rest], colours, links)
    count = len(blocks(range(len(rest)), lambda i: width_of(whole, i), room_of(whole), lambda i: i))
    ends = [round(i * len(rest) / count) for i in range(count + 1)]
    return [part_of(whole, range(a, b)) for a, b in pairwise(ends)]


PAGE = 1200
"""px that the page is wide at most, without its margins"""


PLOTTED = PLOT_WIDTH + 12
"""px of the interval plot beside the first column's numbers"""
RANKS = 62
"""px of the column of rank intervals"""


def room_of(table: Table) -> float:
    """Px that the columns of metrics may take beside rank and agent."""
    longest = max((max(len(line.label), len(line.training)) for line in table.lines), default=0)
    return PAGE - 70 - 8.4 * max(longest, 9)


def width_of(table: Table, i: int) -> float:
    """Px that column i takes, about: its heading in bold, or its longest number or interval, and the padding."""
    heading, cells = table.headings[i], [line.cells[i] for line in table.lines]
    title = 8.2 * len(heading.title) + (7.4 * (len(heading.unit) + 1) if heading.unit else 0)
    numbers_ = max((max(8.6 * len(c.text), 6.7 * len(c.interval)) for c in cells), default=0.0)
    return 20 + max(title, numbers_)


def part_of(table: Table, columns: Sequence[int]) -> Table:
    """The table with some of its columns."""
    return replace(
        table,
        headings=tuple(table.headings[i] for i in columns),
        lines=tuple(replace(line, cells=tuple(line.cells[i] for i in columns)) for line in table.lines),
    )


def order_in_words(ranking: Ranking) -> str:
    """'success, then PAR-1 steps'."""
    titles = [heading_of(metric).title for metric in (ranking.rank_by, ranking.then) if metric]
    return ", then ".join(t if t[1:2].isupper() else t[:1].lower() + t[1:] for t in titles)


def _held(ranking: Ranking) -> list[str]:
    return list(dict.fromkeys(metric for row in ranking.rows for metric in row.estimates))


def heading_of(metric: str) -> Heading:
    """The words of the other tables where they have this metric, its own name in words where not."""
    definition = DEFINITIONS.get(metric, metric)
    for column in (*COLUMNS, *FURTHER.values()):
        if column.metric == metric:
            title = column.title[0].upper() + column.title[1:]
            return Heading(metric, title, column.unit, definition, column.scale)
    stem, unit = metric.removeprefix("mean_"), ""
    for suffix, name in (("_per_s", "1/s"), ("_s", "s"), ("_m", "m"), ("_N", "N"), ("_J", "J")):
        if stem.endswith(suffix):
            stem, unit = stem.removesuffix(suffix), name
            break
    words = stem.replace("_", " ")
    return Heading(metric, words[:1].upper() + words[1:], unit, definition, 1.0)


def table_of(
    ranking: Ranking,
    headings: Sequence[Heading],
    colours: Mapping[str, str],
    links: Links,
    *,
    draw: bool = False,
) -> Table:
    """A line per row and a cell per heading; with `draw`, the first column has interval plots."""
    axis = _axis(ranking.rows, headings[0]) if draw and headings else None
    lines = tuple(_line(row, headings, axis, colours, links) for row in ranking.rows)
    lines = _aligned(lines)
    words = resolution(ranking)
    return Table(
        tuple(headings), lines, axis, remarks(ranking), letters(ranking), words[:1].upper() + words[1:]
    )


def _line(
    row: Row, headings: Sequence[Heading], axis: Axis | None, colours: Mapping[str, str], links: Links
) -> Line:
    href = links.of_runs(row.label, row.run_ids)
    learns = row.label in links.learners
    low, high = row.rank_interval
    return Line(
        index=links.index_of(row.label),
        label=row.label,
        colour=colours.get(row.label, ""),
        rank=row.rank,
        rank_interval=f"{low}" if low == high else f"{low} {numbers.NOTHING} {high}",
        rank_sort=row.rank + (low + high) / 1e6,
        group=row.group if row.compared else numbers.NOTHING,
        training=row.runs_in_words if learns else "not trained",
        one_seed=not row.compared,
        href=href,
        cells=tuple(
            _cell(row.estimates.get(heading.metric), heading, href, axis if place == 0 else None)
            for place, heading in enumerate(headings)
        ),
    )


def _cell(estimate: Estimate | None, heading: Heading, href: str, axis: Axis | None) -> Cell:
    if estimate is None or not math.isfinite(estimate.value):
        return Cell(numbers.NOTHING, "", None, "")
    text, interval = numbers.estimate(estimate, heading.scale)
    plot = axis.plot(estimate, heading.scale) if axis else None
    return Cell(text, interval, estimate.value, href, plot)


def _aligned(lines: tuple[Line, ...]) -> tuple[Line, ...]:
    """The same lines with every column's numbers padded to its most decimals."""
    columns = zip(*(line.cells for line in lines), strict=True)
    most = [max(len(_decimals(cell.text)) for cell in column) for column in columns]
    return tuple(
        replace(
            line,
            cells=tuple(
                replace(cell, pad=("." + "0" * (places - 1))[len(_decimals(cell.text)) :] if places else "")
                for cell, places in zip(line.cells, most, strict=True)
            ),
        )
        for line in lines
    )


def _decimals(text: str) -> str:
    """'.50' of '12.50'."""
    _, point, rest = text.partition(".")
    return point + rest


def _axis(rows: Iterable[Row], heading: Heading) -> Axis | None:
    """Round ends around all intervals of a column; rates stay within 0 to 100."""
    found = [row.estimates[heading.metric] for row in rows if heading.metric in row.estimates]
    ends = [v * heading.scale for e in found for v in (e.low, e.high, e.value) if math.isfinite(v)]
    if not ends:
        return None
    low, high = min(ends), max(ends)
    step = 10.0 ** math.floor(math.log10((high - low) or 1.0))
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    if high <= low:  # one value without an interval
        low, high = low - step, high + step
    if heading.rate:
        low, high = max(0.0, low), min(100.0, high)
    return Axis(low, high, heading.unit, max(0, -math.floor(math.log10(step))))


def sortable(value: float) -> float | None:
    return value if math.isfinite(value) else None
