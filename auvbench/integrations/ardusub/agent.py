"""Steer a vehicle with ArduSub's own modes, in lock-step with the embedded simulator (`algo=ardusub`).

ArduSub changes its PWM hundreds of times in an agent step. The agent therefore has its own simulator for its
tests: the embedded simulator, in which each packet from ArduSub advances the vehicle. An agent step is as long
as for other agents. Once per agent step, the agent sends ArduSub a command computed from the observation that other
agents get: a target in mode GUIDED, or a pilot's sticks in POSHOLD and ALT_HOLD. All other information comes from
ArduSub's own sensors, which ArduSub simulates from the true motion. With an estimator (`navigation=ekf`) the observation
has the estimated state, and ArduSub has no GPS. If the vehicle has a DVL, ArduSub gets the DVL's pings.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical.cascade import Estimator, to_body
from auvbench.config import schema, simulators
from auvbench.config.disturbances import COMMANDS, READINGS, TIMING, alterations
from auvbench.errors import ConfigError, TrainingError
from auvbench.integrations.ardusub import dvl, sitl
from auvbench.integrations.ardusub.frames import HIGH, NEUTRAL, Motors, driven, motors_of
from auvbench.integrations.ardusub.radio import MODES, dialect
from auvbench.integrations.ardusub.sensors import Sensors
from auvbench.integrations.ardusub.spec import ArduSub
from auvbench.runs import interruption
from auvbench.simulators.base import IntArray
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel

if TYPE_CHECKING:
    from auvbench.tasks.navigation.estimator import Navigation

Floats = NDArray[np.float64]


class ArduSubAgent:
    """Agent that lets ArduSub steer. It runs one episode at a time and starts a new ArduSub for each episode.

    Raises:
        ConfigError: the vehicle has fins, its thrusters match none of ArduSub's frames, the task observes no position
            or yaw error, or ArduSub's program is missing or does not have the SHA-256 in the run's configuration.
        MissingExtraError: pymavlink is not installed.
    """

    row_by_row = True

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        algo = config.algo
        assert isinstance(algo, ArduSub)
        self._algo = algo
        try:
            self._motors = motors_of(vehicle)
        except ConfigError as error:
            reason = str(error).partition(";")[0]
            raise ConfigError(
                f"{reason}; use bluerov2, bluerov2_heavy or their variants with algo=ardusub"
            ) from error
        self._estimate = Estimator(
            1.0 / config.step.frequency, 1.0, observation_spec(config.task, vehicle.actuators)
        )
        self._vehicle: Piloted | None = None
        self._program = sitl.find(algo.sha256)[0]
        dialect()

    def simulator(
        self, config: schema.TrainConfig, vehicle: VehicleModel, navigation: Navigation | None
    ) -> Piloted:
        """Return the simulator for a test condition, in which ArduSub drives the thrusters.

        Raises:
            ConfigError: see `refuse` and `dvl.check`.
        """
        refuse(config)
        dvl.check(config, self._algo.mode)
        forwarder = dvl.Forwarder(navigation) if navigation is not None and config.sensors.dvl else None
        parameters = dvl.parameters(config) | self._algo.parameters
        self._vehicle = Piloted(vehicle, self._motors, self._algo.mode, parameters, self._program, forwarder)
        return self._vehicle

    def reset(self, episodes: Integers) -> None:
        self._estimate.reset(len(episodes))

    def act(self, observation: Observations) -> Actions:
        """Order ArduSub to go to the reference; return ArduSub's present outputs (1, n_u) in [-1, 1].

        Raises:
            ConfigError: the environment does not use the agent's own simulator.
        """
        vehicle, now = self._vehicle, self._estimate
        if vehicle is None:
            raise ConfigError(
                "algo=ardusub moves the vehicle itself; only the tests of auvbench evaluate support this"
            )
        now.update(observation.astype(np.float64))
        ahead, port, up = to_body(now.error, now.yaw)[0].tolist()
        turn = float(now.yaw_error[0])
        radio = vehicle.running.radio
        radio.show_presence()
        if self._algo.mode == "guided":
            radio.listen()
            u, v, w = to_body(now.target, now.yaw)[0].tolist()
            radio.stick(0.0, 0.0, 0.0, 0.0)
            radio.fly_to((ahead, -port, -up), radio.yaw - turn, (u, -v, -w))
        else:
            sticks = (min(1.0, max(-1.0, self._algo.stick * x)) for x in (ahead, -port, up, -turn))
            radio.stick(*sticks)
        return vehicle.outputs

    def ended(self, rows: Integers) -> None:
        """Stop the ArduSub of the episode that has ended."""
        if self._vehicle is not None:
            self._vehicle.stop()

    def start(self, vehicle: VehicleModel) -> None:
        """Start ArduSub once and stop it."""
        piloted = Piloted(vehicle, self._motors, self._algo.mode, self._algo.parameters, self._program)
        piloted.reset(np.arange(1), np.array([[0.0, 0.0, -5.0, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6)))
        piloted.stop()


def check(config: schema.TrainConfig, vehicle: VehicleModel) -> None:
    """Start ArduSub once, so that a run with an unsuitable program fails at its start.

    Raises:
        ConfigError: see `ArduSubAgent` and `dvl.check`.
        TrainingError: ArduSub does not start or arm.
    """
    assert isinstance(config.algo, ArduSub)
    dvl.check(config, config.algo.mode)
    ArduSubAgent(config, vehicle).start(vehicle)


class Piloted(FossenSimulator):
    """One vehicle of the embedded simulator, driven by ArduSub.

    Each episode starts a new ArduSub process. The vehicle is held at its start until ArduSub's estimator has
    settled and ArduSub has armed; then the clock of the episode starts. PWM from 1100 to 1900 us is
    converted linearly to a command from -1 to 1, so that ArduSub has the same thruster forces as every agent.

    Args:
        vehicle: vehicle.
        motors: the vehicle's thrusters in the order of ArduSub's motors.
        mode: one of `MODES`.
        parameters: ArduSub's parameters by name.
        path: path of ArduSub's program.
        forwarder: forwarder of the vehicle's DVL pings; None: ArduSub gets no pings.
    """

    def __init__(
        self,
        vehicle: VehicleModel,
        motors: Motors,
        mode: str,
        parameters: Mapping[str, float],
        path: Path,
        forwarder: dvl.Forwarder | None = None,
    ) -> None:
        super().__init__(vehicle, 1)
        self.outputs = np.zeros((1, len(vehicle.actuators)))
        """(1, n_u) commands in [-1, 1] from ArduSub's present PWM"""
        self.pilot: sitl.Sitl | None = None
        self.settled = 0.0
        """time in s, by ArduSub's clock, from the start of ArduSub to the start of the episode"""
        self._motors, self._mode, self._named, self._path = motors, mode, parameters, path
        self._forwarder = forwarder
        self._sensors = Sensors(self)

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put the vehicle at `pose` (1, 7) and wait until a new ArduSub is ready; see `Simulator.reset`.

        Raises:
            TrainingError: ArduSub does not start or arm.
        """
        super().reset(indices, pose, velocity, scales)
        self.stop()
        frame = self._motors.frame
        assert frame is not None
        parameters = {"FRAME_CONFIG": frame.config, **self._named}
        tied = partial(interruption.die_with_parent, os.getpid())
        self.pilot = sitl.Sitl(self._path, parameters, tied, self._forwarder is not None)
        self.settled = self.pilot.settle(self._sensors.reset(), MODES[self._mode])
        if self._forwarder is not None:
            self._forwarder.begin()
        self._read(self.pilot.packet.pwm)

    @property
    def running(self) -> sitl.Sitl:
        """Return the ArduSub of this episode."""
        assert self.pilot is not None, "reset comes first"
        return self.pilot

    def stop(self) -> None:
        """End ArduSub's process."""
        if self.pilot is not None:
            self.pilot.close()
            self.pilot = None

    def _read(self, pwm: tuple[int, ...]) -> None:
        pulses = np.array(pwm[: len(self._motors.order)], dtype=np.float64)
        share = np.where(driven(pulses), (pulses - NEUTRAL) / (HIGH - NEUTRAL), 0.0)
        self.outputs[0, self._motors.order] = np.clip(share * self._motors.signs, -1.0, 1.0)

    def step(self, command: ArrayLike, duration: float) -> None:
        """Advance by `duration` s under ArduSub's PWM; a thruster with effectiveness 0 gets the command 0.

        `command` is not used.

        Afterwards `command_force` and `power` are means over the step.

        Raises:
            TrainingError: ArduSub disarms, ends or stops sending.
        """
        pilot = self.running
        if self._forwarder is not None:
            self._forwarder.forward(pilot.radio)
        count = max(1, math.ceil(duration * pilot.packet.frame_rate - 1e-9))
        force, power = np.zeros_like(self.command_force), np.zeros_like(self.power)
        for _ in range(count):
            super().step(self.outputs * (self.effectiveness > 0.0), duration / count)
            force += self.command_force
            power += self.power
            self._read(pilot.exchange(self._sensors.read(duration / count), duration / count).pwm)
        self.command_force[:], self.power[:] = force / count, power / count
        pilot.radio.listen()
        if not pilot.radio.armed:
            raise TrainingError(f"{pilot.path}: disarmed in the episode; it said: {pilot.radio.said}")


def refuse(config: schema.TrainConfig) -> None:
    """Reject a test condition that auvbench cannot apply to ArduSub, which has its own sensors and its own loop.

    Raises:
        ConfigError: a condition is rejected; the message names its key.
    """
    if not isinstance(config.simulator, simulators.Fossen):
        raise ConfigError(f"simulator={config.simulator.name}: algo=ardusub needs simulator=fossen")
    if config.filter.acts:
        raise ConfigError(f"filter={config.filter.name}: not available with algo=ardusub; use filter=none")
    noise, disturbance = config.noise, config.disturbance
    own = "ArduSub has its own sensors (its SIM_ parameters)"
    if noise.scale > 0.0 and max(noise.position.high, noise.yaw.high, noise.command.high) > 0.0:
        raise ConfigError(
            f"noise={noise.name}: cannot be applied to algo=ardusub, {own}; use protocol=ardusub, or noise=none"
        )
    reasons = {
        READINGS: own,
        TIMING: "which has its own loop",
        COMMANDS: "which commands the actuators; use dead or weak",
    }
    for name, altered, part in alterations(disturbance):
        raise ConfigError(f"disturbance.{name}{part}: cannot be applied to algo=ardusub, {reasons[altered]}")
