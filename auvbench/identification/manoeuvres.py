"""Simulate logs of a vehicle's manoeuvres for identification."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics import frames
from auvbench.identification.log import CHANNELS, Log, checked
from auvbench.simulators.fossen import FossenSimulator
from auvbench.vehicles.signals import INTERVAL
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]

NOISE: Mapping[str, float] = {
    **dict.fromkeys(("x", "y", "z"), 0.01),
    **dict.fromkeys(("roll", "pitch", "yaw"), 0.005),
    **dict.fromkeys(("u", "v", "w"), 0.01),
    **dict.fromkeys(("p", "q", "r"), 0.005),
}
"""Standard deviations of a usual set of sensors (pressure, attitude filter, DVL, gyro), in the units of `log.CHANNELS`."""


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
    """Return the log of commands (T, n_u) that the simulated vehicle executes from rest, with noise on the measurements.

    Args:
        vehicle: vehicle to simulate.
        command: commands every `INTERVAL` s.
        generator: source of the noise.
        noise: standard deviation of each measured channel, by name.
        every: number of rows of inputs for each row of measurements.
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
