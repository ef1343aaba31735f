"""Control by nonlinear model predictive control with the vehicle's own equations: real-time iterations of
multiple shooting.

At each step one Gauss-Newton iteration (Diehl et al. 2005, "A real-time iteration scheme for nonlinear optimization in
optimal feedback control") of

    min  sum_k w_k |p_k - target_k| + v |yaw_k - yaw target|^2 + t |tilt_k|^2 + |R u_k|^2 + |S (u_k - u_(k-1))|^2 + q |(p_k, q_k)|^2
    s.t. x_(k+1) = F(x_k, u_k),  u_min <= u_k <= u_max,  depth limits (soft; waypoint task)

over the thrusts u of a horizon, constant in blocks that grow with time. States at the nodes are variables
(multiple shooting); they are condensed out of the quadratic programme, which DAQP solves (Arnström et al.
2022, a dual active-set method). The model has the thrusters' lags unless they are short; the state comes from `observer.Observer`,
that is, from the noisy readings.

A failed solve keeps the plan of the previous step, advanced by one step. Failures are counted, and so are
solves that took longer than the agent's step (a simulation waits for them; a vehicle would not).
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical.observer import Observer
from auvbench.agents.classical.shooting import Program
from auvbench.config import schema
from auvbench.config.algorithms.mpc import MPC
from auvbench.registry import TASKS
from auvbench.vehicles.curves import Lag
from auvbench.vehicles.symbolic import RIGID, symbolic
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

# distance in m between a plan and the depth limits
DEPTH_MARGIN = 0.7
# Thrusters whose mean delays are a smaller share of the agent's step act at once in plans, not in the filter: their
# states would double the time of a solve.
PROMPT = 0.25
# Iterations at the beginning of an episode, from a plan without thrust; later steps take one iteration each.
FIRST_ITERATIONS = 8


PLANNED = ("X", "U", "depth", "applied")
"""arrays that a plan carries from step to step"""


class MPCController:
    """Controller of position, and of yaw if the task has its own yaw, for vehicles with only thrusters.

    Attributes:
        row_by_row: a batch does not make an action faster, so processes share the episodes of a test.

    Raises:
        ConfigError: the vehicle has other actuators than thrusters.
        MissingExtraError: CasADi is not installed.
    """

    row_by_row = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, MPC)
        self.vehicle = vehicle
        model = symbolic(vehicle)
        self.observer = Observer(model, config)
        self.dt = 1.0 / config.step.frequency
        task = config.task
        prompt = model.n_x > RIGID and all(unit.lag.delay < PROMPT * self.dt for unit in vehicle.units)
        self.program = Program(symbolic(without_lags(vehicle)) if prompt else model, algo)
        self.room = room(task)
        self.turns = TASKS[task.name].has_yaw
        self.solves = self.failed = self.late = 0
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        n = len(episodes)
        self.observer.reset(n)
        self.plans = [self.program.rest() for _ in range(n)]
        self.running = np.arange(n)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Observer.memory` with the plans."""
        # One array for all plans, with a row for each: writing into a row changes the plan.
        planned: dict[str, NDArray[Any]] = {}
        for name in PLANNED:
            rows = np.array([getattr(plan, name) for plan in self.plans])
            for plan, row in zip(self.plans, rows, strict=True):
                setattr(plan, name, row)
            planned[name] = rows
        return {**self.observer.memory(), **planned}

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
            plan = self.plans[i]
            state, current = self.observer.state[i, : self.program.model.n_x], self.observer.current[i]
            if first[i]:
                plan.depth[:] = self.room + self.observer.state[i, 2]
            else:
                plan.advance(self.dt / self.program.interval)
            plan.reference = self.observer.reference(int(i), self.program.interval, self.program.N)
            plan.yaw = self.observer.yaw_target[i] if self.turns else None
            for _ in range(FIRST_ITERATIONS if first[i] else 1):
                if first[i]:
                    self.program.simulate(plan, state, current)
                self.failed += not self.program.improve(plan, state, current)
            action[i] = self.vehicle.action(plan.U[:, 0])
            taken = time.perf_counter() - begun
            self.late += taken > self.dt
            self.solves += 1
        return action

    def notes(self) -> dict[str, int]:
        """Return counters since the creation: steps, failed solves, and steps whose solve took longer than
        the agent's step.
        """
        return {"solves": self.solves, "failed_solves": self.failed, "late_solves": self.late}


def room(task: Any) -> Floats:
    """Return how far plans may go down (negative) and up from the start, (2,) m; infinite if the depth is unknown.

    If the task fixes the depth at the start, the first reading gives the depth of the waypoint.
    """
    start, far = (task.start[2], 0.0) if TASKS[task.name].fixed_start else (0.0, math.inf)
    low, high = task.depth_low + DEPTH_MARGIN - far, task.depth_high - DEPTH_MARGIN + far
    return np.array([low, high]) - start


def without_lags(vehicle: VehicleModel) -> VehicleModel:
    """Return a vehicle whose actuators act at once."""
    return replace(vehicle, units=tuple(replace(unit, lag=Lag.none()) for unit in vehicle.units))
