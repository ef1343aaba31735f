"""Push a vehicle back and forth along its axes; `auvbench identify` fits the vehicle's parameters to a log of this motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import ConfigError, closest
from auvbench.vehicles import signals
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

NAME = "excite"
"""Word that selects this controller on the command line, in place of a controller's name"""
SECONDS = 60.0
"""default duration for each axis, s"""
AMPLITUDE = 0.15
"""default amplitude, as a fraction of the largest force along the axis"""
REACH = 5.0
"""default of the largest distance from the place of arming, m; at a larger distance, the pilot disarms"""
FREQUENCY = 20.0
"""default rate of commands, Hz"""
SLOWEST = 5.0
"""lowest allowed rate of commands, Hz; at this rate, the shortest push lasts two commands"""


class Excite:
    """Open-loop controller of a pilot: it ignores the observation and pushes along one axis after another.

    If the thrusters push along heave, a constant heave force balances the sheet's net weight (weight less buoyancy).

    Args:
        vehicle: vehicle that the pilot steers.
        axes: axes in the order of the pushes, out of surge, sway, heave, roll, pitch and yaw.
        amplitude: largest push as a fraction of the largest force along the axis, at most 1; each push has 40 or 100 % of
            the force of the largest push.
        seconds: duration for each axis, s.
        frequency: rate of commands, Hz.

    Raises:
        ConfigError: the thrusters cannot push along one of the axes.
    """

    def __init__(
        self, vehicle: VehicleModel, axes: Sequence[str], amplitude: float, seconds: float, frequency: float
    ) -> None:
        for axis in axes:
            if axis not in vehicle.controllable:
                raise ConfigError(
                    f"--axis {axis}: {vehicle.name} cannot push along it; {closest(axis, vehicle.controllable)}"
                )
        duration = seconds * len(axes)
        lift = float(vehicle.weight - vehicle.buoyancy)
        commands = signals.telegraph(vehicle, axes, duration, amplitude, np.random.default_rng(0), lift=lift)
        self.steps = round(duration * frequency)
        rows = np.arange(self.steps) / (frequency * signals.INTERVAL)
        self._commands = commands[np.minimum(rows.astype(np.int64), len(commands) - 1)]
        self._step = 0

    def reset(self, episodes: NDArray[np.int64]) -> None:
        """Start again with the first command."""
        self._step = 0

    def act(self, observation: NDArray[np.float32]) -> Floats:
        """Return the next action (1, n_u) in [-1, 1]; zeros after the last command."""
        step, self._step = self._step, self._step + 1
        if step >= self.steps:
            return np.zeros((1, self._commands.shape[1]))
        return self._commands[step : step + 1]
