"""Check the results of installed packages' tasks, rewards and blocks before they are used."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.errors import NumbaError

from auvbench import registry
from auvbench.config import rewards, schema, tasks
from auvbench.errors import AgentError
from auvbench.record import OUTCOMES, Record
from auvbench.tasks import base
from auvbench.tasks.base import Floats, Integers, Task
from auvbench.tasks.rewards import function_of
from auvbench.untrusted.text import short
from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel, n: int, seed: int, **stream: bool) -> Task:
    """Return N episodes of a task if an installed package has the task, the reward or a block of the observation.

    Raises:
        AgentError: the task or the reward cannot be created.
    """
    task, reward = config.task, config.reward
    who = paid = registry.owner("task", task)
    if isinstance(reward, rewards.RewardConfig):
        paid = registry.owner("reward", reward)
        with registry.telling(paid, "cannot be imported"):
            function_of(reward)
    kind = _class(task.name, who)
    with registry.telling(who, "cannot be made"):
        made: Task = kind(config, vehicle, n, seed, **stream)
    if isinstance(task, tasks.TaskConfig) or paid != who:
        made.owners = who, paid
    guard(made)
    return made


def _class(name: str, who: str) -> Callable[..., Task]:
    with registry.telling(who, "cannot be imported"):
        kind = base.factory(name)
    if not (isinstance(kind, type) and issubclass(kind, Task)):
        raise AgentError(f"{who}: its factory is not a class below auvbench.tasks.base.Task")
    for needed in ("draw", "step"):
        if not callable(getattr(kind, needed, None)):
            raise AgentError(f"{who}: {kind.__name__} lacks {needed}, a function of one episode")
    return kind


def guard(task: Task) -> None:
    """From now on check the results of packages' functions: those of the task, its reward and its blocks."""
    if task.owners:
        _guard_functions(task, *task.owners)
    if task.block_owners:
        _guard_blocks(task)


def _guard_functions(task: Task, who: str, paid: str) -> None:
    draw_rows, step_rows = task.draw_rows, task.step_rows
    own_metrics, records = task.own_metrics, task.records
    spec = registry.TASKS[task.name]
    columns = {*spec.shared, *(metric.name for metric in spec.metrics)}
    has_goal = spec.has_goal
    check_finite = _finite_check(task, who)

    def checked_draw(indices: Integers, pose: Floats) -> None:
        pose[:] = np.nan
        task.episodes.start[indices] = np.nan
        if has_goal:
            task.episodes.goal[indices] = np.nan
        with telling(who, "draw fails"):
            draw_rows(indices, pose)
        what = "draw gives no start: it must write finite numbers to e.start and return a finite yaw"
        _refuse(task, who, indices, np.isfinite(pose).all(axis=1), what)
        check_finite(indices, "draw")

    def checked_step(start: int, stop: int, *motion: Floats) -> int:
        with telling(who if paid == who else f"{who}, {paid}", "step fails"):
            ended = step_rows(start, stop, *motion)
        pose, rows, mine = motion[0], np.arange(start, stop), slice(start, stop)
        if not np.isfinite(pose[mine]).all():
            return ended  # the simulation is to blame
        _refuse(task, paid, rows, np.isfinite(task.reward[mine]), "the reward is not finite")
        check_finite(rows, "step")
        outcome = task.outcome[mine]
        known = (outcome >= -1) & (outcome < len(OUTCOMES))
        _refuse(task, who, rows, known, "step returns an unknown outcome")
        return ended

    def checked_metrics(i: int) -> dict[str, float]:
        with registry.telling(who, "own_metrics fails"):
            found = {name: float(value) for name, value in own_metrics(i).items()}
        if task.name not in registry.TASKS.own and (lacking := sorted(columns - found.keys())):
            raise AgentError(f"{who}: own_metrics lacks {', '.join(lacking)}")
        return found

    def checked_records(indices: Integers) -> list[Record]:
        found = records(indices)
        for record in found:
            for name, value in record.items():
                if not isinstance(value, str) and not np.isfinite(value):
                    raise AgentError(
                        f"{who}: {name} of episode {record['episode']} is {value}; it must be finite"
                    )
        return found

    for name, function in zip(
        base.GUARDED, (checked_draw, checked_step, checked_metrics, checked_records), strict=True
    ):
        setattr(task, name, function)


def _guard_blocks(task: Task) -> None:
    """From now on check the numbers that packages' blocks write."""
    observe, bounds = task.observe, task.spec.bounds

    def checked_observe(
        pose: Floats, velocity: Floats, indices: Integers | None = None, seats: Floats | None = None
    ) -> Any:
        with telling(", ".join(task.block_owners.values()), "write fails"):
            seen = observe(pose, velocity, indices, seats)
        rows = np.arange(task.n) if indices is None else indices
        motion = np.concatenate([pose[rows], velocity[rows]], axis=1)
        moving = np.isfinite(motion).all(axis=1)  # otherwise the simulation is to blame
        for name, who in task.block_owners.items():
            columns = task.spec[name]
            written, most = seen[rows, columns], bounds[columns]
            good = (np.abs(written) <= most) | ~moving[:, None]  # NaN is not
            if not good.all():
                row, column = np.argwhere(~good)[0]
                what = f"write gives {task.spec.blocks[name].labels[column]}={written[row, column]:g}"
                limit = f"; it must be within [{-most[column]:g}, {most[column]:g}]"
                _refuse(task, who, rows, good.all(axis=1), what + limit)
        return seen

    task.observe = checked_observe  # type: ignore[method-assign]


@contextmanager
def telling(who: str, what: str) -> Iterator[None]:
    """Turn an exception of a package's code, or of its compilation, into an `AgentError`."""
    with registry.telling(who, what):
        try:
            yield
        except NumbaError as error:
            text = re.sub(r"\x1b\[\d*m", "", str(error))
            lines = [line for line in text.splitlines() if line and not line.startswith("Failed in")]
            place = re.search(r'File "(.*)", line (\d+)', text)
            where = f" ({Path(place[1]).name}, line {place[2]})" if place else ""
            raise AgentError(f"{who}: {what}: it cannot be compiled{where}: {short(lines[0])}") from error


def _finite_check(task: Task, who: str) -> Callable[[Integers, str], None]:
    """Return a check that the fields of episodes, which a function wrote, are finite."""
    e, kind = task.episodes, task.episodes.dtype
    # All numbers of an episode at once, for speed: records are aligned, so that each is a whole number of words.
    words = np.ndarray((task.n, kind.itemsize // 8), np.float64, e)
    floats = [
        kind.fields[name][1] // 8 + word
        for name in kind.names
        if kind[name].base == np.float64
        for word in range(kind[name].itemsize // 8)
    ]
    others = any(kind[name].base.kind == "f" and kind[name].base != np.float64 for name in kind.names)

    def check(rows: Integers, function: str) -> None:
        if not others and np.isfinite(words[rows][:, floats]).all():
            return
        for name in kind.names:
            good = np.isfinite(e[name][rows].reshape(len(rows), -1)).all(axis=1)
            _refuse(task, who, rows, good, f"{function} writes {name}, which is not finite")

    return check


def _refuse(task: Task, who: str, rows: Integers, good: Any, what: str) -> None:
    if not good.all():
        row = int(rows[int(np.argmin(good))])
        e = task.episodes[row]
        raise AgentError(f"{who}: {what}, in environment {row} at step {e.steps} of its episode {e.episode}")
