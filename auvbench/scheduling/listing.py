"""Runs as rows: what `auvbench runs` shows of each."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any

from auvbench.errors import RunError, UserError, closest
from auvbench.runs import identity, run_filter, status
from auvbench.runs.directory import RunDirectory
from auvbench.runs.status import State
from auvbench.scheduling import estimate
from auvbench.untrusted.text import LONGEST, plain, short


@dataclass(frozen=True, slots=True)
class Row:
    """One run; times in seconds, rates in [0, 1]."""

    id: str
    name: str  # of the experiment: the folder
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
    holder: str | None  # who works on it
    error: str | None
    config: dict[str, Any] = field(default_factory=dict)  # by dotted key, of the vehicle its name alone

    @property
    def progress(self) -> float:
        if self.state is State.COMPLETE:
            return 1.0
        return min(1.0, self.steps / self.total_steps) if self.total_steps > 0 else 0.0


ORDER = {state: number for number, state in enumerate(State)}

SORTS: dict[str, Callable[[Row], Any]] = {
    "id": lambda row: row.id,
    "name": lambda row: (row.name, row.id),
    "state": lambda row: (ORDER[row.state], row.id),
    "algo": lambda row: (row.algo, row.id),
    "seed": lambda row: (row.seed, row.id),
    "progress": lambda row: (-row.progress, row.id),
    "success": lambda row: (-1.0 if row.success_rate is None else -row.success_rate, row.id),
    "wall": lambda row: (-row.wall_time_s, row.id),
    "created": lambda row: (row.created or "", row.id),
}
"""Sort keys; progress, success and wall time begin with the largest."""


@dataclass(frozen=True, slots=True)
class Filter:
    """Which rows are wanted; an empty field wants all."""

    states: Collection[str] = ()
    algos: Collection[str] = ()
    seeds: Collection[int] = ()
    names: Collection[str] = ()
    id: str = ""  # a part of it

    def wants(self, row: Row) -> bool:
        return (
            (not self.states or row.state in self.states)
            and (not self.algos or row.algo in self.algos)
            and (not self.seeds or row.seed in self.seeds)
            and (not self.names or row.name in self.names)
            and self.id in row.id
        )


def rows(runs: Iterable[RunDirectory]) -> tuple[list[Row], list[str]]:
    """A row per run, and a line per run whose manifest cannot be read."""
    found: list[Row] = []
    problems: list[str] = []
    for run in runs:
        try:
            found.append(_row(run))
        except RunError as error:
            problems.append(plain(error))
        except (KeyError, ValueError, TypeError, OSError) as error:  # of a progress file
            problems.append(plain(f"{run.path}: damaged: {error}"))
    return found, problems


def _row(run: RunDirectory) -> Row:
    at = status.of(run)
    manifest = at.manifest
    steps, episodes, success = manifest["steps"], manifest.get("episodes", 0), manifest.get("success_rate")
    wall = float(manifest["wall_time_s"])
    if at.state in (State.RUNNING, State.INTERRUPTED):
        # The manifest is written at the start and at the end; in between, and after a kill, this knows more.
        last = estimate.read(run.path)
        if last is not None and last.steps >= steps:
            steps, episodes, success = last.steps, last.episodes, last.success_rate
            if at.holder is not None:
                begun = datetime.fromisoformat(at.holder.since).timestamp()
                wall += max(0.0, last.time - begun)
    error = manifest.get("error") or {}
    return Row(
        id=short(manifest["id"]),
        name=plain(run.path.absolute().parent.name),
        path=plain(run.path),
        state=at.state,
        algo=short(manifest["algo"]),
        seed=manifest["seed"],
        steps=steps,
        total_steps=manifest["total_steps"],
        episodes=episodes,
        success_rate=success,
        wall_time_s=wall,
        created=short(manifest["created"]) if manifest.get("created") else None,
        holder=short(at.holder) if at.holder else None,
        error=plain(error.get("message", "no reason given")) if at.state is State.FAILED else None,
        config=_config(run),
    )


def _config(run: RunDirectory) -> dict[str, Any]:
    try:
        known = run_filter.flat(run.config())
    except (RunError, RecursionError):
        return {}  # the command that works on the run gives the error
    return {
        short(key): _shown(value)
        for key, value in known.items()
        if not key.startswith("vehicle.") or key == "vehicle.name"
    }


def _shown(value: Any) -> Any:
    """A value that a line and JSON can hold, of any YAML type."""
    if isinstance(value, list):
        return [_shown(item) for item in value[:LONGEST]]
    if value is None or isinstance(value, bool | int) or (isinstance(value, float) and math.isfinite(value)):
        return value
    return short(value)


def facts(row: Row) -> dict[str, Any]:
    """What `--where` can ask of a row."""
    known = {"algo.name": row.algo, "seed": row.seed, **row.config}
    return known | {"state": str(row.state), "id": row.id, "experiment": row.name}


IN_THE_ID = ("algo.name", "reward.k", "step.frequency", "seed")
"""what a run's id says already"""


def varying(rows: Sequence[Row]) -> list[str]:
    """The keys of the configuration in which the runs differ, beyond what their ids say and what follows from it.

    `disturbance.name` stands for all that a disturbance sets, as it does when it is typed.
    """
    configs = [row.config for row in rows if row.config]
    keys = dict.fromkeys(key for config in configs for key in config)
    found = []
    for key in keys:
        if key in IN_THE_ID or key.startswith(identity.NEUTRAL):
            continue
        # By the name of its group: one value for each name follows from the name.
        name = f"{key.split('.')[0]}.name"
        by_name: dict[str, set[str]] = {}
        for config in configs:
            group = "" if name == key else run_filter.text(config.get(name))
            by_name.setdefault(group, set()).add(run_filter.text(config.get(key)))
        if any(len(values) > 1 for values in by_name.values()):
            found.append(key)
    return found


def choose(found: Sequence[Row], wanted: Filter, sort: str = "name") -> list[Row]:
    """The wanted rows in order.

    Raises:
        UserError: there is no such state, algorithm, experiment or sort key among the rows.
    """
    if sort not in SORTS:
        raise UserError(f"--sort {sort}: unknown; {closest(sort, SORTS)}")
    _known("--state", wanted.states, [state.value for state in State])
    _known("--algo", wanted.algos, [row.algo for row in found])
    _known("--name", wanted.names, [row.name for row in found])
    return sorted(filter(wanted.wants, found), key=SORTS[sort])


def _known(option: str, given: Collection[str], valid: Iterable[str]) -> None:
    names = list(valid)
    for value in given:
        if value not in names:
            raise UserError(f"{option} {value}: unknown; {closest(value, names)}")


def as_json(row: Row) -> dict[str, Any]:
    return {**asdict(row), "progress": row.progress}
