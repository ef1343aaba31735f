"""Control by model predictive path integral control (MPPI) with the simulator's own equations.

Each step advances the previous plan in time, samples plans about it, simulates the samples, and takes their weighted mean as the new plan
(Williams et al. 2018, "Information-theoretic model predictive control: theory and applications to autonomous driving", IEEE Transactions
on Robotics 34(6), algorithm 2). The cost of a sample is the same as in `mpc.py`:

    sum_k w_k |p_k - target_k| + v |yaw_k - yaw target|^2 + t |tilt_k|^2 + |R u_k|^2 + |S (u_k - u_(k-1))|^2 + q |(p_k, q_k)|^2

plus a cost per metre beyond the depth limits. If the task observes the shortest way (`way`), the target is the point of the way that the
observation shows. If the task observes the nearest solids (`solids`), `avoiding` adds a cost for too small a clearance. `sampling` computes
the draws, the cost and the weights. The model is the sheet's vehicle; the state and the current come from `observer.Observer`, that is,
from the noisy readings. The states of the thrusters' lags follow from the observed actions.

The draws are a function of the run's seed, the episode and the step. If no sample has a finite cost, the plan stays, and the failure is
counted. Plans that took longer than the agent's step are counted too (a simulation waits for them; a vehicle would not).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Integers
from auvbench.agents.classical.avoiding import Avoidance
from auvbench.agents.classical.observer import turned
from auvbench.agents.classical.planner import FIRST_ITERATIONS, Planner
from auvbench.agents.classical.sampling import AIM, NODES, Sampler
from auvbench.config import schema
from auvbench.config.algorithms.mppi import MPPI
from auvbench.dynamics import frames
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.symbolic import RIGID
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class MPPIController(Planner):
    """Controller by model predictive path integral control; see `Planner`."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, MPPI)
        super().__init__(config, vehicle)
        self.seed = config.seed
        spec = observation_spec(config.task, vehicle.actuators)
        self.avoidance = Avoidance(config, vehicle, spec["solids"]) if "solids" in spec.blocks else None
        self.sampler = Sampler(vehicle, algo, self.turns, self.avoidance)
        self.lags = FossenSimulator(vehicle, 1, max_step=self.dt)
        """simulator of one vehicle that computes the actuators' states from the observed actions"""
        self._previous, self._way = spec["previous_action"], spec["way"] if "way" in spec.blocks else None
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        n, n_u = len(episodes), len(self.vehicle.units)
        self.episodes: Integers = np.array(episodes, dtype=np.int64)
        self.steps = np.zeros(n, dtype=np.int64)
        self.plans: Floats = np.zeros((n, NODES, n_u))
        """(n, NODES, n_u) thrusts in N"""
        self.actuators: Floats = np.zeros((n, self.lags.actuators.shape[1]))
        """(n, n_actuator_states) estimated states of the actuators"""
        self.depth: Floats = np.zeros((n, 2))
        """(n, 2) allowed range of z, in m above the waypoint"""

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Observer.memory` with the plans and the counters on which their draws depend."""
        carried = ("episodes", "steps", "plans", "actuators", "depth")
        return {**self.observer.memory(), **{name: getattr(self, name) for name in carried}}

    def plan(self, i: int, first: bool, reading: Floats) -> Floats:
        plan, state, previous = self.plans[i], self.observer.state[i, :RIGID], reading[self._previous]
        if first:
            self.depth[i] = self.room + state[2]
        else:
            share = min(self.dt / self.sampler.interval, 1.0)
            plan[:-1] += share * (plan[1:] - plan[:-1])
        self._follow_lags(i, first, previous)
        key, applied = (self.seed, int(self.episodes[i]), int(self.steps[i])), self.vehicle.force(previous)
        start = state, self.actuators[i], self.observer.current[i], applied, self._aims(i, reading)
        if self.avoidance is not None:
            self.sampler.solids = self.avoidance.solids(reading, state[:3], float(frames.yaw(state[3:7])))
        for iteration in range(FIRST_ITERATIONS if first else 1):
            self.failed += not self.sampler.improve(plan, *start, (*key, iteration))
        self.steps[i] += 1
        return self.vehicle.action(plan[0])

    def _follow_lags(self, i: int, first: bool, previous: Floats) -> None:
        """Simulate the actuators of row i for one step with the previous action (n_u,)."""
        lags = self.lags
        lags.reset(np.array([0]), [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], np.zeros(6))
        if not first:
            lags.actuators[0] = self.actuators[i]
            lags.step(previous[None], self.dt)
        self.actuators[i] = lags.actuators[0]

    def _aims(self, i: int, reading: Floats) -> Floats:
        """Return the targets of row i's vehicle at the nodes, (NODES, 7), records of type `sampling.AIM` viewed as floats."""
        observer = self.observer
        aims = np.zeros(NODES, AIM)
        if self._way is None:
            aims["position"] = observer.reference(i, self.sampler.interval, NODES)
        else:
            state = observer.state[i]
            aims["position"] = state[:3] + turned(reading[self._way], float(frames.yaw(state[3:7])))
        yaw = observer.yaw_target[i]
        aims["course"] = np.cos(yaw), np.sin(yaw)
        aims["low"], aims["high"] = self.depth[i]
        return aims.view(np.float64).reshape(NODES, -1)

    def notes(self) -> dict[str, int]:
        """Return counters since the creation: steps, plans without a finite sample, and steps whose plan took longer
        than the agent's step.
        """
        return {"plans": self.planned, "failed_plans": self.failed, "late_plans": self.late}
