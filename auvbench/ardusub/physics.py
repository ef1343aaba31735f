"""The embedded physics as ArduSub needs it: PWM in, sensors out, one packet's time after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray

from auvbench.ardusub.frames import LONGEST, THRUST, VOLTAGE, Motors, motors_of
from auvbench.ardusub.protocol import SensorState
from auvbench.config import schema, simulators
from auvbench.config.schema import SCALES
from auvbench.dynamics import frames
from auvbench.envs.simulator_factory import make_simulator
from auvbench.errors import ConfigError, TrainingError, closest
from auvbench.simulators.fossen import FossenSimulator
from auvbench.tasks import base as tasks
from auvbench.tasks.disturbances import Disturbances
from auvbench.tasks.kernels import C_STEPS
from auvbench.vehicles import sheet
from auvbench.vehicles.curves import t200_table
from auvbench.vehicles.physical import PhysicalCommands

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

GRAVITY = 9.80665
"""m/s2, to which ArduPilot calibrates accelerometers (GRAVITY_MSS), whatever the sheet's gravity is"""
NORTH = (0.5**0.5, 0.0, 0.0, 0.5**0.5)
"""attitude at the start: level, bow to the north"""

_BUOYANCY = SCALES.index("buoyancy")
_STRONGER = 1.05
"""times a T200 at 16 V: sheets round its thrust"""
_FIRST = np.zeros(1, dtype=np.int64)


class Physics:
    """One vehicle in its water, driven by the PWM of ArduSub's motors.

    Below the surface its motion is, to the last bit, that of `FossenSimulator` under the same forces. At the surface the
    buoyancy falls with the share of the vehicle that is above it, so that a vehicle that floats stays there.

    Args:
        config: its vehicle, simulator, `task.start` and disturbance; `step.frequency` is that of a fluctuating current.
        motors: given order of the thrusters (`motors_of`).
        thrust: of `frames.THRUST`.
        voltage: V, of the battery.

    Raises:
        ConfigError: the vehicle has fins or fits no frame, the simulator is not the embedded one, or the disturbance has
            delays or sensor errors.
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
        drawn = config.disturbance.randomisation
        if not isinstance(config.simulator, simulators.Fossen):
            raise ConfigError(f"simulator={config.simulator.name}: ArduSub needs simulator=fossen")
        made = make_simulator(config.simulator, self.vehicle, 1, drawn, physical.model)
        self.simulator = cast(FossenSimulator, made)
        self.time = 0.0
        """s since the reset"""
        self._start = np.array([[*config.task.start, *NORTH]])
        self._task = tasks.make(config, self.vehicle, 1, config.seed)
        self._task.assign(np.array([1]))  # episode 0
        self._disturbances = Disturbances(config, self.vehicle, self._task)
        _refuse_errors(self._disturbances)
        pulses = np.repeat(np.arange(LONGEST + 1)[:, None], len(self.motors.order), axis=1)
        commands = physical(self.motors.forces(pulses, thrust, voltage))
        self._commands = [commands[:, a].tolist() for a in self.motors.order]
        """of each motor, the simulator's command by PWM"""
        self._command = np.zeros((1, len(self.vehicle.units)))
        self._height = (self.vehicle.buoyancy / (self.vehicle.density * self.vehicle.gravity)) ** (1.0 / 3.0)
        """m, of the cube that displaces as much water: what of the vehicle is above the surface is measured by it"""
        self._center = self.vehicle.center_of_buoyancy.tolist()
        self._velocity: Vector = (0.0, 0.0, 0.0)
        """of the last step, m/s in the world"""
        self.reset()

    def reset(self) -> None:
        """Put the vehicle at rest where it started, at time 0 in the same water."""
        self._task.C[:, C_STEPS] = 0
        disturbances, simulator = self._disturbances, self.simulator
        disturbances.D[:] = 0.0
        disturbances.I[:] = 0
        scales = disturbances.draw(_FIRST)
        simulator.reset(_FIRST, self._start, np.zeros((1, 6)), scales)
        disturbances.begin(_FIRST, simulator)
        if disturbances.sea is not None:
            disturbances.sea.waves.time[:] = 0.0
            simulator.set_waves(disturbances.sea.waves)
        self.time = 0.0
        self._velocity = (0.0, 0.0, 0.0)

    def step(self, pwm: Sequence[int], duration: float) -> SensorState:
        """Hold a PWM in us per channel, the motors' first, for `duration` s; return what the sensors read then.

        Raises:
            TrainingError: the motion left the finite numbers.
        """
        simulator, disturbances, row = self.simulator, self._disturbances, self._command[0]
        for channel, a in enumerate(self.motors.order):
            row[a] = self._commands[channel][min(pwm[channel], LONGEST)]
        disturbances.fail(simulator, self._command)
        self._float()
        simulator.step(self._command, duration)
        self.time += duration
        if self.time >= (self._task.C[0, C_STEPS] + 1) * self._task.duration:
            self._task.C[0, C_STEPS] += 1
            disturbances.move_current(simulator)
        return self._sense(duration)

    def _float(self) -> None:
        """Take away the buoyancy of what is above the surface."""
        simulator = self.simulator
        _, _, z, *attitude = simulator.pose[0].tolist()
        above = min(max(0.5 + z / self._height, 0.0), 1.0)
        if above == 0.0:
            simulator.external_wrench[0] = 0.0
            return
        buoyancy = above * self.vehicle.buoyancy * float(simulator.scales[0, _BUOYANCY])
        a, b, c = _to_body(attitude, (0.0, 0.0, -buoyancy))
        x, y, z = self._center
        simulator.external_wrench[0] = a, b, c, y * c - z * b, z * a - x * c, x * b - y * a

    def _sense(self, duration: float) -> SensorState:
        pose, motion = self.simulator.pose[0].tolist(), self.simulator.velocity[0].tolist()
        if not all(map(math.isfinite, pose)):
            raise TrainingError(f"{self.vehicle.name}: the position is not finite after {self.time:g} s")
        attitude = pose[3:]
        velocity = _to_world(attitude, motion[:3])
        # The mean acceleration of the step: what ArduSub integrates becomes the change of velocity, whatever happened in between.
        x, y, z = ((now - before) / duration for now, before in zip(velocity, self._velocity, strict=True))
        force = _to_body(attitude, (x, y, z + GRAVITY))
        self._velocity = velocity
        return SensorState(
            time=self.time,
            gyro=frd(motion[3:]),
            specific_force=frd(force),
            position=frames.ned(pose[:3]),
            velocity=frames.ned(velocity),
            quaternion=frames.ned_attitude(attitude),
            voltage=self.voltage,
            current=float(self.simulator.power[0]) / self.voltage,
        )


def frd(vector: Sequence[float]) -> Vector:
    """Return a vector (3,) forward, port, up as forward, starboard, down."""
    x, y, z = vector
    return x, -y, -z


def _to_world(attitude: Sequence[float], vector: Sequence[float]) -> Vector:
    """Return R vector; plain floats, because arrays of three cost ten times as much."""
    w, x, y, z = attitude
    a, b, c = vector
    # v + 2 w (q x v) + 2 q x (q x v)
    s, t, u = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + 2.0 * (w * s + y * u - z * t),
        b + 2.0 * (w * t + z * s - x * u),
        c + 2.0 * (w * u + x * t - y * s),
    )


def _to_body(attitude: Sequence[float], vector: Sequence[float]) -> Vector:
    """Return R' vector."""
    w, x, y, z = attitude
    return _to_world((w, -x, -y, -z), vector)


def _check_t200(motors: Motors) -> None:
    """Refuse thrusters that are far stronger than the T200 that is to drive them."""
    most = float(np.max(np.abs(motors.vehicle.force_limits)))
    strongest = float(t200_table()["force_N"][-1])
    if most > _STRONGER * strongest:
        raise ConfigError(
            f"vehicle={motors.vehicle.name}: a thruster gives {most:.0f} N, a T200 {strongest:.0f} N; type --thrust sheet"
        )


def _refuse_errors(disturbances: Disturbances) -> None:
    """Refuse what ArduSub has of its own: errors of its sensors, and delays."""
    for key, present in (("delay", disturbances.delayed), ("sensor", disturbances.misreads)):
        if present:
            raise ConfigError(
                f"disturbance.{key}: serve --face ardusub has none, ArduSub simulates its own sensors (SIM_ parameters); use"
                " currents, waves, faults and randomisation"
            )
