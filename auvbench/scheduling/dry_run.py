"""Show which runs a grid would start or resume, and what they would cost, without starting them.

The cost is an estimate from complete runs of the same algorithm, task and number of environments in the output folder.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from rich.console import Console

from auvbench.config.algorithms import learns
from auvbench.errors import RunError
from auvbench.runs import progress
from auvbench.runs.directory import RunDirectory, find_runs
from auvbench.scheduling import grid
from auvbench.scheduling.grid import Action, Step
from auvbench.scheduling.loop import MANY, Backend, largest_array

if TYPE_CHECKING:
    from omegaconf import DictConfig

Like = tuple[Any, ...]
"""Algorithm, task and number of environments. Runs with the same three values have about the same cost per step."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one complete training."""

    seconds_per_step: float
    """processor time per environment step, s"""
    size: int
    """size of the run's folder in bytes"""


@dataclass(frozen=True, slots=True)
class Todo:
    """A run that would be started or resumed."""

    run: RunDirectory
    like: Like | None
    """algorithm, task and number of environments, for the estimate of the cost; None for an agent that does not learn"""
    steps: int
    """remaining environment steps"""


def show(configs: Sequence[DictConfig], console: Console | None = None) -> int:
    """Print the runs of a grid, their state, and an estimate of their cost; write nothing. Return the exit code 0.

    Raises:
        ConfigError, VehicleError, MissingExtraError: a job cannot run, as in `grid.carry_out`.
    """
    say = partial(grid.say, console or Console())
    plans = grid.planned(configs)
    backend = grid.backend(configs[0].launcher, learning=False)
    steps = [
        grid.step_of(plan.run, backend) if plan.run.path.exists() else Step(plan.run, Action.START)
        for plan in plans.values()
    ]
    backend.close()
    grid.show(steps, say)
    waiting = [step.run for step in steps if step.action in grid.TODO]
    todo = [_todo(run, plans[run.path].values) for run in waiting]
    for entry in todo:
        say(f"{entry.run.path}" + (f": {entry.steps:,} steps" if entry.like else ": nothing to train"))
    for line in _estimates(todo, Path(configs[0].output)):
        say(line)
    for line in _script(backend, waiting):
        say(line)
    say("nothing was started (--dry-run)")
    return 0


def _todo(run: RunDirectory, values: dict[str, Any]) -> Todo:
    if not learns(values["algo"]):
        return Todo(run, None, 0)
    done = run.manifest()["steps"] if run.path.exists() else 0
    return Todo(run, _like(values), max(0, values["train"]["total_steps"] - done))


def _like(values: dict[str, Any]) -> Like:
    return values["algo"]["name"], values["task"]["name"], values["algo"]["n_envs"]


def _runs(output: Path) -> list[RunDirectory]:
    try:
        return find_runs([output])
    except RunError:
        return []  # no run exists yet


def _costs(output: Path, kinds: Container[Like]) -> dict[Like, list[Cost]]:
    """Return the costs of the complete trainings in the folder `output`, for each `Like` in `kinds`."""
    costs: dict[Like, list[Cost]] = {}
    for run in _runs(output):
        try:
            manifest, values = run.manifest(), run.config()
            if manifest["state"] != "complete" or not learns(values["algo"]):
                continue
            if (like := _like(values)) not in kinds:
                continue
        except (RunError, KeyError, TypeError):
            continue  # Skip a damaged run; other commands report it.
        size = sum(path.stat().st_size for path in run.path.rglob("*") if path.is_file())
        costs.setdefault(like, []).append(Cost(manifest["cpu_time_s"] / max(1, manifest["steps"]), size))
    return costs


def _estimates(todo: Sequence[Todo], output: Path) -> list[str]:
    learning: dict[Like, list[Todo]] = {}
    for entry in todo:
        if entry.like:
            learning.setdefault(entry.like, []).append(entry)
    if not learning:
        return []
    costs, lines = _costs(output, learning), []
    seconds = size = 0.0
    n_runs = 0
    for like, entries in learning.items():
        what = f"{like[0]} on {like[1]}"
        if like not in costs:
            lines.append(f"{what}: cost unknown until one such run is complete")
            continue
        n_runs += len(costs[like])
        seconds += median(cost.seconds_per_step for cost in costs[like]) * sum(e.steps for e in entries)
        size += median(cost.size for cost in costs[like]) * len(entries)
    if n_runs:
        of = f"from {n_runs} complete run{'s' if n_runs != 1 else ''} here"
        lines.insert(
            0, f"about {progress.duration(seconds)} of processor time and {size / 1e6:,.1f} MB, {of}"
        )
    return lines


def _script(backend: Backend, runs: Sequence[RunDirectory]) -> list[str]:
    """Return a title and the batch script of the first run or array of runs; [] without runs or for a backend without scripts."""
    write = getattr(backend, "script", None)
    if write is None or not runs:
        return []
    together = min(len(runs), largest_array(backend), backend.limit or len(runs))
    if together <= MANY:
        together = 1
    what = "the first" if together == 1 else f"the array of the first {together} runs"
    return [
        f"batch script of {what}:",
        str(write(*(run.path.absolute() for run in runs[:together]))).rstrip(),
    ]
