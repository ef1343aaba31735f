"""Tasks and rewards of installed packages behind the contract: what they compute is checked before it is used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from auvbench import metrics, registry
from auvbench.config import rewards, schema, tasks
from auvbench.errors import AgentError
from auvbench.record import OUTCOMES, Record
from auvbench.tasks import base
from auvbench.tasks import kernels as k
from auvbench.tasks.base import Floats, Integers, Task
from auvbench.tasks.rewards import hook_of
from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel, n: int, seed: int, **stream: bool) -> Task:
    """Return N episodes of a task, where an installed package brings the task, the reward or both.

    Raises:
        AgentError: one of them cannot be made.
    """
    task, reward = config.task, config.reward
    who = f"task={task.name}"
    if isinstance(task, tasks.TaskConfig):
        who = f"{who} of {task.package}"
    kind = _class(task.name, who)
    with registry.telling(who, "cannot be made"):
        made: Task = kind(config, vehicle, n, seed, **stream)
    paid = who
    if isinstance(reward, rewards.RewardConfig):
        paid = f"reward={reward.name} of {reward.package}"
        with registry.telling(paid, "cannot be compiled"):
            made.hook = hook_of(registry.resolve(registry.REWARDS[reward.name].code))
    _guard(made, who, paid)
    return made


def _class(name: str, who: str) -> Callable[..., Task]:
    with registry.telling(who, "cannot be imported"):
        kind = base.factory(name)
    if not (isinstance(kind, type) and issubclass(kind, Task)):
        raise AgentError(f"{who}: its factory is no class below auvbench.tasks.base.Task")
    for needed in ("draw", "kernel"):
        if not callable(getattr(kind, needed, None)):
            raise AgentError(f"{who}: {kind.__name__} lacks {needed}, a compiled function")
    return kind


def _guard(task: Task, who: str, paid: str) -> None:
    """Check what the functions of a task return.

    Args:
        task: just made.
        who: the task, for messages.
        paid: the reward, for messages.
    """
    draw, kernel, own_metrics, records = task.draw, task.kernel, task.own_metrics, task.records
    columns = {*metrics.SHARED, *(metric.name for metric in registry.TASKS[task.name].metrics)}
    _check_parameters(task, who)

    def checked_draw(indices: Integers, F: Floats, C: Integers, P: Floats, test: int, pose: Floats) -> None:
        pose[:] = np.nan
        with registry.telling(who, "draw fails"):
            draw(indices, F, C, P, test, pose)
        finite = np.isfinite(F[indices]).all(axis=1)
        _refuse(task, who, indices, finite, "draw writes a number that is not finite")
        turned = np.abs(np.linalg.norm(pose[:, 3:], axis=1) - 1.0) < 1e-6
        good = np.isfinite(pose).all(axis=1) & turned & (C[indices, k.C_OUTCOME] == -1)
        _refuse(task, who, indices, good, "draw gives no start: begin_row must be called for each row")

    def checked_kernel(start: int, stop: int, *arguments: Any) -> int:
        with registry.telling(who, "the kernel fails"):
            ended = kernel(start, stop, *arguments)
        pose, rows, mine = arguments[0], np.arange(start, stop), slice(start, stop)
        if not np.isfinite(pose[mine]).all():
            return int(ended)  # the simulation is to blame
        _refuse(task, paid, rows, np.isfinite(task.reward[mine]), "the reward is not finite")
        finite = np.isfinite(task.F[mine]).all(axis=1)
        _refuse(task, who, rows, finite, "the kernel writes a number that is not finite")
        outcome = task.outcome[mine]
        known = (outcome >= -1) & (outcome < len(OUTCOMES))
        _refuse(task, who, rows, known, "the kernel writes an unknown outcome")
        if ended != np.count_nonzero(outcome >= 0):
            raise AgentError(
                f"{who}: the kernel returns {ended!r} ended episodes; it must be the sum of end_row"
            )
        return int(ended)

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

    replaced = {"draw": checked_draw, "kernel": checked_kernel}
    replaced |= {"own_metrics": checked_metrics, "records": checked_records}
    for name, function in replaced.items():
        setattr(task, name, function)


def _check_parameters(task: Task, who: str) -> None:
    if not np.isfinite(task.parameters).all():
        raise AgentError(f"{who}: own_parameters gives a number that is not finite")
    if k.GOAL_ERROR in task.blocks and task.own_floats < 3:
        raise AgentError(
            f"{who}: the block goal_error needs own_floats of at least 3; it is {task.own_floats}"
        )


def _refuse(task: Task, who: str, rows: Integers, good: Any, what: str) -> None:
    if not good.all():
        row = int(rows[int(np.argmin(good))])
        steps, episode = task.C[row, : k.C_EPISODE + 1].tolist()
        raise AgentError(f"{who}: {what}, in environment {row} at step {steps} of its episode {episode}")
