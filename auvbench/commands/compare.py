"""`auvbench compare A B`: two runs or agents side by side."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from auvbench.commands.grammar import Parser, number

if TYPE_CHECKING:
    from auvbench.analysis.records import Agent
    from auvbench.analysis.side_by_side import Difference
    from auvbench.reporting.tables.table import Table


def parser() -> Parser:
    parser = Parser(
        prog="auvbench compare",
        where=True,
        description="Shows two agents side by side: differences with intervals, paired by test scenario (of learners, between "
        "typical trainings); the configuration keys in which they differ; the success of their training.",
        epilog="examples:\n"
        "  auvbench compare pid mpc --in outputs/quickstart\n"
        "  auvbench compare outputs/default/ppo-k1-f10-s0-bbe2fa44 outputs/default/ppo-k1-f10-s1-44c8f5ef\n"
        "  auvbench compare outputs/before outputs/after --where algo=ppo",
    )
    add = parser.add_argument
    for name in ("first", "second"):
        add(
            name,
            metavar=name.upper(),
            help="a run, a folder with the seeds of one agent, or an agent's label or algorithm in --in FOLDER",
        )
    add(
        "--in",
        dest="folder",
        type=Path,
        default=Path("outputs"),
        help="where labels are looked up (default: outputs)",
    )
    add("--protocol", default="test", metavar="NAME", help="the evaluation that is compared (default: test)")
    add("--condition", metavar="NAME", help="the test condition within the protocol: nominal, current=0.5")
    add(
        "--confidence",
        type=number(0.5, 0.999),
        default=0.95,
        metavar="P",
        help="of each interval (default: 0.95)",
    )
    add("--all", action="store_true", dest="every", help="every measure, not only the usual ones")
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder of the learning curves (default: compare/ in --in FOLDER)",
    )
    return parser


def main(arguments: Sequence[str]) -> int:
    given = parser().read(arguments)
    from rich.console import Console

    from auvbench.analysis import side_by_side
    from auvbench.reporting.tables.terminal import TableView
    from auvbench.runs.atomic_io import storage

    names = (given.first, given.second)
    found = [
        side_by_side.find_agent(name, given.folder, given.protocol, given.condition, given.where)
        for name in names
    ]
    pair = side_by_side.told_apart(found, names)
    differences = side_by_side.differences(pair, given.confidence, given.every)
    console = Console(highlight=False)
    console.print(TableView(_measures(pair, differences, given.confidence)))
    for note in _notes(differences, given.confidence):
        console.print(note, style="dim")
    if changed := side_by_side.settings(pair):
        console.print()
        console.print(TableView(_settings(pair, changed)))
    with storage("cannot draw the learning curves"):
        for path in _curves(pair, given.out or given.folder / "compare"):
            console.print(f"wrote {os.path.relpath(path)}", soft_wrap=True)
    return 0


def _notes(differences: Sequence[Difference], confidence: float) -> list[str]:
    """Return what the intervals cover, and what they assume."""
    from auvbench.statistics.typical import FEWEST, trainings_needed

    covers = differences[0].difference.covers if differences else ""
    lines = [
        f"Each interval holds by itself with {100 * confidence:g} % and covers {covers}; auvbench report compares with one error "
        "rate for all."
    ]
    trainings = max((one.trainings for one in differences), default=0)
    if trainings:
        lines.append(
            "The difference is that of typical trainings (half of all trainings are better, half worse), the others are means. "
            "Not behind: trainings that are no worse than the other agent's typical one, on these scenarios."
        )
    if 1 < trainings < FEWEST:
        lines.append(f"Fewer than {FEWEST} trainings allow no verdict.")
    elif 0 < trainings < (needed := trainings_needed(1, 1 - confidence)):
        lines.append(f"* fewer than {needed} trainings: holds if trainings cluster around the typical one.")
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
    several = any(one.reliability for one in differences)
    lines = []
    for one in differences:
        column = column_of(one.measure.name)
        star = "*" if 0 < one.trainings < needed else ""
        better = f"{pair[one.better].label}{star}" if one.better >= 0 else "open"
        cells = [Cell(column.text)]
        cells += [estimate_cell(estimate, column.scale) for estimate in (one.first, one.second)]
        cells += [estimate_cell(one.difference, column.scale, signed=True), Cell(better)]
        if several:
            cells.append(reliability_cell(one.reliability))
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
    """Draw the success in training over steps; return the pictures, none where neither agent learns."""
    from auvbench.analysis.ranking import rank
    from auvbench.reporting.figures import draw

    drawn = draw(["training_success"], pair, rank(pair), out)
    return [figure.png for figure in drawn]
