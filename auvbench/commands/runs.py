"""`auvbench runs`: list runs with their state, progress and success."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvbench.errors import RunError, UserError
from auvbench.grammar import Parser
from auvbench.runs import history, identity, run_filter, status
from auvbench.runs.directory import RunDirectory, find_runs
from auvbench.runs.status import State
from auvbench.untrusted.text import LONGEST, plain, short

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

STYLES = {"running": "cyan", "interrupted": "yellow", "failed": "red", "complete": "green", "pending": "dim"}
IN_THE_ID = ("algo.name", "reward.k", "step.frequency", "seed")
"""keys whose values a run's id contains"""


@dataclass(frozen=True, slots=True)
class Row:
    """One run; times in seconds, rates in [0, 1]."""

    id: str
    name: str  # name of the experiment, which is the name of the folder above the run
    path: str
    state: State
    algo: str
    seed: int
    steps: int
    total_steps: int
    episodes: int
    success_rate: float | None  # over the last 100 training episodes
    wall_time_s: float
    created: str | None
    holder: str | None  # process that works on the run
    error: str | None
    config: dict[str, Any] = field(
        default_factory=dict
    )  # values by dotted key; the name represents the vehicle sheet

    @property
    def progress(self) -> float:
        """Return the finished share of the budget."""
        if self.state is State.COMPLETE:
            return 1.0
        return min(1.0, self.steps / self.total_steps) if self.total_steps > 0 else 0.0


def parser() -> Parser:
    parser = Parser(
        prog="auvbench runs",
        where=True,
        description="Lists runs: state, progress, success over the last 100 training episodes (from 30 episodes on), "
        "wall time, and the configuration values in which the runs differ, except values that the run ids contain.",
        epilog="States: pending, running, interrupted (also: killed while running), failed, complete; "
        "--where state=failed,pending selects runs by state. --where also accepts id and experiment.",
    )
    add = parser.add_argument
    add("paths", nargs="*", default=["outputs"], metavar="PATH", help="runs or folders of runs")
    add("--json", action="store_true", help="print a JSON list instead of a table")
    add(
        "--history",
        action="store_true",
        help="print all trainings and tests of the experiments as JSON lines, including those of deleted runs",
    )
    return parser


def main(argv: Sequence[str]) -> int:
    """List the runs, and name each run that cannot be read. Return 1 if a run cannot be read, else 0."""
    options = parser().read(argv)
    if options.history:
        return _print_history(options.paths, options.where or options.json)
    listed, problems = rows(find_runs(options.paths))
    chosen = run_filter.select(listed, run_filter.parse(options.where), _facts)
    chosen = sorted(chosen, key=lambda row: (row.name, row.id))
    if options.json:
        print(json.dumps([{**asdict(row), "progress": row.progress} for row in chosen], indent=1))
    else:
        _show(chosen, of=len(listed))
        _tell_deleted(options.paths, [row.id for row in listed])
    for problem in problems:
        print(f"auvbench: {problem}", file=sys.stderr)
    return 1 if problems else 0


def _print_history(paths: Sequence[str], narrowed: bool) -> int:
    """Print the lines of all histories in the given paths, and return the exit code."""
    if narrowed:
        raise UserError("--history: prints all lines as JSON; leave out --where and --json")
    folders = [folder for path in paths for folder in _experiments(Path(path))]
    if not folders:
        raise UserError(f"{' '.join(paths)}: no {history.FILE} found; auvbench train and evaluate write it")
    try:
        lines = history.merged(history.read(folder) for folder in folders)
    except (OSError, ValueError) as error:
        raise UserError(f"{history.FILE}: {short(error)}") from error
    for line in lines:
        print(line.text)
    return 0


def _tell_deleted(paths: Sequence[str], ids: Sequence[str]) -> None:
    """Print how many trainings and tests in the histories belong to deleted runs."""
    folders = {folder for path in paths for folder in _experiments(Path(path)) if folder != Path(path).parent}
    with contextlib.suppress(OSError, ValueError):
        lines = history.merged(map(history.read, sorted(folders)))
        if history.deleted(lines, ids):
            print(f"history: {history.summary(lines, ids)} (auvbench runs --history)")


def _experiments(path: Path) -> list[Path]:
    """Return the folders with a history: the path itself, its subfolders, and the parent folder if the path is a run."""
    candidates = [path, *([path.parent] if (path / "manifest.json").is_file() else [])]
    if path.is_dir():
        candidates += sorted(child for child in path.iterdir() if child.is_dir())
    return [folder for folder in candidates if (folder / history.FILE).is_file()]


def rows(runs: Iterable[RunDirectory]) -> tuple[list[Row], list[str]]:
    """Return a table row for each readable run, and an error line for each run that cannot be read."""
    table_rows: list[Row] = []
    problems: list[str] = []
    for run in runs:
        try:
            table_rows.append(_row(run))
        except RunError as error:
            problems.append(plain(error))
    return table_rows, problems


def _row(run: RunDirectory) -> Row:
    from auvbench.runs import progress

    at = status.of(run)
    manifest = at.manifest
    now: Mapping[str, Any] = manifest
    wall = float(manifest["wall_time_s"])
    if at.state in (State.RUNNING, State.INTERRUPTED):
        last = progress.read(run.path)
        now = progress.newest(last, manifest)
        if last is not None and at.holder is not None and at.holder.since:
            wall += max(0.0, last.time - datetime.fromisoformat(at.holder.since).timestamp())
    error = manifest.get("error") or {}
    return Row(
        id=short(manifest["id"]),
        name=plain(run.path.absolute().parent.name),
        path=plain(run.path),
        state=at.state,
        algo=short(manifest["algo"]),
        seed=manifest["seed"],
        steps=now["steps"],
        total_steps=manifest["total_steps"],
        episodes=now.get("episodes", 0),
        success_rate=now.get("success_rate"),
        wall_time_s=wall,
        created=short(manifest["created"]) if manifest.get("created") else None,
        holder=short(at.holder) if at.holder else None,
        error=plain(error.get("message") or "no reason given") if at.state is State.FAILED else None,
        config=_config(run),
    )


def _config(run: RunDirectory) -> dict[str, Any]:
    try:
        values = run_filter.flat(run.config())
    except (RunError, RecursionError):
        return {}  # Listing runs ignores this error; a command that uses the run reports it.
    return {
        short(key): _shown(value)
        for key, value in values.items()
        if not key.startswith("vehicle.") or key == "vehicle.name"
    }


def _shown(value: Any) -> Any:
    """Return a value of any YAML type in a form that fits a line and JSON."""
    if isinstance(value, list):
        return [_shown(item) for item in value[:LONGEST]]
    if value is None or isinstance(value, bool | int) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return short(value)


def _facts(row: Row) -> dict[str, Any]:
    """Return the values of a row by which `--where` can select the run."""
    values = {"algo.name": row.algo, "seed": row.seed, **row.config}
    return values | {"state": str(row.state), "id": row.id, "experiment": row.name}


def varying(rows: Sequence[Row]) -> list[str]:
    """Return the keys in which the runs differ, for the columns of the table.

    A key is left out if the runs' ids contain it, or if it cannot change a result. A key is also left out if the name of its
    group determines the value: the column `disturbance.name` then represents all values of a disturbance.
    """
    configs = [row.config for row in rows if row.config]
    keys = []
    for key in dict.fromkeys(key for config in configs for key in config):
        if key in IN_THE_ID or key.startswith(identity.NEUTRAL):
            continue
        # Compare the key's values only between runs whose group has the same name.
        name = f"{key.split('.')[0]}.name"
        by_name: dict[str, set[str]] = {}
        for config in configs:
            group = "" if name == key else run_filter.text(config.get(name))
            by_name.setdefault(group, set()).add(run_filter.text(config.get(key)))
        if any(len(values) > 1 for values in by_name.values()):
            keys.append(key)
    return keys


def _show(rows: Sequence[Row], *, of: int) -> None:
    """Print the table, remarks and a line of counts."""
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 1000  # A file or a pipe has no width, so no text may be cut.
    if rows:
        console.print(table(rows, console))
    for row in rows:
        if remark := row.error or (f"locked by {row.holder}" if row.holder else ""):
            console.print(f"{row.id}: {remark}", soft_wrap=True, markup=False, style="dim")
    counts = {state: sum(row.state is state for row in rows) for state in State}
    shown = f"{of} run{'s' if of != 1 else ''}" if len(rows) == of else f"{len(rows)} of {of} runs"
    print(
        f"{shown}: "
        + (", ".join(f"{number} {state}" for state, number in counts.items() if number) or "none")
    )


def table(rows: Sequence[Row], console: Console) -> Table:
    """Return the table of runs.

    The table always has the columns state, steps, success and wall time. If the terminal is too narrow, the columns after
    wall time are left out, starting with the last column.
    """
    from rich.measure import Measurement

    several = len({row.name for row in rows}) > 1
    optional = [*(["experiment"] if several else []), "progress", *varying(rows)]
    while True:
        full = _table(rows, optional)
        width = Measurement.get(console, console.options.update(max_width=10_000), full).maximum
        if not optional or width <= console.width:
            return full
        optional.pop()


def _table(rows: Sequence[Row], more: Sequence[str]) -> Table:
    from rich.table import Table
    from rich.text import Text

    from auvbench.runs.progress import duration, telling

    grid = Table(box=None, pad_edge=False)
    grid.add_column("run", overflow="fold")
    grid.add_column("state", no_wrap=True)
    for name in ("steps", "success", "wall time"):
        grid.add_column(name, justify="right", no_wrap=True)
    for key in more:
        grid.add_column(key.removesuffix(".name"), overflow="fold")
    for row in rows:
        rate = telling(row.success_rate, row.episodes)
        facts = {**row.config, "experiment": row.name, "progress": f"{row.progress:.0%}"}
        words = [
            f"{row.steps:,}" if row.steps else "",
            "" if rate is None else f"{rate:.0%}",
            duration(row.wall_time_s) if row.wall_time_s else "",
            *(run_filter.text(facts[key]) if key in facts else "" for key in more),
        ]
        grid.add_row(Text(row.id), Text(row.state, STYLES[row.state]), *map(Text, words))
    return grid
