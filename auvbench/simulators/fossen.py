"""The embedded simulator: Fossen's equations compiled for many vehicles at once."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.config.schema import SCALES
from auvbench.config.simulators import CAPABILITIES
from auvbench.dynamics import layout
from auvbench.dynamics.kernel import PARAMETER_ROWS, advance
from auvbench.dynamics.rigid_body import GZ_SIM_8_11
from auvbench.dynamics.waves import Waves, still
from auvbench.errors import ConfigError
from auvbench.simulators.base import write_current
from auvbench.simulators.packing import discretise, geometry_table, parameter_rows, unit_table
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer[Any]]

_STATE = (
    "pose",
    "velocity",
    "actuators",
    "command_force",
    "power",
    "effectiveness",
    "current",
    "external_wrench",
    "scales",
)
DISCRETISATIONS = 64
"""Substep lengths for which exact discretisations of the actuators are kept."""


THREADED = 1024
"""vehicles from which a second thread pays (docs/performance.md)"""

T = TypeVar("T")


@cache
def _threads(count: int, _process: int) -> ThreadPoolExecutor:
    """Return threads that all simulators of this process share; those of its parent did not survive a fork."""
    return ThreadPoolExecutor(count, thread_name_prefix="simulator")


class FossenSimulator:
    """N copies of a vehicle, integrated with RK4 in substeps no longer than `max_step`.

    A vehicle's trajectory is the same to the last bit in a batch of any size, on any number of threads.

    Args:
        vehicle: the model to simulate.
        n: number of vehicles.
        max_step: longest substep in s; a step of `duration` takes ceil(duration / max_step) equal ones.
        threads: that share the vehicles, if there are at least `THREADED`.

    Attributes beyond `Simulator`'s:
        current: (n, 8) velocity of the current at the top (3), difference to the bottom (3), z of the top,
            1 / thickness. `set_current` writes it; writing the first three columns in place is allowed.
        external_wrench: (n, 6) N and N m in body axes at the body origin, added to the actuators'; kept until
            changed.
        scales: (n, 6) as given to `reset`.

    """

    capabilities = CAPABILITIES["fossen"]

    def __init__(self, vehicle: VehicleModel, n: int, max_step: float = 0.01, threads: int = 1) -> None:
        if n < 1:
            raise ConfigError(f"number of vehicles is {n}: it must be at least 1")
        if not (max_step > 0.0 and math.isfinite(max_step)):
            raise ConfigError(f"simulator.max_step is {max_step}: it must be a positive number of seconds")
        self.vehicle = vehicle
        self.n = n
        self.max_step = max_step
        n_u = len(vehicle.units)
        self._table, self._curves = unit_table(vehicle)
        self._geometry = geometry_table(vehicle)
        self._rest = np.concatenate([np.zeros(0), *(unit.rest for unit in vehicle.units)])
        self._flags = (
            bool(np.any(np.diag(np.diag(vehicle.M_A)) != vehicle.M_A)),
            any(unit.rest.size > 0 for unit in vehicle.units),
            bool(vehicle.others),
            vehicle.added_mass_coriolis and vehicle.plugin == GZ_SIM_8_11,
        )
        self._discrete: dict[float, FloatArray] = {}
        self._n_blocks = -(-n // layout.LANES)
        shares = np.linspace(0, self._n_blocks, (threads if n >= THREADED else 1) + 1).astype(int).tolist()
        self._ranges = [
            (first * layout.LANES, min(last * layout.LANES, n))
            for first, last in pairwise(shares)
            if first < last
        ]

        self.pose = np.zeros((n, 7))
        self.pose[:, 3] = 1.0
        self.velocity = np.zeros((n, 6))
        self.actuators = np.tile(self._rest, (n, 1))
        self.command_force = np.zeros((n, n_u))
        self.power = np.zeros(n)
        self.effectiveness = np.ones((n, n_u))
        self.current = np.zeros((n, layout.CURRENT_COLUMNS))
        self.external_wrench = np.zeros((n, 6))
        self.set_waves(still(n))
        self.scales = np.ones((n, len(SCALES)))
        # One block of parameters serves all vehicles until one of them differs.
        rows = parameter_rows(vehicle, np.ones((1, len(SCALES))))
        self._parameters = np.repeat(rows.T, layout.LANES, axis=1).reshape(1, -1)
        self._scaled = False

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6); see `Simulator.reset`."""
        self.pose[indices] = pose
        self.velocity[indices] = velocity
        self.actuators[indices] = self._rest
        self.command_force[indices] = 0.0
        self.power[indices] = 0.0
        self.effectiveness[indices] = 1.0
        if scales is not None or self._scaled:
            self.scales[indices] = 1.0 if scales is None else scales
            self._load_parameters(np.asarray(indices))

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current of all vehicles; see `Simulator.set_current`."""
        write_current(self.current, velocity, bottom, depths)

    def set_waves(self, waves: Waves) -> None:
        """Set the waves of all vehicles; see `WavySimulator.set_waves`."""
        self._waves = waves
        self._wave_arguments = waves.components, waves.rays, waves.time

    def substeps(self, duration: float) -> int:
        """Number of equal substeps that make up `duration` seconds."""
        # The margin keeps 1/25 s at four substeps of .01 s despite the rounding of the quotient.
        return max(1, math.ceil(duration / self.max_step - 1e-9))

    def step(self, command: ArrayLike, duration: float) -> None:
        """Hold normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds."""
        action = np.ascontiguousarray(command, dtype=np.float64)
        if action.shape != self.command_force.shape:
            raise ValueError(f"command has shape {action.shape}, expected {self.command_force.shape}")
        self.each(lambda start, stop: advance(*self.kernel_arguments(action, duration, start, stop)))
        self._waves.time += duration

    def each(self, function: Callable[[int, int], T]) -> list[T]:
        """Return `function(start, stop)` of each thread's range of vehicles; the calling thread does the first."""
        own, *others = self._ranges
        if not others:
            return [function(*own)]
        threads = _threads(len(others), os.getpid())
        jobs = [threads.submit(function, *bounds) for bounds in others]
        return [function(*own), *(job.result() for job in jobs)]

    def kernel_arguments(
        self, command: FloatArray, duration: float, start: int, stop: int
    ) -> tuple[Any, ...]:
        """Return the arguments of `dynamics.kernel.advance` for the vehicles start .. stop - 1, multiples of LANES or `n`.

        Compiled callers may keep them: the arrays stay the same until vehicles get other scales.
        """
        substeps = self.substeps(duration)
        h = duration / substeps
        discrete = self._discrete.get(h)
        if discrete is None:
            if len(self._discrete) >= DISCRETISATIONS:
                self._discrete.clear()
            discrete = self._discrete[h] = discretise(self.vehicle, h / 2.0)
        return (
            self.pose,
            self.velocity,
            self.actuators,
            command,
            self.effectiveness,
            self.command_force,
            self.power,
            self.current,
            self.external_wrench,
            self._wave_arguments,
            self._parameters,
            self._table,
            self._geometry,
            discrete,
            self._curves,
            self._flags,
            (start // layout.LANES, -(-stop // layout.LANES)),
            substeps,
            h,
        )

    def state_dict(self) -> dict[str, FloatArray]:
        """Copies of all that an exact resume needs."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Return to a state that `state_dict` gave."""
        for name in _STATE:
            getattr(self, name)[...] = state[name]
        if self._scaled or np.any(self.scales != 1.0):
            self._load_parameters(np.arange(self.n))

    def _load_parameters(self, lanes: IntArray) -> None:
        """Write the parameters of vehicles `lanes` (k,) as `scales` has them."""
        if not self._scaled:
            self._scaled = True
            self._parameters = np.repeat(self._parameters, self._n_blocks, axis=0)
        blocks = self._parameters.reshape(self._n_blocks, PARAMETER_ROWS, layout.LANES)
        rows = parameter_rows(self.vehicle, self.scales[lanes])
        blocks[lanes // layout.LANES, :, lanes % layout.LANES] = rows
