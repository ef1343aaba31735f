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

If the task observes the nearest solids (`solids`), the targets are points on the shortest way past the solids
(`avoiding.Avoidance.way`): a vehicle at 0.7 of the largest speed reaches each point at the time of its node. Each node with too small a
clearance also has the cost c |clearance wanted - clearance|^2, linearised about the plan. If the targets were not on this way, the
cost would stop plans in front of flat faces. If the task observes the shortest way (`way`), the target of all nodes is the point of the way that the
observation shows.

A failed solve keeps the plan of the previous step, advanced by one step. Failures are counted, and so are
solves that took longer than the agent's step (a simulation waits for them; a vehicle would not).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Integers
from auvbench.agents.classical.avoiding import Avoidance
from auvbench.agents.classical.observer import turned
from auvbench.agents.classical.planner import FIRST_ITERATIONS, Planner
from auvbench.agents.classical.shooting import Program
from auvbench.config import schema
from auvbench.config.algorithms.mpc import MPC
from auvbench.dynamics import frames
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.curves import Lag
from auvbench.vehicles.inspect import terminal_speed
from auvbench.vehicles.symbolic import RIGID, symbolic
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

# Plans neglect the thrusters' lags if each mean delay is below this share of the agent's step; the filter never neglects them.
# The states of the lags would double the time of a solve.
PROMPT = 0.25
CRUISE = 0.7
"""speed at which plans follow a way among solids, as a share of the largest speed"""
PLANNED = ("X", "U", "depth", "applied")
"""arrays that a plan carries from step to step"""


class MPCController(Planner):
    """Controller by nonlinear model predictive control; see `Planner`."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, MPC)
        super().__init__(config, vehicle)
        model = symbolic(vehicle)
        prompt = model.n_x > RIGID and all(unit.lag.delay < PROMPT * self.dt for unit in vehicle.units)
        spec = observation_spec(config.task, vehicle.actuators)
        self._way = spec["way"] if "way" in spec.blocks else None
        self.avoidance = Avoidance(config, vehicle, spec["solids"]) if "solids" in spec.blocks else None
        self.program = Program(symbolic(without_lags(vehicle)) if prompt else model, algo, self.avoidance)
        times = self.program.interval * np.arange(1, self.program.N + 1)
        self.lengths: Floats = np.asarray(CRUISE * algo.effort * largest_speed(vehicle) * times)
        """(N,) distance in m, along the way past solids, from the start of the way to each node's target"""
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        self.plans = [self.program.rest() for _ in episodes]

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Observer.memory` with the plans."""
        # All plans share one array with a row for each plan, so that a write into a row changes the plan.
        planned: dict[str, NDArray[Any]] = {}
        for name in PLANNED:
            rows = np.array([getattr(plan, name) for plan in self.plans])
            for plan, row in zip(self.plans, rows, strict=True):
                setattr(plan, name, row)
            planned[name] = rows
        return {**self.observer.memory(), **planned}

    def plan(self, i: int, first: bool, reading: Floats) -> Floats:
        plan = self.plans[i]
        state, current = self.observer.state[i, : self.program.model.n_x], self.observer.current[i]
        if first:
            plan.depth[:] = self.room + self.observer.state[i, 2]
        else:
            plan.advance(self.dt / self.program.interval)
        plan.reference = self.observer.reference(i, self.program.interval, self.program.N)
        if self._way is not None:
            plan.reference[:] = state[:3] + turned(reading[self._way], float(frames.yaw(state[3:7])))
        if self.avoidance is not None:
            plan.solids = self.avoidance.solids(reading, state[:3], float(frames.yaw(state[3:7])))
            if len(plan.solids):
                goal = self.observer.reference(i, self.program.interval, 1)[0]
                plan.reference = self.avoidance.way(plan.solids, state[:3], goal, self.lengths)
        plan.yaw = self.observer.yaw_target[i] if self.turns else None
        for _ in range(FIRST_ITERATIONS if first else 1):
            if first:
                self.program.simulate(plan, state, current)
            self.failed += not self.program.improve(plan, state, current)
        return self.vehicle.action(plan.U[:, 0])

    def notes(self) -> dict[str, int]:
        """Return counters since the creation: steps, failed solves, and steps whose solve took longer than
        the agent's step.
        """
        return {"solves": self.planned, "failed_solves": self.failed, "late_solves": self.late}


def largest_speed(vehicle: VehicleModel) -> float:
    """Return the speed in m/s along x at which the drag is as large as the largest thrust."""
    thrust = float((vehicle.allocation[0, :, None] * vehicle.force_limits).max(axis=1).sum())
    return terminal_speed(thrust, float(vehicle.linear_damping[0]), float(vehicle.quadratic_damping[0]))


def without_lags(vehicle: VehicleModel) -> VehicleModel:
    """Return the vehicle with actuators that have no lag."""
    return replace(vehicle, units=tuple(replace(unit, lag=Lag.none()) for unit in vehicle.units))
