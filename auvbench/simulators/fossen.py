"""Simulate many vehicles at once with Fossen's compiled equations, and convert a vehicle to the kernel's arrays."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.config import simulators
from auvbench.config.schema import SCALES
from auvbench.dynamics import layout
from auvbench.dynamics.kernel import PARAMETER_ROWS, advance
from auvbench.dynamics.rigid_body import GZ_SIM_8_11, rigid_body_mass
from auvbench.dynamics.waves import Waves, still
from auvbench.simulators.base import VehicleBatch
from auvbench.vehicles.actuators import Thruster
from auvbench.vehicles.curves import Lag, t200_power
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
DURATIONS = 64
"""number of step durations for which exact discretisations of the actuators are kept"""


THREADED = 1024
"""smallest number of vehicles for which a second thread pays (docs/performance.md)"""

T = TypeVar("T")


@cache
def _threads(count: int, _process: int) -> ThreadPoolExecutor:
    """Return threads that all simulators of this process share; threads of the parent process do not survive
    a fork.
    """
    return ThreadPoolExecutor(count, thread_name_prefix="simulator")


class FossenSimulator(VehicleBatch):
    """N copies of a vehicle, integrated with RK4 in substeps no longer than `max_step`.

    A vehicle's trajectory has the same bits in a batch of any size and with any number of threads.

    Args:
        vehicle: vehicle to simulate.
        n: number of vehicles.
        max_step: longest substep in s; a step of `duration` takes ceil(duration / max_step) equal ones.
        threads: number of threads that share the vehicles, if there are at least `THREADED` vehicles.
    """

    capabilities = simulators.fossen.capabilities

    def __init__(self, vehicle: VehicleModel, n: int, max_step: float = 0.01, threads: int = 1) -> None:
        super().__init__(vehicle, n, max_step)
        self._table, self._curves = unit_table(vehicle)
        self._geometry = geometry_table(vehicle)
        self._flags = (
            bool(np.any(np.diag(np.diag(vehicle.M_A)) != vehicle.M_A)),
            any(unit.rest.size > 0 for unit in vehicle.units),
            bool(vehicle.others),
            vehicle.added_mass_coriolis and vehicle.plugin == GZ_SIM_8_11,
        )
        self._plans: dict[float, tuple[int, float, FloatArray]] = {}
        """by duration of a step in s: substeps, their length in s, and the actuators' discretisation for half
        a substep
        """
        self._n_blocks = -(-n // layout.LANES)
        shares = np.linspace(0, self._n_blocks, (threads if n >= THREADED else 1) + 1).astype(int).tolist()
        self._ranges = [
            (first * layout.LANES, min(last * layout.LANES, n))
            for first, last in pairwise(shares)
            if first < last
        ]
        self.set_waves(still(n))
        # One block of parameters serves all vehicles until one of them differs.
        rows = parameter_rows(vehicle, np.ones((1, len(SCALES))))
        self._parameters = np.repeat(rows.T, layout.LANES, axis=1).reshape(1, -1)
        self._scaled = False

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6); see `Simulator.reset`."""
        self._place(indices, pose, velocity)
        if scales is not None or self._scaled:
            self.scales[indices] = 1.0 if scales is None else scales
            self._load_parameters(np.asarray(indices))

    def set_waves(self, waves: Waves) -> None:
        """Set the waves of all vehicles; see `WavySimulator.set_waves`."""
        self._waves = waves
        self._wave_arguments = waves.components, waves.rays, waves.time

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds."""
        action = np.ascontiguousarray(command, dtype=np.float64)
        if action.shape != self.command_force.shape:
            raise ValueError(f"command has shape {action.shape}, expected {self.command_force.shape}")
        self.each(lambda start, stop: self.advance(action, duration, start, stop))
        self._waves.time += duration

    def each(self, function: Callable[[int, int], T]) -> list[T]:
        """Return `function(start, stop)` for each thread's range of vehicles; the calling thread does the
        first range.
        """
        own, *others = self._ranges
        if not others:
            return [function(*own)]
        threads = _threads(len(others), os.getpid())
        jobs = [threads.submit(function, *bounds) for bounds in others]
        return [function(*own), *(job.result() for job in jobs)]

    def advance(self, command: FloatArray, duration: float, start: int, stop: int) -> None:
        """Apply commands (n, n_u) for `duration` s to the vehicles start .. stop - 1, multiples of LANES or `n`."""
        plan = self._plans.get(duration)
        if plan is None:
            if len(self._plans) >= DURATIONS:
                self._plans.clear()
            substeps = self.substeps(duration)
            h = duration / substeps
            plan = self._plans[duration] = substeps, h, discretise(self.vehicle, h / 2.0)
        substeps, h, discrete = plan
        advance(
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
        """Return copies of all arrays that an exact resume needs."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Restore a state from `state_dict`."""
        for name in _STATE:
            getattr(self, name)[...] = state[name]
        if self._scaled or np.any(self.scales != 1.0):
            self._load_parameters(np.arange(self.n))

    def _load_parameters(self, lanes: IntArray) -> None:
        """Write the parameters of vehicles `lanes` (k,) for their `scales`."""
        if not self._scaled:
            self._scaled = True
            self._parameters = np.repeat(self._parameters, self._n_blocks, axis=0)
        blocks = self._parameters.reshape(self._n_blocks, PARAMETER_ROWS, layout.LANES)
        rows = parameter_rows(self.vehicle, self.scales[lanes])
        blocks[lanes // layout.LANES, :, lanes % layout.LANES] = rows


def make(settings: simulators.Fossen, vehicle: VehicleModel, n: int, longest: float) -> FossenSimulator:
    """Return the simulator of a configuration; see `config.simulators.SimulatorSpec.factory`."""
    return FossenSimulator(vehicle, n, min(settings.max_step, longest), settings.threads)


def parameter_rows(vehicle: VehicleModel, scales: FloatArray) -> FloatArray:
    """Return parameters (k, PARAMETER_ROWS) of vehicles with properties scaled by `scales` (k, 6)."""
    mass, buoyancy, inertia, added, damping, thrust = (scales[:, j, None] for j in range(6))
    r_g = vehicle.center_of_gravity
    no_inertia = np.zeros((3, 3))
    M_mass = rigid_body_mass(vehicle.mass, r_g, no_inertia)
    M_inertia = rigid_body_mass(0.0, r_g, vehicle.inertia)
    M_RB = mass[..., None] * M_mass + inertia[..., None] * M_inertia
    M_A = added[..., None] * vehicle.M_A
    rows = np.zeros((scales.shape[0], PARAMETER_ROWS))

    def put(row: int, values: NDArray[np.floating[Any]]) -> None:
        first = row - layout.PARAMETERS
        rows[:, first : first + values.shape[1]] = values

    upper = np.triu_indices(6)
    strict = np.triu_indices(6, 1)
    angular = M_RB[:, 3:, 3:]
    coriolis = vehicle.coriolis_sign * M_A
    put(layout.MASS, M_RB[:, :1, 0])
    put(layout.MOMENT, mass * (vehicle.mass * r_g))
    put(layout.INERTIA, angular[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    put(layout.ADDED, np.diagonal(M_A, axis1=1, axis2=2))
    put(layout.CORIOLIS, np.diagonal(coriolis, axis1=1, axis2=2))
    put(layout.LINEAR, damping * vehicle.linear_damping)
    put(layout.QUADRATIC, damping * vehicle.quadratic_damping)
    weight, lift = mass * vehicle.weight, buoyancy * vehicle.buoyancy
    put(layout.NET, lift - weight)
    put(layout.LEVER, lift * vehicle.center_of_buoyancy - weight * r_g)
    put(layout.INVERSE, np.linalg.inv(M_RB + M_A)[:, upper[0], upper[1]])
    put(layout.ADDED_OFF, M_A[:, strict[0], strict[1]])
    put(layout.CORIOLIS_OFF, coriolis[:, strict[0], strict[1]])
    put(layout.THRUST, thrust)
    displaced = lift / vehicle.gravity
    put(layout.DISPLACED, np.hstack([displaced, displaced * vehicle.center_of_buoyancy]))
    return rows


def unit_table(vehicle: VehicleModel) -> tuple[FloatArray, FloatArray]:
    """Return the table of actuators (n_u, ACTUATOR_COLUMNS) and the table of curves (1 + curves, points).

    Row 0 of the curves is electrical power over force: the largest force F, then powers at equally spaced
    forces from -F to F. Each other row starts with its number of entries.
    """
    table = np.zeros((len(vehicle.units), layout.ACTUATOR_COLUMNS))
    largest, power = t200_power()
    curves = [np.concatenate(([largest], power))]
    state = 0
    for row, unit in zip(table, vehicle.units, strict=True):
        row[layout.KIND] = unit.code
        row[layout.CURVE] = unit.curve.code
        row[layout.LOW], row[layout.HIGH] = unit.curve.limits
        row[layout.NEUTRAL] = unit.curve.neutral
        if (values := unit.curve.entries).size:
            row[layout.TABLE] = len(curves)
            curves.append(np.concatenate(([values.size], values)))
        row[layout.ORDER] = unit.rest.size
        row[layout.FIRST_STATE] = state
        state += unit.rest.size
        row[layout.RATE] = unit.rate
        for column, value in unit.coefficients().items():
            row[column] = value
    packed = np.zeros((len(curves), max(curve.size for curve in curves)))
    for target, curve in zip(packed, curves, strict=True):
        target[: curve.size] = curve
    return table, packed


def geometry_table(vehicle: VehicleModel) -> FloatArray:
    """Return the table of geometry (n_u, GEOMETRY_COLUMNS)."""
    table = np.zeros((len(vehicle.units), layout.GEOMETRY_COLUMNS))
    table[:, :6] = vehicle.allocation.T
    for row, unit in zip(table, vehicle.units, strict=True):
        if not isinstance(unit, Thruster):
            row[layout.POSITION : layout.POSITION + 3] = unit.position
            row[layout.AXIS : layout.AXIS + 3] = unit.direction
        for column, value in unit.geometry(vehicle.density, vehicle.gravity).items():
            row[column] = value
    return table


def discretise(vehicle: VehicleModel, duration: float) -> FloatArray:
    """Return the exact discretisations (n_u, DISCRETE_COLUMNS) of all actuators for a duration in s."""
    table = np.zeros((len(vehicle.units), layout.DISCRETE_COLUMNS))
    table[:, layout.HALF_STEP] = duration
    done: dict[Lag, tuple[FloatArray, FloatArray]] = {}  # a group of thrusters shares its lag
    for row, unit in zip(table, vehicle.units, strict=True):
        order = unit.lag.order
        if order == 0:
            row[layout.DISCRETE_C] = 1.0  # a rate-limited actuator's state is its output
            continue
        if unit.lag not in done:
            done[unit.lag] = unit.lag.discretise(duration)
        A, B = done[unit.lag]
        square = np.zeros((3, 3))
        square[:order, :order] = A
        row[:9] = square.ravel()
        row[layout.DISCRETE_B : layout.DISCRETE_B + order] = B
        row[layout.DISCRETE_C : layout.DISCRETE_C + order] = unit.lag.C
    return table
