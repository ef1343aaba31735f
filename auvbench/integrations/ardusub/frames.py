"""Match a vehicle's thrusters to the motors of ArduSub's frames, and convert PWM to forces.

Source of the factors: setup_motors in libraries/AP_Motors/AP_Motors6DOF.cpp. The same factors are in
libraries/SITL/SIM_Submarine.cpp, which defines their signs: a motor above 1500 us pushes along (forward,
lateral, -throttle) and turns along (roll, pitch, yaw), axes forward, starboard, down. This module imports no
compiled code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.dynamics.frames import flip
from auvbench.errors import ConfigError, closest
from auvbench.vehicles.curves import t200_table
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

NEUTRAL, LOW, HIGH = 1500, 1100, 1900
"""PWM in us without thrust, at full thrust astern, and at full thrust ahead (ArduSub's MOT_PWM_MIN and
MOT_PWM_MAX)
"""
SHORTEST, LONGEST = 1000, 2000
"""bounds in us of the pulses that drive a motor, both excluded; ArduPilot's own model ignores all other pulses"""
VOLTAGE = 16.0
"""V, supply voltage at which the T200's curve was measured"""
MOST = 12
"""largest number of motors that ArduSub drives (MOT_1_DIRECTION to MOT_12_DIRECTION)"""
THRUST = ("t200", "sheet")
"""curves that give a thruster's force for PWM: a T200's measured curve, or the thruster's own curve in the sheet"""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame of ArduSub."""

    name: str
    config: int
    """value of the parameter FRAME_CONFIG"""
    factors: tuple[tuple[float, float, float, float, float, float], ...]
    """factors of each motor: roll, pitch, yaw, throttle, forward, lateral"""

    @property
    def motors(self) -> int:
        return len(self.factors)

    @property
    def wrench_signs(self) -> Floats:
        """Return the signs of each motor's force and moment for PWM above 1500 us, in body axes FLU.

        The array has shape (motors, 6); a sign that the frame does not specify is 0.
        """
        roll, pitch, yaw, throttle, forward, lateral = np.array(self.factors).T
        return np.sign(flip(np.column_stack([forward, lateral, -throttle, roll, pitch, yaw])))


FRAMES = {
    frame.name: frame
    for frame in (
        Frame(
            "vectored",
            1,
            (
                (0.0, 0.0, 1.0, 0.0, -1.0, 1.0),
                (0.0, 0.0, -1.0, 0.0, -1.0, -1.0),
                (0.0, 0.0, -1.0, 0.0, 1.0, 1.0),
                (0.0, 0.0, 1.0, 0.0, 1.0, -1.0),
                (1.0, 0.0, 0.0, -1.0, 0.0, 0.0),
                (-1.0, 0.0, 0.0, -1.0, 0.0, 0.0),
            ),
        ),
        Frame(
            "vectored_6dof",
            2,
            (
                (0.0, 0.0, 1.0, 0.0, -1.0, 1.0),
                (0.0, 0.0, -1.0, 0.0, -1.0, -1.0),
                (0.0, 0.0, -1.0, 0.0, 1.0, 1.0),
                (0.0, 0.0, 1.0, 0.0, 1.0, -1.0),
                (1.0, -1.0, 0.0, -1.0, 0.0, 0.0),
                (-1.0, -1.0, 0.0, -1.0, 0.0, 0.0),
                (1.0, 1.0, 0.0, -1.0, 0.0, 0.0),
                (-1.0, 1.0, 0.0, -1.0, 0.0, 0.0),
            ),
        ),
    )
}
"""frames by name; `motors_of` matches their motors to thrusters by direction. FRAME_CONFIG 1 is ArduSub's default"""


@dataclass(frozen=True, slots=True, eq=False)
class Motors:
    """Thrusters of a vehicle in the order of ArduSub's motors 1, 2, ...; motor i is on channel i."""

    vehicle: VehicleModel
    frame: Frame | None
    """frame; None if the user gave the order"""
    order: tuple[int, ...]
    """(motors,) index of each motor's thruster among the vehicle's actuators"""
    signs: tuple[float, ...]
    """(motors,) 1 if the thruster pushes along its direction in the sheet for PWM above 1500 us, else -1"""

    def forces(self, pwm: ArrayLike, thrust: str = "t200", voltage: float = VOLTAGE) -> Floats:
        """Return the thrusters' steady forces in N for PWM in us.

        A force is positive along the thruster's direction in the sheet. PWM has shape (..., motors or more); the
        result has shape (..., n_u).
        """
        pulses = np.asarray(pwm, dtype=np.float64)
        out = np.zeros((*pulses.shape[:-1], len(self.vehicle.units)))
        for channel, (a, sign) in enumerate(zip(self.order, self.signs, strict=True)):
            pulse = pulses[..., channel]
            if thrust == "t200":
                out[..., a] = sign * t200_force(pulse, voltage)
            else:
                command = np.clip((pulse - NEUTRAL) / (HIGH - NEUTRAL), -1.0, 1.0)
                force = self.vehicle.units[a].force(sign * command) * (voltage / VOLTAGE)
                out[..., a] = np.where(driven(pulse), force, 0.0)
        return out


def driven(pwm: ArrayLike) -> NDArray[np.bool_]:
    """Return whether each channel's PWM in us is a pulse that drives a motor, as an array with the shape of `pwm`."""
    pulses = np.asarray(pwm)
    return np.asarray((pulses > SHORTEST) & (pulses < LONGEST))


def driven_pulse(pwm: int) -> bool:
    """Return whether one channel's PWM in us drives a motor; `driven` is the same function for arrays."""
    return SHORTEST < pwm < LONGEST


def t200_force(pwm: ArrayLike, voltage: float = VOLTAGE) -> Floats:
    """Return the force in N of a T200 for PWM in us, in the shape of `pwm`.

    The force is Blue Robotics' curve at 16 V, scaled in proportion to the voltage. The curve includes the dead band, 1472 to 1528 us.
    Without a pulse the force is 0.
    """
    table = t200_table()
    pulses = np.asarray(pwm, dtype=np.float64)
    force = np.interp(pulses, table["pwm_us"], table["force_N"]) * (voltage / VOLTAGE)
    return np.asarray(np.where(driven(pulses), force, 0.0))


def motors_of(vehicle: VehicleModel, given: Sequence[str] | None = None) -> Motors:
    """Return a vehicle's thrusters in the order of ArduSub's motors.

    Args:
        vehicle: vehicle with only thrusters.
        given: thruster names in the order of the motors. A name starts with `-` if PWM above 1500 us pushes against the
            thruster's direction in the sheet. None: match the thrusters to a frame by their directions.

    Raises:
        ConfigError: the vehicle has other actuators than thrusters, has too many thrusters, or matches no frame;
            or `given` does not name each thruster once.
    """
    if vehicle.others:
        raise ConfigError(
            f"vehicle={vehicle.name}: has {', '.join(vehicle.others)}; ArduSub's frames have only "
            "thrusters; use a vehicle with only thrusters, such as bluerov2"
        )
    if len(vehicle.actuators) > MOST:
        raise ConfigError(
            f"vehicle={vehicle.name}: has {len(vehicle.actuators)} thrusters, but ArduSub drives at most {MOST}"
        )
    if given is not None:
        return _given(vehicle, given)
    for frame in FRAMES.values():
        if (match := _matched(vehicle, frame)) is not None:
            return Motors(vehicle, frame, *match)
    known = ", ".join(f"{frame.name} ({frame.motors} motors)" for frame in FRAMES.values())
    raise ConfigError(
        f"vehicle={vehicle.name}: its thrusters fit none of ArduSub's frames {known}; name them in the order"
        f" of ArduSub's motors 1, 2, ..., with - where more PWM pushes backwards: --motors={','.join(vehicle.actuators)}"
    )


def _matched(vehicle: VehicleModel, frame: Frame) -> tuple[tuple[int, ...], tuple[float, ...]] | None:
    """Return the order and signs that match the thrusters to the frame's motors; None if they do not match."""
    columns = vehicle.allocation.T
    if len(columns) != frame.motors:
        return None
    order, signs = [], []
    for wanted in frame.wrench_signs:
        said = wanted != 0.0
        pushes = np.sign(columns[:, said]) @ wanted[said]
        fitting = np.flatnonzero(np.abs(pushes) == np.count_nonzero(said))
        if len(fitting) != 1:
            return None
        order.append(int(fitting[0]))
        signs.append(float(np.sign(pushes[fitting[0]])))
    return (tuple(order), tuple(signs)) if len(set(order)) == frame.motors else None


def _given(vehicle: VehicleModel, names: Sequence[str]) -> Motors:
    plain = [name.removeprefix("-") for name in names]
    for name in plain:
        if name not in vehicle.actuators:
            raise ConfigError(
                f"--motors: {vehicle.name} has no thruster {name!r}; {closest(name, vehicle.actuators)}"
            )
    if sorted(plain) != sorted(vehicle.actuators):
        raise ConfigError(
            f"--motors={','.join(names)}: must name each thruster of {vehicle.name} once: {','.join(vehicle.actuators)}"
        )
    order = tuple(vehicle.actuators.index(name) for name in plain)
    return Motors(vehicle, None, order, tuple(-1.0 if name.startswith("-") else 1.0 for name in names))
