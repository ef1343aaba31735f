"""What a task is: N episodes of it, with start states, references, rewards, ends and records.

The task of a file in this folder declares two compiled functions, `draw` and `kernel`, its parameters and its metrics.
Everything else is here: command noise, readings, observation, records, resets, and the state that an exact resume needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from auvbench import metrics
from auvbench.config import rewards, schema, tasks
from auvbench.dynamics import frames
from auvbench.dynamics.random import TEST, VALIDATION
from auvbench.errors import TrainingError
from auvbench.metrics import Totals
from auvbench.observation import ObservationSpec
from auvbench.record import OUTCOMES, Record, record_of
from auvbench.registry import REWARDS, TASKS, resolve
from auvbench.tasks import kernels as k
from auvbench.tasks.bounds import bounded_spec, start_bounds
from auvbench.tasks.observation import CODES, check_vehicle
from auvbench.tasks.rewards import FOREIGN
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_STATE = ("F", "C", "previous", "offset", "observation")


class Task:
    """State of N episodes of a task.

    Args:
        seed: of all draws, 0 .. 2^32 - 1.
        test: draw from the streams of tests, which no training uses.
        validation: draw from the streams of validation, which neither training nor tests use.
    """

    draw: ClassVar[Callable[..., None]]
    """`draw(indices, F, C, P, stream, pose)`: begins episodes; writes their start poses (len(indices), 7)"""
    kernel: ClassVar[Callable[..., int]]
    """`kernel(start, stop, pose, velocity, action, previous, force, power, F, C, P, reward, hook)`: computes reward, ends
    and sums of environments start .. stop - 1 after one agent step; returns how many episodes ended (-1 - i: pose i is
    not finite). It hands `hook` to `rewards.reward_row`"""
    own_floats: ClassVar[int] = 0
    """columns of F from F_OWN on"""
    success_ends: ClassVar[bool] = True
    """whether success ends the episode for good; otherwise it is a property of a whole episode, which then times out"""
    reference_columns: ClassVar[tuple[str, ...]] = ()
    """columns of a record that a fingerprint covers (`evaluation.reference`); empty: all that the task has. Where they are
    declared, a new metric leaves the fingerprints of published results valid."""
    reference_blocks: ClassVar[tuple[str, ...]] = ()
    """blocks of an observation that a fingerprint covers; empty: all that the task has"""
    reference_key: ClassVar[str] = "reference"
    """of the reference in `info`"""

    def __init__(
        self,
        config: schema.TrainConfig,
        vehicle: VehicleModel,
        n: int,
        seed: int,
        *,
        test: bool = False,
        validation: bool = False,
    ) -> None:
        self.vehicle = vehicle
        self.n = n
        self.name = config.task.name
        self.frequency = config.step.frequency
        self.noise_scale = _command_noise_scale(config.noise, vehicle)
        n_u = len(vehicle.actuators)
        self.spec: ObservationSpec = bounded_spec(config, vehicle)
        """of the observation"""
        self.reach = start_bounds(config, vehicle)
        """(3,) m, largest position errors with which an episode may begin"""
        self.limits = _limits(config)
        """what the errors of a failed episode count as, by the `failed` of their metrics"""
        self.blocks = np.array([CODES[name] for name in tasks.blocks(config.task)], dtype=np.int64)
        self.reads_velocity = bool(
            {"velocity", "angular_velocity", "velocity_error"} & {*tasks.blocks(config.task)}
        )
        """whether the observation has more of a vehicle than its pose"""
        preview = config.task.preview.points if isinstance(config.task, tasks.Tracked) else 0
        columns = k.F_OWN + self.own_floats if isinstance(config.task, tasks.Tracked) else k.N_FLOATS
        self.parameters = self._parameters(config, columns, preview)
        self.duration = float(self.parameters[k.P_DURATION])
        """simulated seconds of one agent step"""
        self.F: Floats = np.zeros((n, columns + 3 * preview))
        self.C: Integers = np.zeros((n, k.N_INTEGERS), dtype=np.int64)
        self.hook: Any = None
        """the reward of an installed package (`rewards.hook_of`)"""
        self.seed = int(seed)
        self.reseed(seed)
        self.previous: Floats = np.zeros((n, n_u))
        self.offset: Floats = np.zeros((n, 4))
        """errors of the position (m) and yaw (rad) readings: bias, drift, noise (see disturbances)"""
        self.reward: Floats = np.zeros(n)
        self.command: Floats = np.zeros((n, n_u))
        self.observation = np.zeros((n, self.spec.size), dtype=np.float32)
        self._all = np.arange(n)
        self.stream = VALIDATION if validation else TEST if test else 0
        """flag of the streams of random numbers: 0, TEST or VALIDATION"""

    def own_parameters(self, task: Any) -> list[float]:
        """Return the task's entries of P from P_OWN on."""
        raise NotImplementedError

    def own_metrics(self, i: int) -> dict[str, float]:
        """Return the task's own columns of the record of environment i, whose episode has ended."""
        return {}

    def _parameters(self, config: schema.TrainConfig, preview: int, previewed: int) -> Floats:
        task, noise = config.task, config.noise
        own = self.own_parameters(task)
        P = np.zeros(k.P_OWN + len(own))
        P[k.P_DEPTH_LOW], P[k.P_DEPTH_HIGH] = task.depth_low, task.depth_high
        P[k.P_MAX_STEPS] = schema.step_limit(task, config.step.frequency)
        P[k.P_DURATION] = 1.0 / config.step.frequency
        P[k.P_BODY_FRAME] = task.position_frame == "body"
        P[k.P_POSITION_LOW : k.P_POSITION_HIGH + 1] = noise.position.low, noise.position.high
        P[k.P_YAW_LOW : k.P_YAW_HIGH + 1] = noise.yaw.low, noise.yaw.high
        P[k.P_COMMAND_LOW : k.P_COMMAND_HIGH + 1] = noise.command.low, noise.command.high
        P[k.P_POSITION_LOW : k.P_COMMAND_HIGH + 1] *= noise.scale
        P[k.P_BOTH_SIGNS] = noise.sign == "both"
        P[k.P_YAW] = TASKS[task.name].has_yaw
        P[k.P_PREVIEW], P[k.P_PREVIEWED] = preview, previewed
        P[k.P_HISTORY] = task.history
        name = config.reward.name
        P[k.P_REWARD] = REWARDS.own.index(name) if name in REWARDS.own else FOREIGN
        values = rewards.parameters(config.reward)
        P[k.P_REWARD_OWN : k.P_REWARD_OWN + len(values)] = values
        P[k.P_OWN :] = own
        return P

    @property
    def outcome(self) -> Integers:
        """(n,) -1 while an episode is under way, else an index into OUTCOMES."""
        return self.C[:, k.C_OUTCOME]

    @property
    def reference(self) -> Floats:
        """(n, 3) m: where the vehicles are to be now; for the waypoint task its waypoint."""
        return self.F[:, k.F_REFERENCE : k.F_REFERENCE + 3]

    def reseed(self, seed: int, indices: Integers | None = None) -> None:
        """Put environments, all or some, before episode 0 of a seed; environment i draws from (seed, i)."""
        rows = np.arange(self.n) if indices is None else indices
        if len(rows) == self.n:
            self.seed = int(seed)
        self.C[rows, k.C_SEED] = seed
        self.C[rows, k.C_ENVIRONMENT] = rows
        self.C[rows, k.C_EPISODE] = -1

    def reseed_each(self, indices: Integers, seeds: Integers) -> None:
        """Put environments `indices` (k,) before episode 0 of seeds (k,) of their own, as environment 0 of each."""
        self.C[indices, k.C_SEED] = seeds
        self.C[indices, k.C_ENVIRONMENT] = 0
        self.C[indices, k.C_EPISODE] = -1

    def assign(self, episodes: Integers, environment: int = 0) -> None:
        """Make row i the scenario of episode `episodes[i]` at its next reset (test protocols)."""
        self.C[:, k.C_EPISODE] = np.asarray(episodes) - 1
        self.C[:, k.C_ENVIRONMENT] = environment

    def reset(self, indices: Integers) -> Floats:
        """Begin the next episode of the given environments; return their start poses (len, 7)."""
        self.C[indices, k.C_EPISODE] += 1
        self.previous[indices] = 0.0
        self.offset[indices] = 0.0
        pose = np.empty((len(indices), 7))
        self.draw(indices, self.F, self.C, self.parameters, self.stream, pose)
        return pose

    def place(self, indices: Integers, pose: Floats) -> None:
        """Replace the drawn start poses (k, 7) of environments that were just reset."""
        F, P = self.F, self.parameters
        F[indices, k.F_START : k.F_START + 3] = F[indices, k.F_POSITION : k.F_POSITION + 3] = pose[:, :3]
        F[indices, k.F_START_YAW] = frames.yaw(pose[:, 3:])
        self.refer(indices)
        distance = np.linalg.norm(self.reference[indices] - pose[:, :3], axis=1)
        F[indices, k.F_DISTANCE] = F[indices, k.F_INITIAL_DISTANCE] = distance
        depth = pose[:, 2]
        F[indices, k.F_DEPTH_MARGIN] = np.minimum(P[k.P_DEPTH_HIGH] - depth, depth - P[k.P_DEPTH_LOW])

    def refer(self, indices: Integers) -> None:
        """Write the references of environments that begin at F_START, where a reference depends on the place."""

    def misplaced(self, i: int) -> str:
        """Return why environment i cannot begin where it was placed, and what is valid; empty if it can."""
        error = np.abs(self.reference[i] - self.F[i, k.F_START : k.F_START + 3])
        if self.parameters[k.P_BODY_FRAME]:
            error[:2] = np.hypot(error[0], error[1])
        if (error <= self.reach).all():
            return ""
        away, most = (", ".join(f"{value:g}" for value in values) for values in (error, self.reach))
        return f"is ({away}) m from the {self.reference_key}; must be at most ({most}) m"

    # Each of these does it for the environments start .. stop - 1, by default all; threads share the environments.

    def add_noise(self, action: Floats, start: int = 0, stop: int | None = None) -> Floats:
        """Return the command (n, n_u) that reaches the actuators for an action (n, n_u) in [-1, 1]."""
        own = self.C, self.parameters, self.noise_scale, self.stream, self.command
        k.add_command_noise(start, self.n if stop is None else stop, action, *own)
        return self.command

    def advance(
        self,
        pose: Floats,
        velocity: Floats,
        action: Floats,
        force: Floats,
        power: Floats,
        start: int = 0,
        stop: int | None = None,
    ) -> int:
        """Compute reward and ends after one agent step; return what `kernel` does, which `checked` takes."""
        stop = self.n if stop is None else stop
        sums = self.F, self.C, self.parameters, self.reward, self.hook
        return self.kernel(start, stop, pose, velocity, action, self.previous, force, power, *sums)

    def checked(self, ended: int) -> int:
        """Return the result of `kernel`, a number of episodes.

        Raises:
            TrainingError: the simulation left the finite numbers.
        """
        if ended < 0:
            row = -1 - ended
            raise TrainingError(
                f"the simulated position of environment {row} is not finite after step {int(self.C[row, k.C_STEPS]) + 1} "
                f"of its episode {int(self.C[row, k.C_EPISODE])}"
            )
        return int(ended)

    def observe(self, pose: Floats, velocity: Floats, indices: Integers | None = None) -> NDArray[np.float32]:
        """Return observations (n, n_obs) from measured poses and velocities; with `indices`, only these rows are renewed."""
        rows = self._all if indices is None else indices
        state = self.previous, self.F, self.C, self.parameters, self.blocks
        k.observe(rows, pose, velocity, self.offset, *state, self.stream, self.observation)
        return self.observation

    def goal(self, i: int) -> Floats:
        """Return where environment i is to be at the end (3,) in m: waypoint, station, dock, end of the path or curve."""
        return np.array(self.reference[i])

    def dock_yaw(self, i: int) -> float | None:
        """Return the yaw in rad with which a vehicle enters the dock of environment i; None in a task without a dock."""
        return None

    def records(self, indices: Integers) -> list[Record]:
        """Return the records of episodes that just ended."""
        return [self._counted(self.measured(int(i))) for i in indices]

    def measured(self, i: int) -> Record:
        """Return what the episode of environment i measured, before a failure counts as its bounds."""
        return record_of(self._totals(i), self.name)

    def _counted(self, record: Record) -> Record:
        if record["outcome"] in TASKS[self.name].failures:
            record |= metrics.of_failures(record, self.limits)
        return record

    def _totals(self, i: int) -> Totals:
        f = self.F[i].tolist()
        steps, episode, environment, outcome = self.C[i, : k.C_OUTCOME + 1].tolist()
        return Totals(
            episode=episode,
            environment=environment,
            outcome=OUTCOMES[outcome],
            steps=steps,
            step_s=self.duration,
            reward=f[k.F_RETURN],
            initial_distance=f[k.F_INITIAL_DISTANCE],
            distance=f[k.F_DISTANCE],
            deviation=f[k.F_DEVIATION],
            deviation_squared=f[k.F_DEVIATION_SQUARED],
            command_norm=f[k.F_COMMAND_NORM],
            energy=f[k.F_ENERGY],
            path=f[k.F_PATH],
            change=f[k.F_CHANGE],
            depth_margin=f[k.F_DEPTH_MARGIN],
            start_yaw=f[k.F_START_YAW],
            own=self.own_metrics(i),
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the state that an exact resume needs."""
        return {name: np.copy(getattr(self, name)) for name in _STATE}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        for name in _STATE:
            np.copyto(getattr(self, name), state[name], casting="no")


class TrackingTask(Task):
    """A task whose reference has a yaw of its own, with the errors that such tasks have in common."""

    def misplaced(self, i: int) -> str:
        distance, most = float(self.F[i, k.F_DISTANCE]), self.limits.get("bounds", math.inf)
        if distance > most:
            return f"is {distance:g} m from the reference; must be at most task.bounds={most:g} m"
        return super().misplaced(i)

    def errors(self, i: int, failed: float) -> dict[str, float]:
        """Return root mean squares of the position and the yaw error, and start and goal.

        Args:
            i: the environment.
            failed: m, stands for the position error of a failed episode.
        """
        squared, yaw_squared, counted = self.F[i, k.F_ERROR_SQUARED : k.F_COUNTED + 1].tolist()
        lost = self.C[i, k.C_OUTCOME] in (k.COLLISION, k.OUT_OF_BOUNDS)
        points = {"start": self.F[i, k.F_START : k.F_START + 3].tolist(), "goal": self.goal(i).tolist()}
        scenario = {
            f"{name}_{axis}_m": value
            for name, point in points.items()
            for axis, value in zip("xyz", point, strict=True)
        }
        return {
            "position_error_rms_m": failed if lost else math.sqrt(squared / max(counted, 1.0)),
            "yaw_error_rms_rad": math.sqrt(yaw_squared / max(counted, 1.0)),
            **scenario,
        }


def _limits(config: schema.TrainConfig) -> dict[str, float]:
    """Return the time limit in s and, for auvbench's own tasks with bounds, these in m; `Metric.failed` names them."""
    task = config.task
    found = {"time": schema.step_limit(task, config.step.frequency) / config.step.frequency}
    if isinstance(task, tasks.Tracked) and not isinstance(task, tasks.TaskConfig):
        found["bounds"] = task.bounds
    return found


def _command_noise_scale(noise: schema.Noise, vehicle: VehicleModel) -> Floats:
    """Return one unit of command noise in units of the normalised action (n_u,)."""
    if noise.command_unit == "normalised":
        return np.ones(len(vehicle.actuators))
    limits = np.asarray(vehicle.command_limits, dtype=np.float64)
    return np.asarray(2.0 / (limits[:, 1] - limits[:, 0]), dtype=np.float64)


def make(config: schema.TrainConfig, vehicle: VehicleModel, n: int, seed: int, **stream: bool) -> Task:
    """Return N episodes of the task that the configuration names.

    Raises:
        ConfigError: the vehicle cannot do it.
    """
    check_vehicle(config.task, vehicle)
    if isinstance(config.task, tasks.TaskConfig) or isinstance(config.reward, rewards.RewardConfig):
        from auvbench.tasks import installed

        return installed.make(config, vehicle, n, seed, **stream)
    return factory(config.task.name)(config, vehicle, n, seed, **stream)


def factory(name: str) -> type[Task]:
    """Return the class of a task."""
    found: type[Task] = resolve(TASKS[name].code)
    return found
