"""The failure of one actuator in an episode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import Fault
from auvbench.dynamics.random import FAULT, uniform4
from auvbench.errors import ConfigError, closest
from auvbench.tasks.disturbances.base import Disturbance
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row
from auvbench.vehicles.vehicle_model import VehicleModel

HEALTHY = 0
DEAD = 1
WEAK = 2
STUCK = 3
ANY = 4  # only in the parameters: one of the three modes is drawn with equal probability
MODES = ("none", "dead", "weak", "stuck", "any")


@row
def draw(e: Record, d: Record, p: Record, stream: int) -> None:
    """Draw whether, how and when an actuator fails; `d.actuator` is an index into the list of actuators that may fail."""
    fails, which, when, _ = uniform4(e.seed, FAULT | stream, 0, 0, e.episode, e.environment)
    how, _, _, _ = uniform4(e.seed, FAULT | stream, 1, 0, e.episode, e.environment)
    mode = p.mode
    if mode == ANY:
        mode = DEAD + int(3.0 * how)
    # Draws are strictly inside (0, 1): with probability 1 an actuator always fails, and with probability 0 never.
    d.mode = mode if fails < p.probability else HEALTHY
    d.actuator = int(p.candidates * which)
    time = p.time_low + (p.time_high - p.time_low) * when
    # Because of the margin, rounding cannot move a fault to the next step: 0.3 s at 10 Hz is step 3.
    d.begin = math.ceil(time * p.frequency - 1e-9)


@row
def act(e: Record, d: Record, p: Record, command: Any, effectiveness: Any) -> None:
    """Apply a fault that has begun.

    A dead thruster also draws no power: its command becomes 0. A stuck actuator holds the command that acts when
    the fault begins.
    """
    if d.mode == HEALTHY or e.steps < d.begin:
        return
    a = d.actuator
    if d.mode == DEAD:
        command[a] = 0.0
        effectiveness[a] = 0.0
    elif d.mode == WEAK:
        if d.begun == 0:
            effectiveness[a] *= p.factor
    elif d.begun == 0:
        d.held = command[a]
    else:
        command[a] = d.held
    d.begun = 1


class ActuatorFault(Disturbance):
    """The faults of N episodes.

    Raises:
        ConfigError: see `check`.
    """

    draw = staticmethod(draw)
    act = staticmethod(act)
    fields = (
        ("mode", "i8"),  # HEALTHY, or the kind of fault
        ("actuator", "i8"),
        ("begin", "i8"),  # agent step with which the fault begins
        ("begun", "i8"),  # 1 after the fault has begun
        ("held", "f8"),  # command that a stuck actuator holds
    )

    def own_parameters(self, settings: Fault) -> dict[str, Any]:
        self.candidates = candidates(settings, self.vehicle)
        return {
            "mode": MODES.index(settings.mode),
            "probability": settings.probability,
            "candidates": len(self.candidates),
            "time_low": settings.time,
            "time_high": settings.time if settings.time_high is None else settings.time_high,
            "factor": settings.factor,
            "frequency": self.task.frequency,
        }

    @staticmethod
    def check(settings: Fault, vehicle: VehicleModel) -> None:
        """Check that the vehicle has the actuator, and that an active fault's mode is possible for this actuator.

        Raises:
            ConfigError: the vehicle has no such actuator or no thrusters, or the mode needs a thruster.
        """
        if settings.active:
            candidates(settings, vehicle)
        else:
            _check_actuator(settings, vehicle)

    def draw_rows(self, indices: NDArray[np.int64]) -> None:
        super().draw_rows(indices)
        actuator = self.field["actuator"]
        actuator[indices] = self.candidates[actuator[indices]]


def _check_actuator(fault: Fault, vehicle: VehicleModel) -> None:
    names = vehicle.actuators
    if fault.actuator is not None and fault.actuator not in names:
        raise ConfigError(
            f"disturbance.fault.actuator={fault.actuator}: {vehicle.name} has no such actuator; "
            f"{closest(fault.actuator, names)}"
        )


def candidates(fault: Fault, vehicle: VehicleModel) -> NDArray[np.int64]:
    """Return the indices of the actuators that may fail.

    Raises:
        ConfigError: see `ActuatorFault.check`.
    """
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
            "this mode needs a thruster, so use disturbance.fault.mode=stuck"
        )
    return np.array([index], dtype=np.int64)
