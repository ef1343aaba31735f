"""Define the observation of a task, and check that a vehicle has the thrust that a task needs.

This module imports no compiled code, since ROS 2 pilots and the check of a run import it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from auvbench.blocks import Setting
from auvbench.config import ranges, tasks
from auvbench.errors import AgentError, ConfigError
from auvbench.observation import BODY, WORLD, Block, ObservationSpec
from auvbench.registry import BLOCKS, TASKS, telling
from auvbench.vehicles.vehicle_model import VehicleModel


def observation_spec(
    task: tasks.Task, actuators: Sequence[str], position_bounds: Sequence[float] = (math.inf,) * 3
) -> ObservationSpec:
    """Return the observation of a task: the task's blocks in order, then the same blocks of earlier steps (`task.history`).

    Args:
        task: task with the names of the blocks (`observation`) and the frame of the position error
            (`position_frame`).
        actuators: names of the vehicle's actuators.
        position_bounds: largest position errors (3,), m.
    """
    setting = _setting(task, actuators, tuple(position_bounds))
    newest = [_described(name, setting, task) for name in tasks.blocks(task)]
    older = [
        Block(
            f"{block.name}_{age}_steps_ago",
            tuple(f"{label}_{age}_steps_ago" for label in block.labels),
            block.unit,
            block.bounds,
            f"{block.meaning}; {age} steps ago",
            block.axes,
        )
        for age in range(1, task.history)
        for block in newest
    ]
    return ObservationSpec(*newest, *older)


def owner_of_block(name: str, task: tasks.Task) -> str:
    """Return the name of a package's block in messages: `task.observation=sonar of sonars==1.0`."""
    return f"task.observation={name} of {task.block_packages[name]}"


def _described(name: str, setting: Setting, task: tasks.Task) -> Block:
    """Return labels, unit and bounds of a block; check them if the block comes from a package.

    Raises:
        AgentError: the description of a package's block is invalid.
    """
    if name not in task.block_packages:
        own = getattr(task.range, ranges.key_of(name), None) if task.range else None
        return BLOCKS[name].describe(replace(setting, sensor=own))
    owner = owner_of_block(name, task)
    with telling(owner, "describe fails"):
        block: Any = BLOCKS[name].describe(setting)
        if not isinstance(block, Block) or block.name != name:
            raise AgentError(
                f"{owner}: describe must return an auvbench.plugin.Block with the name of this block"
            )
        labels, bounds = block.labels, np.asarray(block.bounds, dtype=np.float64)
        if not labels or len(set(labels)) < len(labels) or not all(_labels(name, label) for label in labels):
            raise AgentError(f"{owner}: its labels must be different names that begin with {name}")
        if bounds.shape != (len(labels),) or not (bounds > 0.0).all():
            raise AgentError(
                f"{owner}: its bounds must be {len(labels)} positive numbers, one for each label"
            )
    return block


def _labels(name: str, label: Any) -> bool:
    """Return whether a label begins with the name of its block, as the card of a policy requires."""
    return isinstance(label, str) and (label == name or label.startswith(f"{name}_"))


def _setting(task: tasks.Task, actuators: Sequence[str], bounds: tuple[float, ...]) -> Setting:
    has_yaw = TASKS[task.name].has_yaw
    preview = task.preview if isinstance(task, tasks.Tracked) else tasks.Preview(points=0, interval=0.0)
    return Setting(
        to="reference" if has_yaw else "waypoint",
        has_yaw=has_yaw,
        axes=BODY if task.position_frame == "body" else WORLD,
        bounds=bounds,
        depths=(task.depth_low, task.depth_high),
        actuators=actuators,
        points=preview.points,
        interval=preview.interval,
        others=task.team - 1,
    )


def reads(task: tasks.Task, what: str) -> bool:
    """Return whether a block of a task's observation reads `what`, such as "velocity" or "goal" (`BlockSpec.reads`)."""
    return any(what in BLOCKS[name].reads for name in tasks.blocks(task))


def check_vehicle(task: tasks.Task, vehicle: VehicleModel) -> None:
    """Reject a task that needs forces which the vehicle's thrusters cannot give.

    Raises:
        ConfigError: the vehicle cannot do the task; the error names tasks that the vehicle can do.
    """
    free = [spec.name for spec in TASKS.values() if not spec.needs_thrusters]
    controlled = vehicle.allocation[[0, 1, 2, 5]]
    if task.name not in free and np.linalg.matrix_rank(controlled, tol=1e-6) < len(controlled):
        raise ConfigError(
            f"task={task.name}: asks for thrust along x, y, z and about z, which vehicle={vehicle.name} does not have; use "
            f"task={' or '.join(free)}"
        )
