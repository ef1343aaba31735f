"""The disturbances of N episodes, as the batch of environments calls them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.schema import SCALES
from auvbench.errors import ConfigError, closest
from auvbench.simulators.base import Simulator
from auvbench.tasks.base import Task
from auvbench.tasks.disturbances import kernels as k
from auvbench.tasks.disturbances.sea import Sea
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_CHANNELS = ("x", "y", "z", "yaw")
_STATE = ("D", "I", "commands", "measurements", "clock", "power")


def make(config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> Disturbances | None:
    """Return the disturbances of a configuration; None without any, so that they cost nothing."""
    disturbances = Disturbances(config, vehicle, task)
    return disturbances if disturbances.active else None


class Disturbances:
    """State of the disturbances of N episodes.

    Order of calls: `draw` and, after the simulator's reset, `begin` when episodes begin; `advance` in place of the
    simulator's step; `read` before the task observes.

    Raises:
        ConfigError: a fault of an actuator that the vehicle does not have or that has no force to lose, or a
            range of masses that leaves the vehicle without buoyancy.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel, task: Task) -> None:
        disturbance = config.disturbance
        n, n_u = task.n, len(vehicle.actuators)
        self.task = task
        self.Q = Q = _parameters(disturbance, vehicle, config.step.frequency)
        self.depths = (disturbance.current.profile.top, disturbance.current.profile.bottom)
        self.schedule = schedule(
            config.step.frequency, disturbance.delay.action, disturbance.delay.observation
        )

        self.fluctuates = bool(np.any(Q[k.Q_SIGMA : k.Q_SIGMA + 3] > 0.0))
        self.flows = self.fluctuates or bool(Q[k.Q_SPEED + 1] > 0.0)
        self.sheared = self.flows and bool(Q[k.Q_FACTOR] != 1.0 or Q[k.Q_TURN] != 0.0)
        self.sea = Sea(disturbance.sea, task) if disturbance.sea else None
        self.fails = bool(Q[k.Q_FAULT] != k.HEALTHY and Q[k.Q_PROBABILITY] > 0.0)
        self.delayed = self.schedule.commands > 1 or self.schedule.measurements > 0
        self.noisy = bool(np.any(Q[k.Q_GAUSSIAN : k.Q_GAUSSIAN + 4] > 0.0))
        self.drifts = bool(np.any(Q[k.Q_STEP_DRIFT : k.Q_STEP_DRIFT + 4] > 0.0))
        self.misreads = self.noisy or self.drifts or bool(np.any(Q[k.Q_BIAS : k.Q_BIAS + 4] > 0.0))
        self.randomises = bool(np.any(Q[k.Q_SCALE_LOW : k.Q_SCALE_HIGH + 6] != 1.0))
        self.candidates = _candidates(disturbance.fault, vehicle) if self.fails else np.zeros(1, np.int64)

        self.D: Floats = np.zeros((n, k.N_FLOATS))
        self.I: Integers = np.zeros((n, k.N_INTEGERS), dtype=np.int64)
        self.commands: Floats = np.zeros((self.schedule.commands if self.delayed else 0, n, n_u))
        """ring of the last commands: that of step t lies at t modulo its length"""
        self.measurements: Floats = np.zeros((self.schedule.measurements, n, 7))
        """ring of the last measured poses"""
        self.velocities: Floats = np.zeros((self.schedule.measurements if task.reads_velocity else 0, n, 6))
        """ring of the last measured velocities, where the task observes them"""
        self.clock: Integers = np.zeros((), dtype=np.int64)  # steps of the batch
        self._state = (*_STATE, *(["velocities"] if task.reads_velocity else []))
        self.power: Floats = np.zeros(n)
        """(n,) W, mean electrical power over the last agent step"""

    @property
    def active(self) -> bool:
        """Whether any disturbance is active."""
        waves = self.sea is not None
        return self.flows or waves or self.fails or self.delayed or self.misreads or self.randomises

    def draw(self, indices: Integers) -> Floats | None:
        """Draw the disturbances of new episodes; return the scales (k, 6) of their vehicles, if any."""
        rows, Q, stream = self.task.rows, self.Q, self.task.stream
        if self.flows:
            k.draw_current(indices, rows, Q, stream, self.D)
        if self.sea is not None:
            self.sea.draw(indices)
        if self.fails:
            k.draw_faults(indices, rows, Q, self.candidates, stream, self.D, self.I)
        if self.misreads:
            k.draw_bias(indices, rows, Q, stream, self.D)
        if not self.randomises:
            return None
        scales = np.empty((len(indices), len(SCALES)))
        k.draw_scales(indices, rows, Q, stream, scales)
        return scales

    def begin(self, indices: Integers, simulator: Simulator) -> None:
        """Set current, rings and first readings of new episodes."""
        if self.flows:
            self._set_current(simulator)
        self.commands[:, indices] = 0.0
        self.measurements[:, indices] = simulator.pose[indices]
        self.velocities[:, indices] = 0.0
        self.power[indices] = 0.0
        if self.misreads:
            self._misread(indices)

    def advance(self, simulator: Simulator, command: Floats) -> None:
        """Advance the simulator by one agent step under `command` (n, n_u), with delays and faults."""
        task = self.task
        self.move_current(simulator)
        if self.sea is not None:
            self.sea.begin_step(simulator)
        if not self.delayed:
            self.fail(simulator, command)
            simulator.step(command, task.duration)
            self.power[:] = simulator.power
            return
        kept = len(self.commands)
        now = int(self.clock)
        self.commands[now % kept] = command
        self.power[:] = 0.0
        for segment in self.schedule.segments:
            acting = self.commands[(now - segment.age) % kept]
            self.fail(simulator, acting)
            simulator.step(acting, segment.duration)
            self.power += simulator.power * (segment.duration / task.duration)
            if segment.measure:
                self.measurements[now % len(self.measurements)] = simulator.pose
                if task.reads_velocity:
                    self.velocities[now % len(self.velocities)] = simulator.velocity
        self.clock += 1

    def move_current(self, simulator: Simulator) -> None:
        """Advance a fluctuating current by one agent step."""
        if self.fluctuates:
            k.advance_current(self.task.rows, self.Q, self.task.stream, self.D)
            self._set_current(simulator)

    def fail(self, simulator: Simulator, command: Floats) -> None:
        """Let faulty actuators fail: write the simulator's effectiveness, and `command` (n, n_u) where one is stuck."""
        if self.fails:
            k.apply_faults(self.task.rows, self.Q, self.D, self.I, command, simulator.effectiveness)

    def _set_current(self, simulator: Simulator) -> None:
        fluctuation = self.D[:, k.D_FLUCTUATION : k.D_FLUCTUATION + 3]
        top, bottom = (self.D[:, at : at + 3] + fluctuation for at in (k.D_TOP, k.D_BOTTOM))
        if self.sheared:
            simulator.set_current(top, bottom, self.depths)
        else:
            simulator.set_current(top)

    def read(self) -> None:
        """Renew the errors of the readings after an agent step."""
        task = self.task
        if self.drifts:
            k.advance_drift(task.rows, self.Q, task.stream, self.D)
        if self.noisy or self.drifts:
            self._misread(np.arange(task.n))

    def _misread(self, indices: Integers) -> None:
        task = self.task
        k.offsets(indices, task.rows, self.Q, task.stream, self.noisy, self.D, task.offset)

    def measured(self, simulator: Simulator) -> tuple[Floats, Floats]:
        """Return the poses (n, 7) and velocities (n, 6) that arrive now, before errors."""
        kept = len(self.measurements)
        if not kept:
            return simulator.pose, simulator.velocity
        # `clock` is where the next measurement goes: there lies the oldest.
        oldest = int(self.clock) % kept
        velocity = self.velocities[oldest] if self.task.reads_velocity else simulator.velocity
        return self.measurements[oldest], velocity

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """Return copies of the state that an exact resume needs and neither task nor simulator holds."""
        return {name: np.copy(getattr(self, name)) for name in self._state}

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        for name in self._state:
            np.copyto(getattr(self, name), state[name], casting="no")
        if self.sea is not None:
            self.sea.draw(np.arange(self.task.n))


def _parameters(disturbance: schema.Disturbance, vehicle: VehicleModel, frequency: float) -> Floats:
    current, fault, sensor = disturbance.current, disturbance.fault, disturbance.sensor
    wander, drawn = current.gauss_markov, disturbance.randomisation
    Q = np.zeros(k.N_PARAMETERS)
    Q[k.Q_SPEED : k.Q_SPEED + 2] = _range(current.speed, current.speed_high)
    if current.direction is None:
        Q[k.Q_DIRECTION : k.Q_DIRECTION + 2] = 0.0, 2.0 * math.pi
    else:
        Q[k.Q_DIRECTION : k.Q_DIRECTION + 2] = current.direction
    Q[k.Q_ELEVATION] = current.elevation
    Q[k.Q_SIGMA : k.Q_SIGMA + 3] = wander.sigma, wander.sigma, wander.sigma_vertical
    Q[k.Q_DECAY] = math.exp(-wander.mu / frequency)
    # 1 - e^(-2 x) without cancellation, for a process that hardly moves in a step.
    Q[k.Q_INNOVATION] = math.sqrt(-math.expm1(-2.0 * wander.mu / frequency))
    Q[k.Q_FACTOR], Q[k.Q_TURN] = current.profile.factor, current.profile.turn
    Q[k.Q_FAULT] = k.MODES.index(fault.mode)
    Q[k.Q_PROBABILITY] = fault.probability
    Q[k.Q_TIME : k.Q_TIME + 2] = _range(fault.time, fault.time_high)
    Q[k.Q_WEAK] = fault.factor
    for j, channel in enumerate(_CHANNELS):
        Q[k.Q_GAUSSIAN + j] = getattr(sensor.gaussian, channel)
        Q[k.Q_BIAS + j] = getattr(sensor.bias, channel)
        Q[k.Q_STEP_DRIFT + j] = getattr(sensor.drift, channel) / math.sqrt(frequency)
    for j, name in enumerate(SCALES):
        scale = getattr(drawn, name)
        Q[k.Q_SCALE_LOW + j], Q[k.Q_SCALE_HIGH + j] = scale.low, scale.high
    Q[k.Q_LOGARITHMIC] = drawn.distribution == "log_uniform"
    Q[k.Q_KEEP_TRIM] = drawn.keep_trim
    Q[k.Q_WEIGHT_RATIO] = vehicle.weight / vehicle.buoyancy if vehicle.buoyancy > 0.0 else 0.0
    Q[k.Q_FREQUENCY] = frequency
    lightest = 1.0 + (drawn.mass.low - 1.0) * Q[k.Q_WEIGHT_RATIO]
    if drawn.keep_trim and lightest <= 0.0:
        raise ConfigError(
            f"disturbance.randomisation.mass.low={drawn.mass.low:g}: keep_trim would leave {vehicle.name} without "
            f"buoyancy; must be more than {1.0 - 1.0 / Q[k.Q_WEIGHT_RATIO]:.3g}"
        )
    return Q


def _range(low: float, high: float | None) -> tuple[float, float]:
    return low, low if high is None else high


def check(config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Check disturbances against the vehicle before a run is made.

    Raises:
        ConfigError: as `Disturbances`; also for a named actuator that the vehicle lacks and that does not fail.
    """
    fault = config.disturbance.fault
    _parameters(config.disturbance, vehicle, config.step.frequency)
    if fault.mode != "none" and fault.probability > 0.0:
        _candidates(fault, vehicle)
    _check_actuator(fault, vehicle)


def _check_actuator(fault: schema.Fault, vehicle: VehicleModel) -> None:
    names = vehicle.actuators
    if fault.actuator is not None and fault.actuator not in names:
        raise ConfigError(
            f"disturbance.fault.actuator={fault.actuator}: {vehicle.name} has no such actuator; "
            f"{closest(fault.actuator, names)}"
        )


def _candidates(fault: schema.Fault, vehicle: VehicleModel) -> Integers:
    """Return the indices of the actuators that may fail."""
    thrusters = [i for i, _ in vehicle.thrusters]
    names = vehicle.actuators
    if fault.actuator is None:
        if not thrusters:
            raise ConfigError(
                f"disturbance.fault.actuator=null: {vehicle.name} has no thrusters; name one of {', '.join(names)}"
            )
        return np.array(thrusters, dtype=np.int64)
    _check_actuator(fault, vehicle)
    index = names.index(fault.actuator)
    if fault.mode != "stuck" and index not in thrusters:
        raise ConfigError(
            f"disturbance.fault.mode={fault.mode}: {fault.actuator} is a {vehicle.units[index].kind}; "
            "only a thruster has a force to lose, use stuck"
        )
    return np.array([index], dtype=np.int64)


TOLERANCE = 1e-9
"""As a fraction of the step: a delay this close to whole steps is whole steps."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of an agent step during which one command acts."""

    duration: float  # s
    age: int  # of the acting command, in agent steps: 0 is the command of this step
    measure: bool  # a measurement is taken at its end


@dataclass(frozen=True, slots=True)
class Schedule:
    """The segments of every agent step and how long commands and measurements must be kept."""

    segments: tuple[Segment, ...]
    commands: int  # commands to keep, the newest included; 1 without an action delay
    measurements: int  # measurements to keep; 0 without an observation delay


def split(delay: float, frequency: float) -> tuple[int, float]:
    """Return the whole agent steps in a delay in s, and the rest as a fraction of a step in [0, 1).

    >>> split(0.25, 10.0)
    (2, 0.5)
    >>> split(0.3, 10.0)
    (3, 0.0)
    """
    steps = delay * frequency
    whole = math.floor(steps + TOLERANCE)
    rest = steps - whole
    return whole, rest if rest > TOLERANCE else 0.0


def schedule(frequency: float, action: float, observation: float) -> Schedule:
    """Return the schedule for agent steps at `frequency` Hz with delays in s, exact at any frequency.

    With agent steps of T seconds, the command of step k acts from k T + d on: d = m T + r, 0 <= r < T, so within a
    step the command of m + 1 steps ago acts for r seconds and then that of m steps ago. A measurement that arrives at
    k T was taken at k T - d = (k - p) T - s, 0 <= s < T: T - s seconds into a step.
    """
    late, begins = split(action, frequency)  # the command of `late` steps ago begins to act at `begins`
    old, before_end = split(observation, frequency)
    measured = old > 0 or before_end > 0.0
    taken = 1.0 - before_end  # within a step, when it is measured
    if abs(taken - begins) < TOLERANCE:
        taken = begins  # one cut, not two with nothing between
    cuts = sorted({0.0, begins, taken, 1.0})
    segments = tuple(
        Segment(
            duration=(end - start) / frequency,
            age=late if start >= begins else late + 1,
            measure=measured and end == taken,
        )
        for start, end in pairwise(cuts)
    )
    return Schedule(
        segments=segments,
        commands=late + 1 + (begins > 0.0),
        measurements=old + 1 if measured else 0,
    )
