"""Navigation sensors and estimators (docs/navigation.md): each file has the functions of one sensor or estimator, for one episode.

In these functions `e` is the record of an episode, `d` the record of its sensors and its estimate (`state.FIELDS`), `p` the parameters
(`state.parameters`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from auvbench.config.navigation import is_estimated

if TYPE_CHECKING:
    from auvbench.config import schema
    from auvbench.tasks.base import Task
    from auvbench.tasks.navigation.estimator import Navigation
    from auvbench.vehicles.vehicle_model import VehicleModel


def make(config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> Navigation | None:
    """Return the navigation of a task's episodes; None if agents know their vehicles' true motion."""
    if not is_estimated(config):
        return None
    from auvbench.tasks.navigation.estimator import Navigation  # with all sensors and filters

    return Navigation(config, vehicle, task)
