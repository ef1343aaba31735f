"""Check the results of tasks, rewards and blocks from installed packages before auvbench uses these results."""

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
    """Return N episodes of a task whose class, reward or blocks of the observation come from an installed package.

    Raises:
        AgentError: the task or the reward cannot be created.
    """
    task, reward = config.task, config.reward
    task_owner = reward_owner = registry.owner("task", task)
    if isinstance(reward, rewards.RewardConfig):
        reward_owner = registry.owner("reward", reward)
        with registry.telling(reward_owner, "cannot be imported"):
            function_of(reward)
    kind = _class(task.name, task_owner)
    with registry.telling(task_owner, "cannot be made"):
        instance: Task = kind(config, vehicle, n, seed, **stream)
    if isinstance(task, tasks.TaskConfig) or reward_owner != task_owner:
        instance.owners = task_owner, reward_owner
    guard(instance)
    return instance


def _class(name: str, owner: str) -> Callable[..., Task]:
    with registry.telling(owner, "cannot be imported"):
        kind = base.factory(name)
    if not (isinstance(kind, type) and issubclass(kind, Task)):
        raise AgentError(f"{owner}: its factory is not a subclass of auvbench.tasks.base.Task")
    for needed in ("draw", "step"):
        if not callable(getattr(kind, needed, None)):
            raise AgentError(f"{owner}: {kind.__name__} must define {needed}, a function of one episode")
    return kind


def guard(task: Task) -> None:
    """Check, from now on, the results of a package's functions: functions of the task, the reward and blocks of the observation."""
    if task.owners:
        _guard_functions(task, *task.owners)
    if task.block_owners:
        _guard_blocks(task)


def _guard_functions(task: Task, task_owner: str, reward_owner: str) -> None:
    draw_rows, step_rows = task.draw_rows, task.step_rows
    own_metrics, records = task.own_metrics, task.records
    spec = registry.TASKS[task.name]
    columns = {*spec.shared, *(metric.name for metric in spec.metrics)}
    has_goal = spec.has_goal
    check_finite = _finite_check(task, task_owner)

    def checked_draw(indices: Integers, pose: Floats) -> None:
        pose[:] = np.nan
        task.episodes.start[indices] = np.nan
        if has_goal:
            task.episodes.goal[indices] = np.nan
        with telling(task_owner, "draw fails"):
            draw_rows(indices, pose)
        what = "draw gives no start: it must write finite numbers to e.start and return a finite yaw"
        _refuse(task, task_owner, indices, np.isfinite(pose).all(axis=1), what)
        check_finite(indices, "draw")

    def checked_step(start: int, stop: int, *motion: Floats) -> int:
        with telling(
            task_owner if reward_owner == task_owner else f"{task_owner}, {reward_owner}", "step fails"
        ):
            ended = step_rows(start, stop, *motion)
        pose, rows, span = motion[0], np.arange(start, stop), slice(start, stop)
        if not np.isfinite(pose[span]).all():
            return ended  # `Task.checked` raises the error: the simulation caused it
        _refuse(task, reward_owner, rows, np.isfinite(task.reward[span]), "the reward is not finite")
        check_finite(rows, "step")
        outcome = task.outcome[span]
        is_valid = (outcome >= -1) & (outcome < len(OUTCOMES))
        _refuse(task, task_owner, rows, is_valid, "step returns an unknown outcome")
        return ended

    def checked_metrics(i: int) -> dict[str, float]:
        with registry.telling(task_owner, "own_metrics fails"):
            metrics = {name: float(value) for name, value in own_metrics(i).items()}
        if task.name not in registry.TASKS.own and (lacking := sorted(columns - metrics.keys())):
            raise AgentError(f"{task_owner}: own_metrics lacks {', '.join(lacking)}")
        return metrics

    def checked_records(indices: Integers) -> list[Record]:
        episode_records = records(indices)
        for record in episode_records:
            for name, value in record.items():
                if not isinstance(value, str) and not np.isfinite(value):
                    raise AgentError(
                        f"{task_owner}: {name} of episode {record['episode']} is {value}; it must be finite"
                    )
        return episode_records

    for name, function in zip(
        base.GUARDED, (checked_draw, checked_step, checked_metrics, checked_records), strict=True
    ):
        setattr(task, name, function)


def _guard_blocks(task: Task) -> None:
    """From now on, check the numbers that packages' blocks write."""
    observe, bounds = task.observe, task.spec.bounds

    def checked_observe(
        pose: Floats, velocity: Floats, indices: Integers | None = None, seats: Floats | None = None
    ) -> Any:
        with telling(", ".join(task.block_owners.values()), "write fails"):
            observations = observe(pose, velocity, indices, seats)
        rows = np.arange(task.n) if indices is None else indices
        motion = np.concatenate([pose[rows], velocity[rows]], axis=1)
        moving = np.isfinite(motion).all(axis=1)  # otherwise the simulation caused the error
        for name, owner in task.block_owners.items():
            columns = task.spec[name]
            written, most = observations[rows, columns], bounds[columns]
            good = (np.abs(written) <= most) | ~moving[:, None]  # False for NaN
            if not good.all():
                row, column = np.argwhere(~good)[0]
                what = f"write gives {task.spec.blocks[name].labels[column]}={written[row, column]:g}"
                limit = f"; it must be within [{-most[column]:g}, {most[column]:g}]"
                _refuse(task, owner, rows, good.all(axis=1), what + limit)
        return observations

    task.observe = checked_observe  # type: ignore[method-assign]


@contextmanager
def telling(owner: str, what: str) -> Iterator[None]:
    """Turn an exception of a package's code, or of its compilation, into an `AgentError`."""
    with registry.telling(owner, what):
        try:
            yield
        except NumbaError as error:
            text = re.sub(r"\x1b\[\d*m", "", str(error))
            lines = [line for line in text.splitlines() if line and not line.startswith("Failed in")]
            place = re.search(r'File "(.*)", line (\d+)', text)
            where = f" ({Path(place[1]).name}, line {place[2]})" if place else ""
            raise AgentError(f"{owner}: {what}: it cannot be compiled{where}: {short(lines[0])}") from error


def _finite_check(task: Task, owner: str) -> Callable[[Integers, str], None]:
    """Return a function that checks that the fields of episodes are finite after a package's function wrote them."""
    e, kind = task.episodes, task.episodes.dtype
    # For speed, all numbers of an episode are checked at once. A record is aligned, so that its size is a whole number of words.
    words = np.ndarray((task.n, kind.itemsize // 8), np.float64, e)
    floats = [
        kind.fields[name][1] // 8 + word
        for name in kind.names
        if kind[name].base == np.float64
        for word in range(kind[name].itemsize // 8)
    ]
    other_floats = any(kind[name].base.kind == "f" and kind[name].base != np.float64 for name in kind.names)

    def check(rows: Integers, function: str) -> None:
        if not other_floats and np.isfinite(words[rows][:, floats]).all():
            return
        for name in kind.names:
            good = np.isfinite(e[name][rows].reshape(len(rows), -1)).all(axis=1)
            _refuse(task, owner, rows, good, f"{function} writes {name}, which is not finite")

    return check


def _refuse(task: Task, owner: str, rows: Integers, good: Any, what: str) -> None:
    if not good.all():
        row = int(rows[int(np.argmin(good))])
        e = task.episodes[row]
        raise AgentError(
            f"{owner}: {what}, in environment {row} at step {e.steps} of its episode {e.episode}"
        )
