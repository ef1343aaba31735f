"""A batch of N environments: simulator, task and disturbances under one step, with automatic reset.

The three faces (`gym_env`, `vector_env`, `sb3`) only translate between this and the interface they serve.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, simulators
from auvbench.config.disturbance import SCALES
from auvbench.errors import ConfigError, closest
from auvbench.simulators.base import Simulator
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import disturbances
from auvbench.tasks.kernels import C_EPISODE, COLLISION, SUCCESS, TIMEOUT
from auvbench.tasks.record import Record
from auvbench.tasks.waypoint import WaypointTask
from auvbench.vehicles import sheet
from auvbench.vehicles.inspect import shortest_drawn_time_constant, shortest_time_constant
from auvbench.vehicles.model import VehicleModel

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

# Position errors stay far inside; a finite bound keeps Gymnasium's checker and normalisers quiet.
POSITION_BOUND = 1e6


@dataclass(slots=True)
class Transition:
    """What one step of the batch gives. Arrays are the batch's own: copy what must outlive the next step."""

    observation: NDArray[np.float32]  # (n, 4 + n_u), already of the next episode where one ended
    reward: Floats  # (n,)
    terminated: Booleans  # (n,) success or collision
    truncated: Booleans  # (n,) timeout
    ended: NDArray[np.int64]  # indices of the episodes that ended
    final_observation: NDArray[np.float32]  # (len(ended), 4 + n_u) their last observations
    records: list[Record]  # a row for each of them


class Batch:
    """N environments.

    Args:
        config: the typed configuration.
        n: how many environments; None takes `algo.n_envs`.
        seed: of every draw; None takes `config.seed`.
        test: draw from the streams of test protocols.
        validation: draw from the streams of validation.
        autoreset: begin the next episode in the step that ended one.
        first: index of the first environment, where the batch is part of a larger one.
    """

    def __init__(
        self,
        config: schema.TrainConfig,
        n: int | None = None,
        *,
        seed: int | None = None,
        test: bool = False,
        validation: bool = False,
        autoreset: bool = True,
        first: int = 0,
    ) -> None:
        self.config = config
        self.n = int(config.algo.n_envs if n is None else n)
        self.vehicle = sheet.load(config.vehicle)
        drawn = config.disturbance.randomisation
        self.simulator = make_simulator(config.simulator, self.vehicle, self.n, drawn)
        self.task = WaypointTask(
            config,
            self.vehicle,
            self.n,
            config.seed if seed is None else seed,
            test=test,
            validation=validation,
            first=first,
        )
        self.disturbances = disturbances.make(config, self.vehicle, self.task)
        self.autoreset = autoreset
        self.restarted: NDArray[np.float32] | None = None
        """observations (n, 4 + n_u) with which `load_state_dict` began the episodes in flight again, if it had to"""
        self._all = np.arange(self.n, dtype=np.int64)
        self._action: Floats = np.zeros((self.n, len(self.vehicle.actuators)))
        self._none: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    @property
    def seed(self) -> int:
        return self.task.seed

    @property
    def exact_resume(self) -> bool:
        """Whether `load_state_dict` returns to the very state, in mid-episode."""
        return self.simulator.capabilities.exact_resume

    def reseed(self, seed: int) -> None:
        """Starts again at episode 0 with another seed; `reset` must follow.

        Raises:
            ConfigError: the seed is not in 0 .. 2^32 - 1.
        """
        if not 0 <= seed < 1 << 32:
            raise ConfigError(f"seed={seed}: must be at least 0 and at most {(1 << 32) - 1}")
        self.task.seed = int(seed)
        self.task.C[:, C_EPISODE] = -1

    def reset(self) -> NDArray[np.float32]:
        """Begins the next episode everywhere; observations (n, 4 + n_u)."""
        self._reset(self._all)
        return self.task.observe(self._measured())

    def _reset(self, indices: NDArray[np.int64]) -> None:
        pose = self.task.reset(indices)
        scales = None if self.disturbances is None else self.disturbances.draw(indices)
        self.simulator.reset(indices, pose, np.zeros((len(indices), 6)), scales)
        if self.disturbances is not None:
            self.disturbances.begin(indices, self.simulator)

    def _measured(self) -> Floats:
        return (
            self.simulator.pose if self.disturbances is None else self.disturbances.measured(self.simulator)
        )

    def step(self, action: NDArray[np.floating]) -> Transition:
        """One agent step of 1/frequency seconds for actions (n, n_u), clipped to [-1, 1]."""
        return self._conclude(self._compute(action))

    def _compute(self, action: NDArray[np.floating]) -> int:
        """Everything up to the observation; returns how many episodes ended."""
        np.clip(action, -1.0, 1.0, out=self._action)
        task, simulator = self.task, self.simulator
        command = task.add_noise(self._action)
        power = simulator.power
        if self.disturbances is None:
            simulator.step(command, task.duration)
        else:
            self.disturbances.advance(simulator, command)
            power = self.disturbances.power
        ended_count = task.advance(simulator.pose, self._action, simulator.command_force, power)
        if self.disturbances is not None:
            self.disturbances.read()
        task.observe(self._measured())
        return ended_count

    def _conclude(self, ended_count: int) -> Transition:
        """The transition of a step that is computed, and the next episode where one of `ended_count` ended."""
        task = self.task
        observation = task.observation
        if not ended_count:
            none = np.zeros(self.n, dtype=np.bool_)
            return Transition(observation, task.reward, none, none, self._none, observation[:0], [])
        outcome = task.outcome
        terminated = (outcome == SUCCESS) | (outcome == COLLISION)
        truncated = outcome == TIMEOUT
        ended = np.flatnonzero(outcome >= 0)
        records = task.records(ended)
        final = observation[ended]
        if self.autoreset:
            self._reset(ended)
            task.observe(self._measured(), ended)
        return Transition(observation, task.reward, terminated, truncated, ended, final, records)

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Copies of everything that an exact resume needs, as plain arrays."""
        state = {f"task.{key}": value for key, value in self.task.state_dict().items()}
        state |= {f"simulator.{key}": value for key, value in self.simulator.state_dict().items()}
        if self.disturbances is not None:
            state |= {f"disturbances.{key}": value for key, value in self.disturbances.state_dict().items()}
        state["seed"] = np.asarray(self.seed, dtype=np.int64)
        return state

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Returns to a state that `state_dict` gave.

        Where the simulator cannot (`capabilities.exact_resume`), the episodes that were in flight begin again with
        the same draws, and `restarted` holds their first observations.
        """
        self.task.seed = int(state["seed"])
        self.task.load_state_dict(_below(state, "task."))
        if self.disturbances is not None:
            self.disturbances.load_state_dict(_below(state, "disturbances."))
        if self.simulator.capabilities.exact_resume:
            self.simulator.load_state_dict(_below(state, "simulator."))
        else:
            self.task.C[:, C_EPISODE] -= 1
            self.restarted = self.reset().copy()


def _below(state: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {key.removeprefix(prefix): value for key, value in state.items() if key.startswith(prefix)}


def make_simulator(
    config: simulators.Simulator,
    vehicle: VehicleModel,
    n: int,
    drawn: schema.Randomisation | None = None,
) -> Simulator:
    """The simulator that the configuration names.

    Its step is no longer than the shortest time constant of any vehicle that may be drawn, whatever the configuration
    allows. RK4 would be stable up to 2.78 of them: the rest is for currents and what turns faster than thrust alone
    makes it.

    Args:
        config: which simulator, and its longest step.
        vehicle: the sheet's.
        n: how many vehicles.
        drawn: the ranges from which vehicles are drawn; None where all are the sheet's.
    """
    limit = _shortest_time_constant(vehicle, drawn)
    if isinstance(config, simulators.Fossen):
        return FossenSimulator(vehicle, n, max_step=min(config.max_step, limit))
    if isinstance(config, simulators.Gazebo):
        from auvbench.simulators.gazebo.simulator import GazeboSimulator

        step = min(config.max_step, limit)
        return GazeboSimulator(vehicle, n, max_step=step, hydrodynamics=config.hydrodynamics)
    raise ConfigError(
        f"simulator.name={config.name}: unknown; {closest(config.name, simulators.CAPABILITIES)}"
    )


def _shortest_time_constant(vehicle: VehicleModel, drawn: schema.Randomisation | None) -> float:
    ranges = {name: getattr(drawn, name) for name in SCALES} if drawn is not None else {}
    factors = {name: (scale.low, scale.high) for name, scale in ranges.items()}
    if drawn is None or all(pair == (1.0, 1.0) for pair in factors.values()):
        return shortest_time_constant(vehicle)
    return shortest_drawn_time_constant(vehicle, factors, keep_trim=drawn.keep_trim)


def at_frequency(config: schema.TrainConfig, frequency: float) -> schema.TrainConfig:
    """The same configuration with another agent step."""
    return dataclasses.replace(config, step=dataclasses.replace(config.step, frequency=frequency))


def observation_bounds(n_u: int) -> NDArray[np.float32]:
    """Upper bounds (4 + n_u,) of the observation: yaw error, position error, previous action."""
    return np.array([np.pi, *[POSITION_BOUND] * 3, *[1.0] * n_u], dtype=np.float32)
