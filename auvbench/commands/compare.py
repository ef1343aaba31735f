"""`auvbench compare A B`: compare two runs or agents side by side."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.grammar import Parser, number

if TYPE_CHECKING:
    from auvbench.analysis.records import Agent
    from auvbench.analysis.side_by_side import Difference
    from auvbench.reporting.tables.table import Table


def parser() -> Parser:
    parser = Parser(
        prog="auvbench compare",
        where=True,
        description="Compares two agents side by side: their differences with intervals, paired by test "
        "scenario (for learners, between "
        "typical trainings); the configuration keys in which the agents differ; their success rates during training.",
        epilog="examples:\n"
        "  auvbench compare pid mpc --in outputs/quickstart\n"
        "  auvbench compare outputs/default/ppo-bluerov2_2026-k1-f10-s0-f3f211ab outputs/default/ppo-bluerov2_2026-k1-f10-s1-d8c3846d\n"
        "  auvbench compare outputs/before outputs/after --where algo=ppo",
    )
    add = parser.add_argument
    for name in ("first", "second"):
        add(
            name,
            metavar=name.upper(),
            help="a run, a folder with the seeds of one agent, or the label or algorithm of an agent in --in FOLDER",
        )
    add(
        "--in",
        dest="folder",
        type=Path,
        default=Path("outputs"),
        help="folder in which labels are looked up (default: outputs)",
    )
    add("--protocol", default="test", metavar="NAME", help="protocol whose rows are compared (default: test)")
    add("--condition", metavar="NAME", help="test condition within the protocol, e.g. nominal, current=0.5")
    add(
        "--confidence",
        type=number(0.5, 0.999),
        default=0.95,
        metavar="P",
        help="confidence of each interval (default: 0.95)",
    )
    add("--all", action="store_true", dest="every", help="show every measure, not only the main measures")
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the learning curves (default: compare/ in --in FOLDER)",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    options = parser().read(arguments)
    from rich.console import Console

    from auvbench.analysis import side_by_side
    from auvbench.reporting.tables.terminal import TableView
    from auvbench.runs.atomic_io import storage

    names = (options.first, options.second)
    agents = [
        side_by_side.find_agent(name, options.folder, options.protocol, options.condition, options.where)
        for name in names
    ]
    pair = side_by_side.with_distinct_labels(agents, names)
    differences = side_by_side.differences(pair, options.confidence, options.every)
    console = Console(highlight=False)
    console.print(TableView(_measures(pair, differences, options.confidence)))
    for note in _notes(differences, options.confidence):
        console.print(note, style="dim")
    if changed := side_by_side.settings(pair):
        console.print()
        console.print(TableView(_settings(pair, changed)))
    with storage("cannot draw the learning curves"):
        for path in _curves(pair, options.out or options.folder / "compare"):
            console.print(f"wrote {os.path.relpath(path)}", soft_wrap=True)
    return 0


def _notes(differences: Sequence[Difference], confidence: float) -> list[str]:
    """Return notes on the intervals of the differences: confidence, covered sources of variance, and assumptions."""
    from auvbench.statistics.typical import FEWEST, trainings_needed

    covers = differences[0].difference.covers if differences else ""
    lines = [
        f"Each single interval has {100 * confidence:g} % confidence and covers {covers}; auvbench report controls one error rate "
        "for all its comparisons."
    ]
    trainings = max((difference.trainings for difference in differences), default=0)
    if trainings:
        lines.append(
            "The difference compares typical trainings (half of all trainings are better, half worse); the other columns are means. "
            "Not behind: share of trainings that are at least as good as the other agent's typical training, on these scenarios."
        )
    if 1 < trainings < FEWEST:
        lines.append(f"Fewer than {FEWEST} trainings allow no verdict.")
    elif 0 < trainings < (needed := trainings_needed(1, 1 - confidence)):
        lines.append(
            f"* fewer than {needed} trainings: valid only if trainings cluster around the typical training."
        )
    return lines


def _measures(pair: Sequence[Agent], differences: Sequence[Difference], confidence: float) -> Table:
    from auvbench.analysis.formatting import counted
    from auvbench.reporting.tables.main import NOT_BEHIND, reliability_cell
    from auvbench.reporting.tables.table import Cell, Heading, Line, Table, column_of, estimate_cell
    from auvbench.statistics.typical import trainings_needed

    needed = trainings_needed(1, 1 - confidence)
    headings = [
        Heading("measure", words=True),
        *(Heading(agent.label, counted(len(agent.runs), "run")) for agent in pair),
    ]
    several = any(difference.reliability for difference in differences)
    lines = []
    for difference in differences:
        column = column_of(difference.measure.name)
        star = "*" if 0 < difference.trainings < needed else ""
        better = f"{pair[difference.better].label}{star}" if difference.better >= 0 else "open"
        cells = [Cell(column.text)]
        cells += [estimate_cell(estimate, column.scale) for estimate in (difference.first, difference.second)]
        cells += [estimate_cell(difference.difference, column.scale, signed=True), Cell(better)]
        if several:
            cells.append(reliability_cell(difference.reliability))
        lines.append(Line(tuple(cells)))
    headings += [Heading("difference", "second less first"), Heading("better", words=True)]
    if several:
        headings.append(Heading("not behind", "trainings", hint=NOT_BEHIND))
    return Table(tuple(headings), tuple(lines))


def _settings(pair: Sequence[Agent], changed: Sequence[tuple[str, str, str]]) -> Table:
    from auvbench.reporting.tables.table import Cell, Heading, Line, Table

    headings = (Heading("key", words=True), *(Heading(agent.label, words=True) for agent in pair))
    return Table(headings, tuple(Line(tuple(map(Cell, row))) for row in changed))


def _curves(pair: Sequence[Agent], out: Path) -> list[Path]:
    """Plot the success rate in training over steps; return the PNG files, or [] if no agent learns."""
    from auvbench.analysis.ranking import rank
    from auvbench.reporting.figures import draw

    drawn = draw(["training_success"], pair, rank(pair), out)
    return [figure.png for figure in drawn]
