"""A batch of N environments. One `step` advances simulator, task and disturbances, and begins new episodes automatically.

An environment contains one vehicle or a team. The vehicles of a team are consecutive rows (`tasks.formation`).

The four interfaces (`gym_env`, `vector_env`, `sb3`, `parallel_env`) only translate the batch to the conventions of other libraries.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from auvbench import registry
from auvbench.config import schema
from auvbench.dynamics.compiled import compiled
from auvbench.envs.simulator_factory import make_simulator
from auvbench.errors import ActionError, ConfigError
from auvbench.record import Record
from auvbench.simulators.fossen import THREADED, FossenSimulator
from auvbench.tasks import base as tasks
from auvbench.tasks import disturbances, navigation
from auvbench.tasks.rows import SUCCESS, TIMEOUT
from auvbench.vehicles import sheet

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]


@dataclass(slots=True)
class State:
    """Poses of k vehicles and their references, without noise; world axes, m."""

    pose: Floats  # (k, 7) x, y, z, quaternion (w, x, y, z)
    reference: Floats  # (k, 3) reference positions; in the waypoint task, the waypoints
    distance: Floats  # (k,) distance from the vehicle to the reference
    force: Floats  # (k, n_u) commanded forces of the actuators in the last step, N
    key: str  # name of the reference in `info`


@dataclass(slots=True)
class Transition:
    """Result of one step of the batch. The next step overwrites the arrays: copy what you need later."""

    observation: NDArray[
        np.float32
    ]  # (n, n_obs); with `autoreset`, a row whose episode ended has the first observation of the next episode
    reward: Floats  # (n,)
    terminated: Booleans  # (n,) collision, out of bounds, or a success that ends the episode
    truncated: Booleans  # (n,) the time limit is reached
    ended: NDArray[np.int64]  # (k,) rows whose episodes ended
    final_observation: NDArray[np.float32]  # (k, n_obs) last observations of these episodes
    final_state: State  # state of these k vehicles at the end of their episodes
    records: list[Record]  # one record for each ended episode; the vehicles of a team have the same record


class Batch:
    """N environments that are advanced together.

    Args:
        config: complete configuration.
        n: number of environments, each with a vehicle or a team; None: `algo.n_envs`. The attribute `n` is the number
            of vehicles.
        seed: seed of all draws; None: `config.seed`.
        test: draw from the random streams of test protocols.
        validation: draw from the random streams of validation scenarios.
        autoreset: begin the next episode of an environment in the step that ends its episode.
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
    ) -> None:
        self.config = config
        self.team = config.task.team
        """Number of vehicles in an environment; their episodes begin and end together"""
        self.n = self.team * int(config.algo.n_envs if n is None else n)
        self.vehicle = sheet.load(config.vehicle)
        self.simulator = make_simulator(config.simulator, self.vehicle, self.n, config.disturbance)
        self.task = tasks.make(
            config,
            self.vehicle,
            self.n,
            config.seed if seed is None else seed,
            test=test,
            validation=validation,
        )
        self.disturbances = disturbances.make(config, self.vehicle, self.task)
        self.navigation = navigation.make(config, self.vehicle, self.task)
        """Navigation sensors and estimator; None if agents do not observe estimates"""
        self.autoreset = autoreset
        self.restarted: NDArray[np.float32] | None = None
        """First observations (n, n_obs) of the episodes that `load_state_dict` had to restart; None without a restart"""
        self._all = np.arange(self.n, dtype=np.int64)
        self._action: Floats = np.zeros((self.n, len(self.vehicle.actuators)))
        self._none: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._over: NDArray[np.bool_] = np.zeros(self.n, dtype=np.bool_)
        """(n,) whether the end of the row's episode was reported. Without `autoreset`, the vehicle moves on after this end,
        and no second end is reported"""
        self._nowhere = self._state(self._none)
        self._unseen = self.task.observation[:0]

    @property
    def position_bounds(self) -> Floats:
        """Largest position errors (3,) within the observation space, m."""
        return self.task.spec.bounds[self.task.spec["position_error"]].astype(np.float64)

    @property
    def acted(self) -> Floats:
        """Return the commands (n, n_u) of the last step after clipping and the filter; the next step overwrites the array."""
        return self._action

    @property
    def exact_resume(self) -> bool:
        """Return whether `load_state_dict` restores every state exactly, also within an episode."""
        return self.simulator.capabilities.exact_resume

    @property
    def state(self) -> State:
        """Return the present poses, references, distances and forces of all n vehicles; the next step overwrites the arrays."""
        task, simulator = self.task, self.simulator
        distance, force = task.distance, simulator.command_force
        return State(simulator.pose, task.reference, distance, force, task.reference_key)

    def _state(self, indices: NDArray[np.int64]) -> State:
        state = self.state
        pose, reference, distance = state.pose[indices], state.reference[indices], state.distance[indices]
        return State(pose, reference, distance, state.force[indices], state.key)

    def reseed(self, seed: int, indices: NDArray[np.int64] | None = None) -> None:
        """Start again at episode 0 with another seed, in all environments or in `indices` (k,); call `reset` next.

        Raises:
            ConfigError: the seed is not in 0 .. 2^32 - 1.
        """
        _check_seed(seed)
        self.task.reseed(seed, indices)

    def reseed_each(self, indices: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """Give each of the environments `indices` (k,) its own seed. Each then draws like a single environment with its seed.

        Raises:
            ConfigError: a seed is not in 0 .. 2^32 - 1.
        """
        for seed in seeds:
            _check_seed(seed)
        self.task.reseed_each(indices, np.asarray(seeds, dtype=np.int64))

    def reset(
        self,
        indices: NDArray[np.int64] | None = None,
        *,
        pose: Floats | None = None,
        waypoint: Floats | None = None,
        distance: Floats | None = None,
    ) -> NDArray[np.float32]:
        """Begin the next episode in all environments, or in environments `indices` (k,).

        Args:
            indices: None for all n.
            pose: (k, 7) x, y, z in m, unit quaternion (w, x, y, z) of the start; None: drawn.
            waypoint: (k, 3) x, y, z in m, for tasks with a free goal; None: drawn.
            distance: (k,) distance from the start to which the drawn waypoint is moved, m; None: the drawn distance.

        Returns:
            Observations (n, n_obs) of all environments; the next step overwrites the array.
        """
        rows = self._all if indices is None else indices
        self._reset(rows, pose, waypoint, distance)
        return self._observe(rows)

    def _reset(
        self,
        indices: NDArray[np.int64],
        pose: Floats | None = None,
        waypoint: Floats | None = None,
        distance: Floats | None = None,
    ) -> None:
        if pose is None and waypoint is None and distance is None:
            start = self.task.reset(indices)
        else:
            start = self._place(indices, pose, waypoint, distance)
        self._over[indices] = False
        scales = None if self.disturbances is None else self.disturbances.draw(indices)
        self.simulator.reset(indices, start, np.zeros((len(indices), 6)), scales)
        if self.disturbances is not None:
            self.disturbances.begin(indices, self.simulator)
        if self.navigation is not None:
            self.navigation.begin(indices, self.simulator)

    def _place(
        self,
        indices: NDArray[np.int64],
        pose: Floats | None,
        waypoint: Floats | None,
        distance: Floats | None,
    ) -> Floats:
        """Begin episodes of the task with the starts and goals given to `reset`; return the start poses (k, 7)."""
        task, before = self.task, self.task.state_dict()
        start = task.reset(indices)
        start = start if pose is None else pose
        if distance is not None:
            depths = self.config.task.depth_low, self.config.task.depth_high
            waypoint = _at(distance, start[:, :3], task.reference[indices], depths)
        option = "waypoint" if pose is None else "pose"
        try:
            task.place(indices, start, waypoint)
        except ConfigError as error:  # the world rejects a start or a goal
            task.load_state_dict(before)
            raise ConfigError(f"options['{option}']: {error}") from None
        for i in indices.tolist():
            if wrong := task.misplaced(i):
                task.load_state_dict(before)
                raise ConfigError(f"options['{option}']: {wrong}")
        return start

    def _measured(self) -> tuple[Floats, Floats]:
        """Return the poses (n, 7) and velocities (n, 6) for the observation: measurements that arrive now, or navigation's estimates."""
        if self.navigation is not None:
            return self.navigation.pose, self.navigation.velocity
        if self.disturbances is None:
            return self.simulator.pose, self.simulator.velocity
        return self.disturbances.measured(self.simulator)

    @property
    def _moved(self) -> Any:
        """Return the simulator; with navigation, a wrapper lets sensors measure in each step. A property, as `simulator` may be replaced."""
        return self.simulator if self.navigation is None else self.navigation.watched(self.simulator)

    def _observe(self, indices: NDArray[np.int64] | None = None) -> NDArray[np.float32]:
        """Return observations (n, n_obs). Range sensors measure from the true poses, also if agents observe only estimated poses."""
        seats = self.simulator.pose if self.navigation is not None else None
        return self.task.observe(*self._measured(), indices, seats)

    def step(self, action: NDArray[np.floating], begin: NDArray[np.int64] | None = None) -> Transition:
        """Advance by one agent step of 1/frequency seconds.

        Args:
            action: (n, n_u), clipped to [-1, 1].
            begin: environments (k,) that begin their next episode instead; their actions are ignored, their rewards
                are 0.

        Raises:
            ActionError: `action` has a wrong shape, a NaN or an infinity; no vehicle has moved.
        """
        count = self._compute(action)
        if begin is not None and len(begin):
            self._reset(begin)
            self._observe(begin)
            self.task.reward[begin] = 0.0
            count = int(np.count_nonzero(self.task.outcome >= 0))
        return self._conclude(count)

    def _compute(self, action: NDArray[np.floating]) -> int:
        """Compute a step up to the observation; return how many episodes ended."""
        admit(action, self._action)
        task, simulator = self.task, self.simulator
        # The compiled path is only for FossenSimulator itself, because a subclass, e.g. a plug-in's, may override any method.
        # Large batches of teams do not use it, because its threads would split a team.
        alone = self.n < THREADED or self.team == 1
        if self.disturbances is None and type(simulator) is FossenSimulator and alone:
            if self.n < THREADED:
                return task.checked(self._compute_range(0, self.n))
            counts = simulator.each(self._compute_range)
            failed = [count for count in counts if count < 0]
            return task.checked(
                max(failed) if failed else sum(counts)
            )  # if several environments failed, report the first of them
        task.protect(*self._measured(), self._action)
        command = task.add_noise(self._action)
        power = simulator.power
        if self.disturbances is None:
            self._moved.step(command, task.duration)
        else:
            self.disturbances.advance(self._moved, command)
            power = self.disturbances.power
        force = simulator.command_force
        count = task.advance(simulator.pose, simulator.velocity, self._action, force, power)
        if self.disturbances is not None:
            self.disturbances.read()
        if self.navigation is not None:
            self.navigation.conclude(self._action, force, power)
        self._observe()
        return task.checked(count)

    def _compute_range(self, start: int, stop: int) -> int:
        """Compute a step, as `_compute`, for environments start .. stop - 1 in compiled code; other threads compute the rest."""
        task, action, simulator = self.task, self._action, cast(FossenSimulator, self.simulator)
        pose, velocity = simulator.pose, simulator.velocity
        task.protect(*self._measured(), action, start, stop)
        command, navigation = task.add_noise(action, start, stop), self.navigation
        parts = 1 if navigation is None else navigation.intervals(task.duration)
        for _ in range(parts):
            simulator.advance(command, task.duration / parts, start, stop)
            if navigation is not None:
                navigation.sample(simulator, task.duration / parts, start, stop)
        force, power = simulator.command_force, simulator.power
        count = task.advance(pose, velocity, action, force, power, start, stop)
        if navigation is not None:
            navigation.conclude(action, force, power, start, stop)
        self._observe(self._all if stop - start == self.n else self._all[start:stop])
        return count

    def _conclude(self, ended_count: int) -> Transition:
        """Return the transition of a computed step in which `ended_count` episodes ended. With `autoreset`, begin the next
        episodes of their environments.
        """
        task = self.task
        observation = task.observation
        if not ended_count:
            none = np.zeros(self.n, dtype=np.bool_)
            return Transition(
                observation, task.reward, none, none, self._none, self._unseen, self._nowhere, []
            )
        outcome = task.outcome
        truncated = outcome == TIMEOUT if task.success_ends else (outcome == TIMEOUT) | (outcome == SUCCESS)
        terminated = (outcome >= 0) & ~truncated
        ended = np.flatnonzero((outcome >= 0) & ~self._over)
        records = task.records(ended)
        final = observation[ended]
        final_state = self._state(ended)
        if self.autoreset:
            self._reset(ended)
            self._observe(ended)
        else:
            self._over[ended] = True
        return Transition(observation, task.reward, terminated, truncated, ended, final, final_state, records)

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of everything that an exact resume needs, as plain arrays."""
        state = {f"task.{key}": value for key, value in self.task.state_dict().items()}
        state |= {f"simulator.{key}": value for key, value in self.simulator.state_dict().items()}
        if self.disturbances is not None:
            state |= {f"disturbances.{key}": value for key, value in self.disturbances.state_dict().items()}
        if self.navigation is not None:
            state |= {f"navigation.{key}": value for key, value in self.navigation.state_dict().items()}
        state["seed"] = np.asarray(self.task.seed, dtype=np.int64)
        return state

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Restore a state of `state_dict`. If the simulator cannot restore its state (`capabilities.exact_resume`), the
        present episodes begin again with the same draws, and `restarted` has their first observations.
        """
        self.task.seed = int(state["seed"])
        self.task.load_state_dict(_below(state, "task."))
        if self.disturbances is not None:
            self.disturbances.load_state_dict(_below(state, "disturbances."))
        if self.navigation is not None:
            self.navigation.load_state_dict(_below(state, "navigation."))
        self._over[:] = False
        if self.simulator.capabilities.exact_resume:
            self.simulator.load_state_dict(_below(state, "simulator."))
        else:
            self.task.episodes.episode -= 1
            self.restarted = self.reset().copy()


def load_compiled() -> None:
    """Load the compiled code of an environment. This takes half a second; processes forked afterwards need not repeat it."""
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config

    batch = Batch(train_config(compose("train", ["algo=pid"], folder=None)), 1)
    batch.reset()
    batch.step(np.zeros_like(batch._action))
    registry.forget_packages()  # each forked process looks for installed packages itself


def admit(action: Any, clipped: Floats) -> None:
    """Write actions (n, n_u), clipped to [-1, 1], to `clipped`.

    Raises:
        ActionError: the actions have a wrong shape or type, a NaN or an infinity.
    """
    values = np.asarray(action)
    if values.shape != clipped.shape:
        raise ActionError(
            f"an action of shape {values.shape}: must be {clipped.shape}, (environments, actuators)"
        )
    if values.dtype.kind not in "fiub":
        raise ActionError(f"an action of type {values.dtype}: must be numbers")
    # Convert all actions to the same type, so that `clip` is compiled only once.
    bad = clip(np.ascontiguousarray(values, dtype=np.float64), clipped)
    if bad >= 0:
        numbers = ", ".join(f"{value:g}" for value in values[bad])
        raise ActionError(f"the action of environment {bad} is ({numbers}): must be finite numbers")


@compiled()
def clip(action: Floats, clipped: Floats) -> int:
    """Write `action` (n, n_u), clipped to [-1, 1], to `clipped`. Return the index of the first row with a NaN or an infinity, else -1."""
    for i in range(action.shape[0]):
        for j in range(action.shape[1]):
            value = action[i, j]
            if not math.isfinite(value):
                return i
            clipped[i, j] = min(1.0, max(-1.0, value))
    return -1


def _at(distance: Floats, start: Floats, waypoint: Floats, depths: tuple[float, float]) -> Floats:
    """Return waypoints (k, 3) moved to `distance` (k,) from `start` (k, 3); a waypoint at the start moves east.

    A waypoint that would be beyond the depth limits `depths` is put at the limit, at the same distance and course.
    """
    line = waypoint - start
    length = np.linalg.norm(line, axis=1, keepdims=True)
    direction = np.where(length > 0.0, line / np.maximum(length, 1e-300), np.array([1.0, 0.0, 0.0]))
    waypoints = np.asarray(start + direction * distance[:, None])
    z = np.clip(waypoints[:, 2], *depths)
    for i in np.flatnonzero(z != waypoints[:, 2]):
        course = np.arctan2(line[i, 1], line[i, 0])
        level = np.sqrt(distance[i] ** 2 - (z[i] - start[i, 2]) ** 2)
        waypoints[i] = start[i, 0] + level * np.cos(course), start[i, 1] + level * np.sin(course), z[i]
    return waypoints


def _below(state: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {key.removeprefix(prefix): value for key, value in state.items() if key.startswith(prefix)}


def _check_seed(seed: int) -> None:
    if not 0 <= seed < 1 << 32:
        raise ConfigError(f"seed={seed}: must be at least 0 and at most {(1 << 32) - 1}")
