"""Manoeuvres that excite a vehicle for identification, and logs of flying them in the simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.identification.log import CHANNELS, Log, checked
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.inspect import AXES
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

SHORT, LONG = 0.4, 3.0
"""Shortest and longest time in s that a telegraph signal stays at one level."""
NEUTRAL = 0.5
"""Time in s without a command at the start."""
INTERVAL = 0.02
"""Time in s between two rows of inputs."""
NOISE: Mapping[str, float] = {
    **dict.fromkeys(("x", "y", "z"), 0.01),
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.005),
    **dict.fromkeys(("u", "v", "w"), 0.01),
    **dict.fromkeys(("p", "q", "r"), 0.005),
}
"""Standard deviations of a usual set of sensors (pressure, attitude filter, DVL, gyro), in the units of `log.CHANNELS`."""


def direction(vehicle: VehicleModel, axis: str) -> FloatArray:
    """Return the forces (n_u,) in N that push along one axis, as far as the thrusters can, with a thruster at its limit."""
    B = vehicle.allocation
    wanted = np.zeros(6)
    wanted[AXES.index(axis)] = 1.0
    rows = [AXES.index(name) for name in vehicle.controllable]
    force = np.linalg.pinv(B[rows]) @ wanted[rows]
    limits = vehicle.force_limits
    reach = np.where(force >= 0.0, limits[:, 1], -limits[:, 0])
    load = np.abs(force) / np.where(reach > 0.0, reach, np.inf)
    return np.asarray(force / max(float(load.max(initial=0.0)), 1e-12))


def telegraph(
    vehicle: VehicleModel,
    axes: Sequence[str],
    duration: float,
    amplitude: float,
    generator: np.random.Generator,
) -> FloatArray:
    """Return commands (T, n_u) every `INTERVAL` s of random levels for one axis after another.

    Args:
        vehicle: vehicle that flies it.
        axes: axes in their order; each gets the same share of the time.
        duration: s.
        amplitude: largest share of the force along an axis, up to 1.
        generator: source of the times and levels.
    """
    rows = round(duration / INTERVAL)
    force = np.zeros((rows, len(vehicle.units)))
    share = rows // len(axes)
    for number, axis in enumerate(axes):
        push = direction(vehicle, axis)
        at, sign = number * share, 1.0
        if number == 0:  # A log starts at rest, so that what came before it is known.
            at = min(round(NEUTRAL / INTERVAL), rows // 2)
        while at < (number + 1) * share:
            hold = max(1, round(float(generator.uniform(SHORT, LONG)) / INTERVAL))
            end = min(at + hold, (number + 1) * share)
            # Two levels of each sign: the ratio of linear to quadratic damping needs two speeds.
            force[at:end] = sign * amplitude * float(generator.choice([0.4, 1.0])) * push
            at, sign = end, -sign
    return vehicle.action(force)


def fly(
    vehicle: VehicleModel,
    command: FloatArray,
    generator: np.random.Generator,
    *,
    noise: Mapping[str, float] = NOISE,
    every: int = 2,
    name: str = "simulated",
    delay: float = 0.0,
) -> Log:
    """Return the log of commands (T, n_u) that the simulated vehicle executes from rest, with noise on what is measured.

    Args:
        vehicle: vehicle to simulate.
        command: commands every `INTERVAL` s.
        generator: source of the noise.
        noise: standard deviation of the channels that are measured.
        every: rows of inputs for each row of measurements.
        name: name of the log.
        delay: time in s from a command to its execution, rounded to rows.
    """
    simulator = FossenSimulator(vehicle, 1, 0.005)
    simulator.pose[:, 2] = -10.0
    shift = round(delay / INTERVAL)
    late = np.vstack([np.repeat(command[:1] * 0.0, shift, axis=0), command])
    states = np.empty((len(command), len(CHANNELS)))
    for k in range(len(command)):
        states[k] = np.concatenate(
            [simulator.pose[0, :3], frames.euler(simulator.pose[0, 3:]), simulator.velocity[0]]
        )
        simulator.step(late[k : k + 1], INTERVAL)
    states[:, 3:6] = np.unwrap(states[:, 3:6], axis=0)
    measured = np.full(states.shape, np.nan)
    for channel, spread in noise.items():
        column = CHANNELS.index(channel)
        measured[::every, column] = states[::every, column] + spread * generator.standard_normal(
            len(states[::every])
        )
    return checked(
        Log(
            name=name,
            digest="",
            time=INTERVAL * np.arange(len(command), dtype=np.float64),
            kind="command",
            actuators=vehicle.actuators,
            inputs=command,
            measured=measured,
        )
    )
