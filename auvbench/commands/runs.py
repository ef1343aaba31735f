"""`auvbench runs`: lists runs with state, progress and success."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

from auvbench.errors import UserError

if TYPE_CHECKING:
    from rich.text import Text

    from auvbench.scheduling.listing import Row

NUMBERS = ("steps", "progress", "seed", "success", "wall time")
STYLES = {"running": "cyan", "interrupted": "yellow", "failed": "red", "complete": "green", "pending": "dim"}


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as all of auvbench does."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message} (auvbench runs --help)")


def parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="auvbench runs",
        description="Lists runs: state, progress, seed, success over the last 100 training episodes, wall time.",
        epilog="States: pending, running, interrupted (also: killed while running), failed, complete.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "paths", nargs="*", default=["outputs"], metavar="PATH", help="runs or folders of runs"
    )
    parser.add_argument("--state", default="", metavar="STATE,...", help="only runs in these states")
    parser.add_argument("--algo", default="", metavar="NAME,...", help="only runs of these algorithms")
    parser.add_argument("--seed", default="", metavar="SEED,...", help="only runs with these seeds")
    parser.add_argument("--name", default="", metavar="NAME,...", help="only runs of these experiments")
    parser.add_argument("--id", default="", metavar="PART", help="only runs whose id contains this")
    parser.add_argument(
        "--sort",
        default="name",
        metavar="KEY",
        help="name, id, state, algo, seed, progress, success, wall, created",
    )
    parser.add_argument("--json", action="store_true", help="print a JSON list instead of a table")
    return parser


def main(argv: Sequence[str]) -> int:
    """Exit code 1 when a run could not be read: the others are listed, and it is named."""
    given = parser().parse_args(argv)
    from auvbench.runs.directory import find_runs
    from auvbench.scheduling import listing

    wanted = listing.Filter(
        states=_list(given.state),
        algos=_list(given.algo),
        seeds=_seeds(given.seed),
        names=_list(given.name),
        id=given.id,
    )
    found, problems = listing.rows(find_runs(given.paths))
    rows = listing.choose(found, wanted, given.sort)
    if given.json:
        print(json.dumps([listing.as_json(row) for row in rows], indent=1))
    else:
        _table(rows, of=len(found))
    for problem in problems:
        print(f"auvbench: {problem}", file=sys.stderr)
    return 1 if problems else 0


def _list(text: str) -> list[str]:
    return [value.strip() for value in text.split(",") if value.strip()]


def _seeds(text: str) -> list[int]:
    try:
        return [int(value) for value in _list(text)]
    except ValueError:
        raise UserError(f"--seed {text}: must be whole numbers, e.g. --seed 0,1,2") from None


def _table(rows: Sequence[Row], of: int) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from auvbench.scheduling.estimate import duration

    columns: dict[str, list[str | Text]] = {
        "experiment": [row.name for row in rows],
        "run": [row.id for row in rows],
        "state": [Text(row.state, STYLES[row.state]) for row in rows],
        "steps": [f"{row.steps:,}" if row.steps else "" for row in rows],
        "progress": [f"{row.progress:.0%}" for row in rows],
        "seed": [str(row.seed) for row in rows],
        "success": ["" if row.success_rate is None else f"{row.success_rate:.0%}" for row in rows],
        "wall time": [duration(row.wall_time_s) if row.wall_time_s else "" for row in rows],
        "remark": [Text(row.error or (f"held by {row.holder}" if row.holder else "")) for row in rows],
    }
    if len({row.name for row in rows}) == 1:
        del columns["experiment"]  # it would say the same in each line, and ids are long
    if not any(columns["remark"]):
        del columns["remark"]
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in columns:
        table.add_column(heading, no_wrap=True, justify="right" if heading in NUMBERS else "left")
    for cells in zip(*columns.values(), strict=True):
        table.add_row(*cells)
    console = Console()
    if not console.is_terminal:
        console = Console(width=1000)  # a file or a pipe has no width: nothing is to be cut there
    if rows:
        console.print(table)
    counts: dict[str, int] = {}
    for row in rows:
        counts[row.state] = counts.get(row.state, 0) + 1
    shown = f"{of} run{'s' if of != 1 else ''}" if len(rows) == of else f"{len(rows)} of {of} runs"
    print(f"{shown}: " + (", ".join(f"{number} {state}" for state, number in counts.items()) or "none"))
