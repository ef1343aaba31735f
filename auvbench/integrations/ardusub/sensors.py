"""Compute the readings of ArduSub's sensors for one vehicle of the embedded simulator."""

from __future__ import annotations

import math
from collections.abc import Sequence

from auvbench.dynamics import frames
from auvbench.errors import TrainingError
from auvbench.integrations.ardusub.frames import VOLTAGE
from auvbench.integrations.ardusub.protocol import SensorState
from auvbench.simulators.fossen import FossenSimulator

Vector = tuple[float, float, float]

GRAVITY = 9.80665
"""gravity in m/s2 to which ArduPilot calibrates accelerometers (GRAVITY_MSS); independent of the sheet's value"""


class Sensors:
    """Sensors of a simulator's first vehicle; call `read` once after each step.

    Args:
        simulator: simulator of one vehicle.
        voltage: voltage of the battery, V.
    """

    def __init__(self, simulator: FossenSimulator, voltage: float = VOLTAGE) -> None:
        self.voltage = voltage
        self.time = 0.0
        """time since the reset, s"""
        self._simulator = simulator
        self._velocity: Vector = (0.0, 0.0, 0.0)
        """velocity at the last reading, m/s in the world"""

    def reset(self) -> SensorState:
        """Restart at time 0; return the readings of a vehicle that is held in place."""
        self.time = 0.0
        attitude, motion = self._simulator.pose[0, 3:].tolist(), self._simulator.velocity[0].tolist()
        self._velocity = to_world(attitude, motion[:3])
        return self._state((0.0, 0.0, 0.0))

    def read(self, duration: float) -> SensorState:
        """Return the readings after a step of `duration` s.

        Raises:
            TrainingError: the motion is not finite.
        """
        self.time += duration
        before = self._velocity
        pose, motion = self._simulator.pose[0].tolist(), self._simulator.velocity[0].tolist()
        if not all(map(math.isfinite, pose)):
            name = self._simulator.vehicle.name
            raise TrainingError(f"{name}: the position is not finite after {self.time:g} s")
        self._velocity = now = to_world(pose[3:], motion[:3])
        # The mean acceleration of the step: ArduSub's integral then equals the change of velocity, even if the
        # acceleration changed within the step.
        x, y, z = ((a - b) / duration for a, b in zip(now, before, strict=True))
        return self._state((x, y, z))

    def _state(self, acceleration: Vector) -> SensorState:
        pose, motion = self._simulator.pose[0].tolist(), self._simulator.velocity[0].tolist()
        attitude = pose[3:]
        x, y, z = acceleration
        return SensorState(
            time=self.time,
            gyro=frd(motion[3:]),
            specific_force=frd(to_body(attitude, (x, y, z + GRAVITY))),
            position=frames.ned(pose[:3]),
            velocity=frames.ned(self._velocity),
            quaternion=frames.ned_attitude(attitude),
            voltage=self.voltage,
            current=float(self._simulator.power[0]) / self.voltage,
        )


def frd(vector: Sequence[float]) -> Vector:
    """Convert a vector (3,) from forward, port, up to forward, starboard, down."""
    x, y, z = vector
    return x, -y, -z


def to_world(attitude: Sequence[float], vector: Sequence[float]) -> Vector:
    """Return a vector (3,) rotated from body to world by `attitude` (w, x, y, z).

    Uses plain floats, because arrays of three numbers are ten times as slow.
    """
    w, x, y, z = attitude
    a, b, c = vector
    # v + 2 w (q x v) + 2 q x (q x v)
    s, t, u = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + 2.0 * (w * s + y * u - z * t),
        b + 2.0 * (w * t + z * s - x * u),
        c + 2.0 * (w * u + x * t - y * s),
    )


def to_body(attitude: Sequence[float], vector: Sequence[float]) -> Vector:
    """Return a vector (3,) rotated from world to body by `attitude` (w, x, y, z)."""
    w, x, y, z = attitude
    return to_world((w, -x, -y, -z), vector)
