"""Build the parts of the page: tables with links, the table of runs, and embedded figures."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import quote

from PIL import Image  # a dependency of Matplotlib

from auvbench.analysis.formatting import NOTHING, fixed
from auvbench.analysis.records import Agent, Problem, Ranking, RunRecord
from auvbench.reporting.figures import Figure
from auvbench.reporting.tables.main import label_of, main_table
from auvbench.reporting.tables.table import (
    Cell,
    Heading,
    Line,
    Table,
    column_of,
    estimate_cell,
    in_order,
)
from auvbench.runs.progress import duration, telling

LARGEST_SVG = 150_000
"""Size limit of an SVG on the page, bytes. The page shows the PNG of a larger SVG, because browsers draw thousands of
points slowly
"""
WIDE = 1200
"""smallest width in px of a PNG that takes the whole width of the page"""


class Links:
    """Relative links from the page's folder to files of runs, and to rows in the table of runs.

    `elsewhere` is the address of the page with the table of runs, if it is a different page.
    """

    def __init__(self, page: Path, runs: Sequence[RunRecord], elsewhere: str = "") -> None:
        self._folder = page.parent.resolve()
        self._elsewhere = elsewhere
        self.anchors = {run.id: f"run-{number}" for number, run in enumerate(runs, start=1)}

    def to(self, path: Path) -> str:
        """Return the relative, percent-encoded URL of a file or folder; a `file:` URL if it is on another drive."""
        try:
            # A leading ./ keeps a browser from reading a name with a colon as a URL's scheme.
            return "./" + quote(Path(os.path.relpath(path.resolve(), self._folder)).as_posix())
        except ValueError:  # Windows has no relative path to another drive
            return path.resolve().as_uri()

    def row(self, run_id: str) -> str:
        """Return the link to the run's row; '' if the table has no such row."""
        return f"{self._elsewhere}#{self.anchors[run_id]}" if run_id in self.anchors else ""

    def files(self, run: RunRecord) -> str:
        """Return the link to a run's manifest, or to its folder if there is no manifest."""
        return self.to(run.source.record)


def of_agents(table: Table, ranking: Ranking, colours: Mapping[str, str], links: Links) -> Table:
    """Add colours and links to `table`, which has one row per agent of the ranking; a link leads to the agent's first run."""
    lines = [
        replace(line, colour=colours.get(row.label, ""), href=links.row(row.run_ids[0]))
        for line, row in zip(table.lines, ranking.rows, strict=True)
    ]
    return replace(table, lines=tuple(lines))


def metrics_table(ranking: Ranking) -> Table | None:
    """Return a table of the metrics that the main table does not show; None if it shows all metrics."""
    shown = {heading.metric for heading in main_table(ranking).headings}
    metrics = dict.fromkeys(metric for row in ranking.rows for metric in row.estimates)
    columns = [column_of(metric) for metric in in_order(m for m in metrics if m not in shown)]
    if not columns:
        return None
    lines = [
        Line((Cell(label_of(row)), *(estimate_cell(row.estimates.get(c.metric), c.scale) for c in columns)))
        for row in ranking.rows
    ]
    return Table((Heading("agent", words=True), *columns), tuple(lines))


def runs_table(
    runs: Sequence[RunRecord], agents: Sequence[Agent], colours: Mapping[str, str], links: Links
) -> Table:
    """Return a table with a row per run: the agents' runs in the order of the agents, then all other runs."""
    headings = (
        Heading("run", words=True),
        Heading("agent", words=True),
        Heading("seed"),
        Heading("state", words=True),
        *(Heading(name, "%") for name in ("success", "collision", "timeout")),
        Heading("steps"),
        Heading("train steps"),
        Heading("train success", "%"),
        Heading("time"),
    )
    of_agent = {run.id: (run, agent, i) for agent in agents for i, run in enumerate(agent.runs)}
    of_no_agent = {run.id: (run, None, 0) for run in runs if run.id not in of_agent}
    lines = []
    for run, agent, i in (*of_agent.values(), *of_no_agent.values()):
        test: list[float | None] = [None] * 4
        if agent is not None:
            steps = agent.metrics.get("steps")
            test = [100 * float((agent.outcome[i] == code).mean()) for code in range(3)]
            test.append(None if steps is None else float(steps[i].mean()))
        label = "" if agent is None else agent.label
        cells = (
            *(Cell(run.id), Cell(label or NOTHING), Cell(str(run.seed), sort=run.seed), Cell(run.state)),
            *(_cell(value, 1) for value in test),
            *_training(run),
        )
        lines.append(
            Line(cells, "", colours.get(label, ""), links.files(run), anchor=links.anchors.get(run.id, ""))
        )
    return Table(headings, tuple(lines))


def _cell(value: float | None, places: int) -> Cell:
    if value is None or not math.isfinite(value):
        return Cell(NOTHING)
    return Cell(fixed(value, places), sort=value)


def _training(run: RunRecord) -> tuple[Cell, Cell, Cell]:
    """Return steps, success and wall time of a training."""
    keys = ("steps", "total_steps", "success_rate", "wall_time_s", "episodes")
    steps, total, success, seconds, episodes = (run.manifest.get(key) for key in keys)
    if success is not None and episodes is not None:
        success = telling(success, episodes)
    trained_steps = _cell(steps or None, 0)  # 0 for a controller
    if steps and total and steps < total:
        trained_steps = replace(trained_steps, value=f"{trained_steps.value} of {fixed(total, 0)}")
    wall = Cell(NOTHING) if seconds is None else Cell(duration(seconds), sort=seconds)
    return trained_steps, _cell(None if success is None else 100 * success, 1), wall


@dataclass(frozen=True, slots=True)
class Embedded:
    """Figure in the form that the template needs, with its picture as a data URI."""

    name: str
    title: str
    caption: str
    data: str
    """picture as a data URI"""
    href: str
    """link to the figure's SVG file"""
    size: tuple[int, int]
    """width and height of the PNG, px, so that the browser reserves space before the picture loads"""

    @property
    def wide(self) -> bool:
        """Return whether the figure needs more than half the page's width."""
        return self.size[0] > WIDE


def embed(figures: Iterable[Figure], links: Links) -> tuple[list[Embedded], list[Problem]]:
    """Return the figures in order, each as SVG if the SVG is small, otherwise as PNG.

    A figure whose files are missing becomes a `Problem`.
    """
    embedded: list[Embedded] = []
    problems: list[Problem] = []
    for figure in figures:
        try:
            with Image.open(figure.png) as image:
                size = image.size
            small = figure.svg.stat().st_size <= LARGEST_SVG
            content = (figure.svg if small else figure.png).read_bytes()
        except OSError as error:
            message = f"the figure's files cannot be read: {error.strerror or error}"
            problems.append(Problem(where=figure.name, kind="missing", message=message))
            continue
        kind = "svg+xml" if small else "png"
        data = f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
        embedded.append(Embedded(figure.name, figure.title, figure.caption, data, links.to(figure.svg), size))
    return embedded, problems
