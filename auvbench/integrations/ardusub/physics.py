"""Simulate the embedded physics for ArduSub: PWM in, sensor readings out, one packet's duration at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, simulators
from auvbench.config.disturbances import READINGS, TIMING, alterations
from auvbench.config.schema import SCALES
from auvbench.envs.simulator_factory import make_simulator
from auvbench.errors import ConfigError, closest
from auvbench.integrations.ardusub.frames import LONGEST, THRUST, VOLTAGE, Motors, motors_of
from auvbench.integrations.ardusub.protocol import SensorState
from auvbench.integrations.ardusub.sensors import Sensors, to_body
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import base as tasks
from auvbench.tasks import disturbances
from auvbench.vehicles import sheet
from auvbench.vehicles.curves import t200_table
from auvbench.vehicles.physical import PhysicalCommands

Floats = NDArray[np.float64]

NORTH = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
"""attitude at the start: level, bow to the north"""

_BUOYANCY = SCALES.index("buoyancy")
_STRONGER = 1.05
"""largest ratio of a thruster's largest force to a T200's at 16 V for use of the T200's curve; above 1, since sheets round the thrust"""
_FIRST = np.zeros(1, dtype=np.int64)


class Physics:
    """One vehicle in its water, driven by the PWM of ArduSub's motors.

    A submerged vehicle moves exactly as in `FossenSimulator` under the same forces. At the surface, the part of the vehicle
    above the water has no buoyancy, so that a floating vehicle stays at the surface.

    Args:
        config: configuration whose vehicle, simulator, `task.start` and disturbance are used; a fluctuating current changes
            at the rate `step.frequency`.
        motors: thruster names in the order of the motors, or None (see `motors_of`).
        thrust: one of `frames.THRUST`.
        voltage: voltage of the battery, V.

    Raises:
        ConfigError: the vehicle has fins or matches no frame, the simulator is not the embedded one, or the
            disturbance has delays or sensor errors.
    """

    def __init__(
        self,
        config: schema.TrainConfig,
        *,
        motors: Sequence[str] | None = None,
        thrust: str = "t200",
        voltage: float = VOLTAGE,
    ) -> None:
        self.vehicle = sheet.load(config.vehicle)
        self.motors = motors_of(self.vehicle, motors)
        if thrust not in THRUST:
            raise ConfigError(f"--thrust {thrust}: unknown; {closest(thrust, THRUST)}")
        if thrust == "t200":
            _check_t200(self.motors)
        self.voltage = voltage
        physical = PhysicalCommands(self.vehicle)
        if not isinstance(config.simulator, simulators.Fossen):
            raise ConfigError(f"simulator={config.simulator.name}: ArduSub needs simulator=fossen")
        simulator = make_simulator(config.simulator, self.vehicle, 1, config.disturbance, physical.model)
        self.simulator = cast(FossenSimulator, simulator)
        self._start = np.array([[*config.task.start, *NORTH]])
        self._task = tasks.make(config, self.vehicle, 1, config.seed)
        self._task.assign(np.array([1]))  # `assign` sets the next episode, so the present episode is 0
        _refuse_errors(config.disturbance)
        self._disturbances = disturbances.of(config, self.vehicle, self._task)
        pulses = np.repeat(np.arange(LONGEST + 1)[:, None], len(self.motors.order), axis=1)
        commands = physical(self.motors.forces(pulses, thrust, voltage))
        self._commands = [commands[:, a].tolist() for a in self.motors.order]
        """simulator's command for each motor (first index) and PWM in us (second index)"""
        self._command = np.zeros((1, len(self.vehicle.units)))
        self._height = (self.vehicle.buoyancy / (self.vehicle.density * self.vehicle.gravity)) ** (1.0 / 3.0)
        """edge length in m of a cube with the vehicle's displaced volume; gives the fraction of the vehicle above the surface"""
        self._center = self.vehicle.center_of_buoyancy.tolist()
        self._sensors = Sensors(self.simulator, voltage)
        self.reset()

    def reset(self) -> None:
        """Put the vehicle at rest at its start and set the time to 0; current and waves are the same after each reset."""
        self._task.episodes.steps = 0
        disturbances, simulator = self._disturbances, self.simulator
        disturbances.clear()
        scales = disturbances.draw(_FIRST)
        simulator.reset(_FIRST, self._start, np.zeros((1, 6)), scales)
        disturbances.begin(_FIRST, simulator)
        self._sensors.reset()

    @property
    def time(self) -> float:
        """Return the time since the reset in s."""
        return self._sensors.time

    def step(self, pwm: Sequence[int], duration: float) -> SensorState:
        """Apply PWM for `duration` s and return the sensor readings at the end of this time.

        Args:
            pwm: PWM in us for each channel, with the motors' channels first.
            duration: time in s.

        Raises:
            TrainingError: the motion is not finite.
        """
        simulator, disturbances, row = self.simulator, self._disturbances, self._command[0]
        for channel, a in enumerate(self.motors.order):
            row[a] = self._commands[channel][min(pwm[channel], LONGEST)]
        disturbances.act(simulator, self._command)
        self._float()
        disturbances.push(simulator, self._command, duration)
        simulator.step(self._command, duration)
        return self._passed(duration)

    def hold(self, duration: float) -> SensorState:
        """Let `duration` s pass with the vehicle held in place; return the sensor readings at the end of this time."""
        return self._passed(duration)

    def _passed(self, duration: float) -> SensorState:
        """Return the sensor readings after a step of `duration` s; update the current at the rate `step.frequency`."""
        state = self._sensors.read(duration)
        e = self._task.episodes[0]
        if self.time >= (e.steps + 1) * self._task.duration:
            e.steps += 1
            self._disturbances.before(self.simulator, running=True)
        return state

    def _float(self) -> None:
        """Subtract the buoyancy of the part of the vehicle that is above the surface."""
        simulator = self.simulator
        _, _, z, *attitude = simulator.pose[0].tolist()
        above = min(max(0.5 + z / self._height, 0.0), 1.0)
        if above == 0.0:
            simulator.external_wrench[0] = 0.0
            return
        buoyancy = above * self.vehicle.buoyancy * float(simulator.scales[0, _BUOYANCY])
        a, b, c = to_body(attitude, (0.0, 0.0, -buoyancy))
        x, y, z = self._center
        simulator.external_wrench[0] = a, b, c, y * c - z * b, z * a - x * c, x * b - y * a


def _check_t200(motors: Motors) -> None:
    """Reject a vehicle whose strongest thruster is far stronger than a T200: the T200's curve would give it too little force."""
    most = float(np.max(np.abs(motors.vehicle.force_limits)))
    strongest = float(t200_table()["force_N"][-1])
    if most > _STRONGER * strongest:
        raise ConfigError(
            f"vehicle={motors.vehicle.name}: a thruster gives {most:.0f} N, a T200 {strongest:.0f} N; use --thrust sheet"
        )


def _refuse_errors(disturbance: schema.Disturbance) -> None:
    """Reject sensor errors and delays, which ArduSub simulates itself."""
    for name, altered, _ in alterations(disturbance):
        if altered in (READINGS, TIMING):
            raise ConfigError(
                f"disturbance.{name}: is not available with serve --face ardusub, since ArduSub simulates "
                "its own sensors (SIM_ parameters); use"
                " currents, waves, faults and randomisation"
            )
