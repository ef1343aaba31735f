"""What tasks observe, and what they need of a vehicle. Nothing compiled is imported: a ROS 2 pilot and the check of a run read this file."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from auvbench.config import tasks
from auvbench.errors import ConfigError
from auvbench.observation import BODY, WORLD, Block, ObservationSpec
from auvbench.registry import TASKS
from auvbench.vehicles.vehicle_model import VehicleModel

CODES = {
    name: code
    for code, name in enumerate(
        (
            "yaw_error",
            "position_error",
            "velocity_error",
            "velocity",
            "angular_velocity",
            "gravity",
            "previous_action",
            "preview",
            "depth_margin",
            "goal_error",
        )
    )
}
"""The blocks that tasks may have, with their codes in `tasks.kernels`."""

FASTEST = 50.0
"""m/s and rad/s: no vehicle comes near"""


def observation_spec(
    task: tasks.Task, actuators: Sequence[str], position_bounds: Sequence[float] = (math.inf,) * 3
) -> ObservationSpec:
    """Return the observation of a task: its blocks, in their order, and older ones behind them (`task.history`).

    Args:
        task: its `observation` names the blocks; its `position_frame` is that of the position error.
        actuators: names of the vehicle's.
        position_bounds: (3,) m, largest position errors.
    """
    newest = [_block(name, task, actuators, tuple(position_bounds)) for name in tasks.blocks(task)]
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


def _block(name: str, task: tasks.Task, actuators: Sequence[str], bounds: tuple[float, ...]) -> Block:
    spec = TASKS[task.name]
    to = "reference" if spec.has_yaw else "waypoint"
    axes = BODY if task.position_frame == "body" else WORLD
    # A vector to another point than the reference may be as long as twice the way to it.
    level = 2.0 * math.hypot(*bounds[:2])
    if name == "yaw_error":
        meaning = "yaw of the reference less yaw" if spec.has_yaw else f"bearing of the {to} less yaw"
        return Block(name, (name,), "rad", (math.pi,), f"{meaning}, wrapped to [-pi, pi)")
    if name == "position_error":
        return _vector(name, "m", bounds, f"{to} less position", axes)
    if name == "velocity_error":
        return _vector(name, "m/s", (FASTEST,) * 3, "velocity of the reference less velocity", BODY)
    if name == "velocity":
        return _vector(name, "m/s", (FASTEST,) * 3, "velocity over ground", "body axes (forward, port, up)")
    if name == "angular_velocity":
        return _vector(name, "rad/s", (FASTEST,) * 3, "angular velocity", "body axes (forward, port, up)")
    if name == "gravity":
        return _vector(name, "1", (1.0,) * 3, "direction of gravity", "body axes (forward, port, up)")
    if name == "depth_margin":
        high = 2.0 * bounds[2] + task.depth_high - task.depth_low
        return Block(name, (name,), "m", (high,), "distance to the nearer depth limit; negative beyond it")
    if name == "goal_error":
        return _vector(name, "m", (level, level, 2.0 * bounds[2]), "goal less position", BODY)
    if name == "preview":
        assert isinstance(task, tasks.Tracked)
        points = range(1, task.preview.points + 1)
        # The reference moves on for the time of the preview.
        away = task.preview.points * task.preview.interval * FASTEST
        return Block(
            name,
            tuple(f"preview_{point}_{axis}" for point in points for axis in "xyz"),
            "m",
            (level + away, level + away, 2.0 * bounds[2] + away) * task.preview.points,
            f"reference in {task.preview.interval:g} s, twice that, and so on, less position",
            BODY,
        )
    assert name == "previous_action"
    return Block(
        name,
        tuple(f"previous_action_{actuator}" for actuator in actuators),
        "1",
        (1.0,) * len(actuators),
        "action of the last step; 0 at the start",
    )


def _vector(name: str, unit: str, bounds: tuple[float, ...], meaning: str, axes: str) -> Block:
    return Block(name, tuple(f"{name}_{axis}" for axis in "xyz"), unit, bounds, meaning, axes)


def check_vehicle(task: tasks.Task, vehicle: VehicleModel) -> None:
    """Refuse a task that asks for forces which a vehicle's thrusters do not give.

    Raises:
        ConfigError: names the tasks that the vehicle can do.
    """
    free = [spec.name for spec in TASKS.values() if not spec.needs_thrusters]
    controlled = vehicle.allocation[[0, 1, 2, 5]]
    if task.name not in free and np.linalg.matrix_rank(controlled, tol=1e-6) < len(controlled):
        raise ConfigError(
            f"task={task.name}: asks for thrust along x, y, z and about z, which vehicle={vehicle.name} does not have; use "
            f"task={' or '.join(free)}"
        )
