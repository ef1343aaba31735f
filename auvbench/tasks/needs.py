"""What a task needs of a vehicle. Apart from the tasks, so that checking a run imports no compiler."""

from __future__ import annotations

import numpy as np

from auvbench.config import tasks
from auvbench.errors import ConfigError
from auvbench.vehicles.vehicle_model import VehicleModel


def check_vehicle(task: tasks.Task, vehicle: VehicleModel) -> None:
    """Refuse a task that asks for forces which a vehicle's thrusters do not give.

    Raises:
        ConfigError: names the tasks that the vehicle can do.
    """
    free = [spec.name for spec in tasks.TASKS.values() if not spec.needs_thrusters]
    controlled = vehicle.allocation[[0, 1, 2, 5]]
    if task.name not in free and np.linalg.matrix_rank(controlled, tol=1e-6) < len(controlled):
        raise ConfigError(
            f"task={task.name}: asks for thrust along x, y, z and about z, which vehicle={vehicle.name} does not have; use "
            f"task={' or '.join(free)}"
        )
