"""`auvbench runs`: lists runs with state, progress and success, and removes those that were never begun."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from auvbench.commands.grammar import Parser
from auvbench.errors import UserError

if TYPE_CHECKING:
    from auvbench.scheduling.listing import Row


def parser() -> Parser:
    parser = Parser(
        prog="auvbench runs",
        where=True,
        description="Lists runs: state, progress, success over the last 100 training episodes (from 30 episodes on), "
        "wall time, and in which values of their configuration they differ beyond what their ids say.",
        epilog="States: pending, running, interrupted (also: killed while running), failed, complete.",
    )
    add = parser.add_argument
    add("paths", nargs="*", default=["outputs"], metavar="PATH", help="runs or folders of runs")
    add("--state", default="", metavar="STATE,...", help="only runs in these states")
    add("--algo", default="", metavar="NAME,...", help="only runs of these algorithms")
    add("--seed", default="", metavar="SEED,...", help="only runs with these seeds")
    add("--name", default="", metavar="NAME,...", help="only runs of these experiments")
    add("--id", default="", metavar="PART", help="only runs whose id contains this")
    add(
        "--columns",
        default="",
        metavar="KEY,...",
        help="configuration keys to show: reward.k,train.total_steps",
    )
    add(
        "--sort",
        default="name",
        metavar="KEY",
        help="name, id, state, algo, seed, progress, success, wall, created",
    )
    add("--json", action="store_true", help="print a JSON list instead of a table")
    add(
        "--discard",
        action="store_true",
        help="remove the pending runs among them, after showing them and asking",
    )
    add("--yes", action="store_true", help="with --discard: do not ask")
    return parser


def main(argv: Sequence[str]) -> int:
    """Exit code 1 when a run could not be read: the others are listed, and it is named."""
    given = parser().read(argv)
    if given.yes and not given.discard:
        raise UserError("--yes: answers the question of --discard, which is not there")
    if given.discard and given.json:
        raise UserError("--json: lists runs; --discard removes them: one at a time")
    from auvbench.commands import runs_table
    from auvbench.runs import run_filter
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
    rows = run_filter.select(rows, run_filter.parse(given.where), listing.facts)
    columns = _columns(given.columns, found)
    if given.discard:
        from auvbench.commands.discard import discard

        return discard(rows, columns, ask=not given.yes)
    if given.json:
        print(json.dumps([listing.as_json(row) for row in rows], indent=1))
    else:
        runs_table.show(rows, of=len(found), columns=columns)
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


def _columns(text: str, rows: Sequence[Row]) -> list[str]:
    """The keys that `--columns` names; the short name of a group stands for its choice."""
    from auvbench.config.suggestions import nearest

    known = {key for row in rows for key in row.config}
    found = []
    for name in _list(text):
        key = next((key for key in (name, f"{name}.name") if key in known), None)
        if key is None:
            near = nearest(name, known)
            hint = f"did you mean {near}?" if near else "auvbench runs --json shows the keys there are"
            raise UserError(f"--columns {name}: no run has this key; {hint}")
        found.append(key)
    return found
