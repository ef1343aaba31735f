"""The waypoint task for N environments: scenario, observation, reward, ends, records. docs/task.md defines it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.schema import step_limit
from auvbench.dynamics.random import TEST, VALIDATION
from auvbench.errors import TrainingError
from auvbench.metrics import Totals
from auvbench.observation import ObservationSpec
from auvbench.record import OUTCOMES, Record, record_of
from auvbench.tasks import kernels as k
from auvbench.tasks.observation import observation_spec
from auvbench.vehicles.inspect import net_buoyancy, terminal_speed
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

REFERENCE_COLUMNS = (
    "episode",
    "environment",
    "outcome",
    "steps",
    "duration_s",
    "return",
    "initial_distance_m",
    "final_distance_m",
    "deviation_mean_m",
    "deviation_std_m",
    "command_norm_mean_N",
    "command_norm_sum_N",
    "energy_J",
    "path_length_m",
    "path_efficiency",
    "smoothness_per_s",
    "depth_margin_m",
    "waypoint_x_m",
    "waypoint_y_m",
    "waypoint_z_m",
    "start_yaw_rad",
)
"""The columns of a record that a fingerprint covers (`evaluation.reference`). A new metric does not enter: fingerprints of
published results stay valid."""

SIGMAS = 6.0
"""standard deviations of a normal distribution that the bounds of the observation hold"""

LONGEST = 1e6
"""m; the bound where nothing slows a vehicle down"""


class WaypointTask:
    """State of N waypoint episodes.

    Args:
        seed: of all draws, 0 .. 2^32 - 1.
        test: draw from the streams of tests, which no training uses.
        validation: draw from the streams of validation, which neither training nor tests use.
    """

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
        self.frequency = config.step.frequency
        self.parameters = _parameters(config)
        self.noise_scale = _command_noise_scale(config.noise, vehicle)
        n_u = len(vehicle.actuators)
        self.spec = bounded_spec(config, vehicle)
        """of the observation"""
        self.F: Floats = np.zeros((n, k.N_FLOATS))
        self.C: Integers = np.zeros((n, k.N_INTEGERS), dtype=np.int64)
        self.seed = int(seed)
        self.reseed(seed)
        self.previous: Floats = np.zeros((n, n_u))
        self.offset: Floats = np.zeros((n, 4))
        """errors of the position (m) and yaw (rad) readings: bias, drift, noise (see disturbances)"""
        self.reward: Floats = np.zeros(n)
        self.command: Floats = np.zeros((n, n_u))
        self.observation = np.zeros((n, self.spec.size), dtype=np.float32)
        self._test = VALIDATION if validation else TEST if test else 0

    @property
    def duration(self) -> float:
        """Simulated seconds of one agent step."""
        return float(self.parameters[k.P_DURATION])

    @property
    def stream(self) -> int:
        """Flag of the streams of random numbers: 0, TEST or VALIDATION."""
        return self._test

    @property
    def outcome(self) -> Integers:
        """(n,) -1 while an episode is under way, else an index into OUTCOMES."""
        return self.C[:, k.C_OUTCOME]

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
        k.draw_scenarios(indices, self.F, self.C, self.parameters, self._test, pose)
        return pose

    def place(self, indices: Integers, pose: Floats, waypoint: Floats) -> None:
        """Replace the drawn start poses (k, 7) and waypoints (k, 3) of environments that were just reset."""
        F, P = self.F, self.parameters
        distance = np.linalg.norm(waypoint - pose[:, :3], axis=1)
        w, x, y, z = pose[:, 3:].T
        F[indices, k.F_START : k.F_START + 3] = F[indices, k.F_POSITION : k.F_POSITION + 3] = pose[:, :3]
        F[indices, k.F_START_YAW] = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        F[indices, k.F_WAYPOINT : k.F_WAYPOINT + 3] = waypoint
        F[indices, k.F_DISTANCE] = F[indices, k.F_INITIAL_DISTANCE] = distance
        depth = pose[:, 2]
        F[indices, k.F_DEPTH_MARGIN] = np.minimum(P[k.P_DEPTH_HIGH] - depth, depth - P[k.P_DEPTH_LOW])

    def add_noise(self, action: Floats) -> Floats:
        """Return the command (n, n_u) that reaches the actuators for an action (n, n_u) in [-1, 1]."""
        k.add_command_noise(*self.noise_arguments(action, 0, self.n))
        return self.command

    def advance(self, pose: Floats, action: Floats, force: Floats, power: Floats) -> int:
        """Compute reward and ends after one agent step; return how many episodes ended.

        Raises:
            TrainingError: the simulation left the finite numbers.
        """
        return self.checked(k.advance(*self.advance_arguments(pose, action, force, power, 0, self.n)))

    def checked(self, ended: int) -> int:
        """Return the result of the kernel `advance`, a number of episodes.

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

    def observe(self, pose: Floats, indices: Integers | None = None) -> NDArray[np.float32]:
        """Return observations (n, n_obs) from measured poses; with `indices`, only these rows are renewed."""
        if indices is None:
            k.observe(*self.observe_arguments(pose, 0, self.n))
        else:
            k.observe_some(indices, *self.observe_arguments(pose, 0, self.n)[2:])
        return self.observation

    # Arguments of the kernels for the environments start .. stop - 1. The arrays stay the same objects.

    def noise_arguments(self, action: Floats, start: int, stop: int) -> tuple[Any, ...]:
        """Return the arguments of `kernels.add_command_noise`."""
        return start, stop, action, self.C, self.parameters, self.noise_scale, self._test, self.command

    def advance_arguments(
        self, pose: Floats, action: Floats, force: Floats, power: Floats, start: int, stop: int
    ) -> tuple[Any, ...]:
        """Return the arguments of `kernels.advance`."""
        sums = self.F, self.C, self.parameters, self.reward
        return start, stop, pose, action, self.previous, force, power, *sums

    def observe_arguments(self, pose: Floats, start: int, stop: int) -> tuple[Any, ...]:
        """Return the arguments of `kernels.observe`."""
        state = self.previous, self.F, self.C, self.parameters
        return start, stop, pose, self.offset, *state, self._test, self.observation

    def records(self, indices: Integers) -> list[Record]:
        """Return the records of episodes that just ended."""
        return [record_of(self._totals(int(i))) for i in indices]

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
            waypoint=(f[k.F_WAYPOINT], f[k.F_WAYPOINT + 1], f[k.F_WAYPOINT + 2]),
            start_yaw=f[k.F_START_YAW],
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the state that an exact resume needs."""
        return {
            name: np.copy(getattr(self, name)) for name in ("F", "C", "previous", "offset", "observation")
        }

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        for name in ("F", "previous", "offset", "observation"):
            np.copyto(getattr(self, name), state[name], casting="no")
        # Older states lack the column of seeds: their rows have the seed of the batch.
        self.C[:, k.C_SEED] = self.seed
        np.copyto(self.C[:, : state["C"].shape[1]], state["C"], casting="no")


def _parameters(config: schema.TrainConfig) -> Floats:
    task, reward, noise = config.task, config.reward, config.noise
    P = np.zeros(k.N_PARAMETERS)
    P[k.P_GOAL] = task.goal_radius
    P[k.P_DEPTH_LOW] = task.depth_low
    P[k.P_DEPTH_HIGH] = task.depth_high
    P[k.P_MAX_STEPS] = step_limit(task, config.step.frequency)
    P[k.P_K] = reward.k
    P[k.P_LENGTH] = reward.length
    P[k.P_SUCCESS] = reward.success
    P[k.P_COLLISION] = reward.collision
    P[k.P_REGRESS] = reward.regress
    P[k.P_DURATION] = 1.0 / config.step.frequency
    P[k.P_BODY_FRAME] = task.position_frame == "body"
    P[k.P_START : k.P_START + 3] = task.start
    P[k.P_BOX_LOW : k.P_BOX_LOW + 3] = task.waypoint_low
    P[k.P_BOX_HIGH : k.P_BOX_HIGH + 3] = task.waypoint_high
    P[k.P_POSITION_LOW : k.P_POSITION_HIGH + 1] = noise.position.low, noise.position.high
    P[k.P_YAW_LOW : k.P_YAW_HIGH + 1] = noise.yaw.low, noise.yaw.high
    P[k.P_COMMAND_LOW : k.P_COMMAND_HIGH + 1] = noise.command.low, noise.command.high
    P[k.P_POSITION_LOW : k.P_COMMAND_HIGH + 1] *= noise.scale
    P[k.P_BOTH_SIGNS] = noise.sign == "both"
    return P


def _command_noise_scale(noise: schema.Noise, vehicle: VehicleModel) -> Floats:
    """Return one unit of command noise in units of the normalised action (n_u,)."""
    if noise.command_unit == "normalised":
        return np.ones(len(vehicle.actuators))
    limits = np.asarray(vehicle.command_limits, dtype=np.float64)
    return np.asarray(2.0 / (limits[:, 1] - limits[:, 0]), dtype=np.float64)


def bounded_spec(config: schema.TrainConfig, vehicle: VehicleModel) -> ObservationSpec:
    """Return the observation with its bounds."""
    return observation_spec(config.task, vehicle.actuators, position_bounds(config, vehicle).tolist())


def position_bounds(config: schema.TrainConfig, vehicle: VehicleModel) -> Floats:
    """Return the largest position errors (3,) in m.

    How far away the waypoint may be at the start, and how far the vehicle can move away from it until the episode times
    out (`top_speed`), vertically no farther than the depth limits; and the errors of the readings.
    """
    task = config.task
    seconds = step_limit(task, config.step.frequency) / config.step.frequency
    speed = top_speed(vehicle, config.disturbance)
    away = speed * seconds
    start, low, high = (
        np.asarray(v, dtype=np.float64) for v in (task.start, task.waypoint_low, task.waypoint_high)
    )
    apart = np.maximum(np.abs(low - start), np.abs(high - start))
    # The last step may lead beyond a depth limit before the episode ends.
    below, above = high[2] - task.depth_low, task.depth_high - low[2]
    vertical = min(apart[2] + away, max(below, above) + speed / config.step.frequency)
    level = apart[:2] + away
    if task.position_frame == "body":
        level = np.full(2, math.hypot(*level))
    bounds = np.array([*level, vertical]) + _misreading(config, seconds)
    return np.asarray(np.ceil(np.minimum(bounds, LONGEST)))


def top_speed(vehicle: VehicleModel, disturbance: schema.Disturbance) -> float:
    """Return a speed over ground in m/s that nothing in an episode exceeds for long.

    Through the water: the speeds that all thrusters together and the net buoyancy would give along each body axis
    alone, the three at once, for the strongest, slipperiest vehicle that may be drawn. The water's own speed comes on
    top. Infinite where an axis has no damping.
    """
    drawn = disturbance.randomisation
    force = np.abs(vehicle.allocation[:3]) @ np.abs(vehicle.force_limits).max(axis=1, initial=0.0)
    force = force * drawn.thrust.high
    heavier = vehicle.weight * (drawn.mass.high - drawn.mass.low)
    lighter = vehicle.buoyancy * (drawn.buoyancy.high - drawn.buoyancy.low)
    # A vehicle without thrusters glides: its net buoyancy drives it along every axis.
    force = force + abs(net_buoyancy(vehicle)) + heavier + lighter
    least = drawn.damping.low
    axes = [
        terminal_speed(float(f), least * float(d), least * float(q))
        for f, d, q in zip(force, vehicle.linear_damping[:3], vehicle.quadratic_damping[:3], strict=True)
    ]
    current = disturbance.current
    water = current.speed if current.speed_high is None else max(current.speed, current.speed_high)
    wander = math.hypot(
        current.gauss_markov.sigma, current.gauss_markov.sigma, current.gauss_markov.sigma_vertical
    )
    return math.hypot(*axes) + max(1.0, abs(current.profile.factor)) * water + SIGMAS * wander


def _misreading(config: schema.TrainConfig, seconds: float) -> Floats:
    """Return by how much (3,) in m the readings of the position may be wrong."""
    sensor = config.disturbance.sensor
    errors = [
        math.hypot(getattr(sensor.gaussian, axis), getattr(sensor.bias, axis))
        + getattr(sensor.drift, axis) * math.sqrt(seconds)
        for axis in "xyz"
    ]
    return config.noise.position.high * config.noise.scale + SIGMAS * np.asarray(errors)
