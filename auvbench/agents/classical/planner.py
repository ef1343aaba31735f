"""Common loop of the planning controllers (MPC, MPPI): improve the plan of each vehicle at each step."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical.observer import Observer
from auvbench.config import schema
from auvbench.errors import ConfigError
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.symbolic import symbolic
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

# smallest distance in m of a plan from the depth limits
DEPTH_MARGIN = 0.7
# Iterations at the beginning of an episode, from a plan without thrust; later steps take one iteration each.
FIRST_ITERATIONS = 8


class Planner:
    """Controller of position, and of yaw if the task prescribes a yaw, for vehicles with only thrusters.

    A subclass stores the plans; its method `plan` improves the plan of one vehicle.

    Attributes:
        row_by_row: True: the controller computes the actions of a batch one row after the other, so a test divides its
            episodes among processes.

    Raises:
        ConfigError: the vehicle has other actuators than thrusters, or the task shows obstacles only by a range sensor.
        MissingExtraError: CasADi, which the filter needs, is not installed.
    """

    row_by_row = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        refuse_ranges(config, vehicle)
        self.vehicle = vehicle
        self.observer = Observer(symbolic(vehicle), config)
        self.dt = 1.0 / config.step.frequency
        self.turns = TASKS[config.task.name].has_yaw
        self.room = room(config.task)
        self.planned = self.failed = self.late = 0
        """counters since the creation: plans, plans that could not be improved, and plans that took longer than the agent's step"""

    def reset(self, episodes: Integers) -> None:
        self.observer.reset(len(episodes))
        self.running = np.arange(len(episodes))

    def ended(self, rows: NDArray[np.intp]) -> None:
        """Stop computing actions for episodes that have ended."""
        self.running = np.setdiff1d(self.running, rows)

    def act(self, observation: Observations) -> Actions:
        readings = observation.astype(np.float64)
        first = self.observer.first.copy()
        self.observer.update(readings, self.running)
        action = np.zeros((len(observation), len(self.vehicle.units)))
        for i in self.running:
            begun = time.perf_counter()
            action[i] = self.plan(int(i), bool(first[i]), readings[i])
            self.late += time.perf_counter() - begun > self.dt
            self.planned += 1
        return action

    def plan(self, i: int, first: bool, reading: Floats) -> Floats:
        """Improve row i's plan, and return its first action (n_u,).

        Args:
            i: row of the batch.
            first: whether this is the first step of the episode.
            reading: (n_obs,) observation, which the observer has processed.
        """
        raise NotImplementedError


def refuse_ranges(config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Raise ConfigError for a task that shows obstacles only by a range sensor, which no planner reads."""
    blocks = observation_spec(config.task, vehicle.actuators).blocks
    unread = [block for block in blocks if block.startswith("range.")]
    if unread and not {"solids", "way"} & set(blocks):
        raise ConfigError(
            f"algo={config.algo.name}: does not read {unread[0]} of task={config.task.name}; it reads solids only from "
            "the blocks solids and way; use task=transit_solids or task=transit_map"
        )


def room(task: Any) -> Floats:
    """Return how far plans may go down (negative) and up from the start of the episode, in m: (2,).

    The result is infinite if the task does not fix the depth of the start, because the depth is then unknown.
    """
    start, far = (task.start[2], 0.0) if TASKS[task.name].fixed_start else (0.0, math.inf)
    low, high = task.depth_low + DEPTH_MARGIN - far, task.depth_high - DEPTH_MARGIN + far
    return np.array([low, high]) - start
