"""Simulate many vehicles at once with Fossen's compiled equations, and convert a vehicle to the kernel's arrays."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.config import simulators
from auvbench.config.schema import SCALES
from auvbench.dynamics import layout
from auvbench.dynamics.kernel import advance
from auvbench.dynamics.rigid_body import GZ_SIM_8_11, rigid_body_mass
from auvbench.dynamics.waves import Waves, still
from auvbench.simulators.base import VehicleBatch
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
"""Number of step durations for which exact discretisations of the actuators are stored"""


THREADED = 1024
"""Smallest number of vehicles for which a second thread is faster (docs/performance.md)"""

T = TypeVar("T")


@cache
def _threads(count: int, _process: int) -> ThreadPoolExecutor:
    """Return `count` threads that all simulators of a process share. `_process` is the process id: threads do not survive a
    fork, so a forked process needs its own threads.
    """
    return ThreadPoolExecutor(count, thread_name_prefix="simulator")


class FossenSimulator(VehicleBatch):
    """N copies of a vehicle, integrated with RK4 in substeps no longer than `max_step`.

    A vehicle's trajectory is bit-identical for any batch size and any number of threads.

    Args:
        vehicle: vehicle to simulate.
        n: number of vehicles.
        max_step: longest substep in s; a step of `duration` s consists of ceil(duration / max_step) equal substeps.
        threads: number of threads that share the vehicles, if there are at least `THREADED` vehicles.
    """

    capabilities = simulators.fossen.capabilities

    def __init__(self, vehicle: VehicleModel, n: int, max_step: float = 0.01, threads: int = 1) -> None:
        super().__init__(vehicle, n, max_step)
        actuators, self._curves = actuator_table(vehicle)
        self._actuators = actuators.view(np.float64)
        self._flags = (
            bool(np.any(np.diag(np.diag(vehicle.M_A)) != vehicle.M_A)),
            any(unit.rest.size > 0 for unit in vehicle.units),
            bool(vehicle.others),
            vehicle.added_mass_coriolis and vehicle.plugin == GZ_SIM_8_11,
            False,
        )
        self._plans: dict[float, tuple[int, float, NDArray[Any]]] = {}
        """For each duration of a step in s: number of substeps, length of a substep in s, and the actuators' discretisation
        for half a substep
        """
        self._n_blocks = -(-n // layout.LANES)
        shares = np.linspace(0, self._n_blocks, (threads if n >= THREADED else 1) + 1).astype(int).tolist()
        self._ranges = [
            (first * layout.LANES, min(last * layout.LANES, n))
            for first, last in pairwise(shares)
            if first < last
        ]
        self.set_waves(still(n))
        # All vehicles use one block of parameters until a vehicle differs from the others.
        rows = parameter_rows(vehicle, np.ones((1, len(SCALES))))
        self._parameters = np.repeat(rows.T, layout.LANES, axis=1).reshape(1, -1)
        self._scaled = False
        self.changes: NDArray[Any] | None = None
        """Changes (n,) of the vehicles, records of `layout.CHANGE`; None: all vehicles equal the sheet, apart from their scales"""

    def load_bodies(self, vehicles: Sequence[VehicleModel]) -> None:
        """Divide the blocks of vehicles into equal groups. Give each group the masses, damping and buoyancy of one of `vehicles`.

        The actuators do not change. Afterwards, `reset` must not be given scales, and `set_vehicles` must not be called.

        Args:
            vehicles: one vehicle for each group; their number divides the number of blocks.
        """
        ones = np.ones((1, len(SCALES)))
        rows = np.concatenate([parameter_rows(vehicle, ones) for vehicle in vehicles])
        blocks = np.repeat(rows, layout.LANES, axis=1).reshape(len(vehicles), -1)
        self._parameters = np.repeat(blocks, self._n_blocks // len(vehicles), axis=0)

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6); see `Simulator.reset`."""
        self._place(indices, pose, velocity)
        if scales is not None or np.any(self.scales[indices] != 1.0):
            self.scales[indices] = 1.0 if scales is None else scales
            self._load_parameters(np.asarray(indices))

    def set_vehicles(self, indices: IntArray, changes: NDArray[Any]) -> None:
        """Set how vehicles `indices` (k,) differ from the sheet; see `DrawnSimulator.set_vehicles`."""
        if self.changes is None:
            self.changes = layout.unchanged(self.n)
        self.changes[indices] = changes
        self._flags = (*self._flags[:-1], bool(np.any(self.changes["lag"] != 1.0)))
        self._load_parameters(np.asarray(indices))

    def set_waves(self, waves: Waves) -> None:
        """Set the waves of all vehicles; see `WavySimulator.set_waves`."""
        self.waves = waves
        self._wave_arguments = waves.components, waves.rays, waves.time

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds."""
        action = np.ascontiguousarray(command, dtype=np.float64)
        if action.shape != self.command_force.shape:
            raise ValueError(f"command has shape {action.shape}, expected {self.command_force.shape}")
        self.each(lambda start, stop: self.advance(action, duration, start, stop))
        self.waves.time += duration

    def each(self, function: Callable[[int, int], T]) -> list[T]:
        """Return `function(start, stop)` for each thread's range of vehicles. The calling thread computes the first
        range.
        """
        own, *others = self._ranges
        if not others:
            return [function(*own)]
        threads = _threads(len(others), os.getpid())
        jobs = [threads.submit(function, *bounds) for bounds in others]
        return [function(*own), *(job.result() for job in jobs)]

    def advance(self, command: FloatArray, duration: float, start: int, stop: int) -> None:
        """Apply commands (n, n_u) for `duration` s to vehicles start .. stop - 1; the bounds are multiples of LANES, or `n`."""
        plan = self._plans.get(duration)
        if plan is None:
            if len(self._plans) >= DURATIONS:
                self._plans.clear()
            substeps = self.substeps(duration)
            h = duration / substeps
            plan = self._plans[duration] = substeps, h, discretise(self.vehicle, h / 2.0).view(np.float64)
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
            self._actuators,
            discrete,
            self._curves,
            self._flags,
            (start // layout.LANES, -(-stop // layout.LANES)),
            substeps,
            h,
        )

    def state_dict(self) -> dict[str, FloatArray]:
        """Return copies of all arrays that an exact resume needs."""
        state = {name: getattr(self, name).copy() for name in _STATE}
        if self.changes is not None:
            state["changes"] = self.changes.view(np.float64).reshape(self.n, -1).copy()
        return state

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Restore a state from `state_dict`."""
        for name in _STATE:
            getattr(self, name)[...] = state[name]
        if "changes" in state:
            changes = np.ascontiguousarray(state["changes"]).view(layout.CHANGE)[:, 0]
            self.set_vehicles(np.arange(self.n), changes)
        if self._scaled or np.any(self.scales != 1.0):
            self._load_parameters(np.arange(self.n))

    def _load_parameters(self, lanes: IntArray) -> None:
        """Write the parameters of vehicles `lanes` (k,), computed with the vehicles' `scales` and `changes`."""
        if not self._scaled:
            self._scaled = True
            self._parameters = np.repeat(self._parameters, self._n_blocks, axis=0)
        blocks = self._parameters.reshape(self._n_blocks, layout.PARAMETER_ROWS, layout.LANES)
        changes = None if self.changes is None else self.changes[lanes]
        rows = parameter_rows(self.vehicle, self.scales[lanes], changes)
        blocks[lanes // layout.LANES, :, lanes % layout.LANES] = rows


def make(settings: simulators.Fossen, vehicle: VehicleModel, n: int, longest: float) -> FossenSimulator:
    """Return the simulator of a configuration; see `config.simulators.SimulatorSpec.factory`."""
    return FossenSimulator(vehicle, n, min(settings.max_step, longest), settings.threads)


def parameter_rows(
    vehicle: VehicleModel, scales: FloatArray, changes: NDArray[Any] | None = None
) -> FloatArray:
    """Return parameters (k, PARAMETER_ROWS) of k vehicles: the sheet's values, changed by `changes` (k,) if given, then multiplied by
    `scales` (k, 6).
    """
    mass, buoyancy, inertia, added, damping, thrust = (scales[:, j, None] for j in range(6))
    own = layout.unchanged(len(scales)) if changes is None else changes
    mass = mass * own["mass"][:, None]
    r_g = vehicle.center_of_gravity
    no_inertia = np.zeros((3, 3))
    M_mass = rigid_body_mass(vehicle.mass, r_g, no_inertia)
    M_inertia = np.tile(rigid_body_mass(0.0, r_g, vehicle.inertia), (len(scales), 1, 1))
    M_inertia[:, 3:, 3:] *= _rows_and_columns(own["inertia"])
    M_RB = mass[..., None] * M_mass + inertia[..., None] * M_inertia
    M_A = added[..., None] * (vehicle.M_A * _rows_and_columns(own["added_mass"]))
    rows = np.zeros(scales.shape[0], layout.VEHICLE)
    rows["m"] = M_RB[:, 0, 0]
    rows["m_r_g"] = mass * (vehicle.mass * r_g)
    rows["I_b"] = _symmetric(M_RB[:, 3:, 3:])
    _put_symmetric_6(rows["M_A"], M_A)
    _put_symmetric_6(rows["M_A_coriolis"], vehicle.coriolis_sign * M_A)
    _put_symmetric_6(rows["M_inverse"], np.linalg.inv(M_RB + M_A))
    for name, coefficients in (
        ("D", own["linear_damping"] * vehicle.linear_damping),
        ("D_n", own["quadratic_damping"] * vehicle.quadratic_damping),
    ):
        rows[name]["linear"], rows[name]["angular"] = np.split(damping * coefficients, 2, axis=1)
    # If `changes` changes the mass, the buoyancy changes with the weight, so that the net buoyancy stays.
    sheet = vehicle.buoyancy + ((own["mass"] - 1.0) * vehicle.weight + own["net_buoyancy"])
    weight, lift = mass * vehicle.weight, buoyancy * np.maximum(sheet, 0.0)[:, None]
    r_b = np.tile(vehicle.center_of_buoyancy, (len(scales), 1))
    if changes is not None:  # adding 0.0 would turn -0.0 into 0.0
        r_b[:, 2] += own["center_of_buoyancy_z"]
    rows["B_minus_W"] = (lift - weight)[:, 0]
    rows["B_r_b_minus_W_r_g"] = lift * r_b - weight * r_g
    rows["thrust_factor"] = thrust[:, 0]
    rows["lag_factor"] = own["lag"]
    displaced = lift / vehicle.gravity
    rows["displaced"] = displaced[:, 0]
    rows["displaced_r_b"] = displaced * r_b
    return rows.view(np.float64).reshape(-1, layout.PARAMETER_ROWS)


def _rows_and_columns(factors: FloatArray) -> FloatArray:
    """Return factors (k, n, n) that scale the diagonals of matrices by `factors` (k, n) and keep the matrices positive definite."""
    root = np.sqrt(factors)
    return np.asarray(root[:, :, None] * root[:, None, :])


def _symmetric(M: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Return xx yy zz xy xz yz (k, 6) of symmetric matrices (k, 3, 3), from their upper triangles."""
    return M[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _put_symmetric_6(rows: NDArray[Any], M: NDArray[np.floating[Any]]) -> None:
    """Write symmetric matrices (k, 6, 6) to records of `layout.SYMMETRIC_6`, from their upper triangles."""
    rows["M11"], rows["M12"], rows["M22"] = _symmetric(M[:, :3, :3]), M[:, :3, 3:], _symmetric(M[:, 3:, 3:])


def actuator_table(vehicle: VehicleModel) -> tuple[NDArray[Any], FloatArray]:
    """Return the actuators (n_u,), records of `layout.ACTUATOR`, and the table of curves (1 + curves, points).

    Row 0 of the curves is electrical power at equally spaced forces from -F to F, with F the largest force of a T200.
    """
    table = np.zeros(len(vehicle.units), layout.ACTUATOR)
    largest, power = t200_power()
    table["points_per_newton"] = 0.5 * (layout.POWER_POINTS - 1) / largest
    table["per_newton"]["force"], table["per_newton"]["torque"] = np.split(vehicle.allocation.T, 2, axis=1)
    curves = [power]
    state = 0
    for row, unit in zip(table, vehicle.units, strict=True):
        row["kind"], row["curve"] = unit.code, unit.curve.code
        row["low"], row["high"] = unit.curve.limits
        row["neutral"] = unit.curve.neutral
        if (values := unit.curve.entries).size:
            row["table"], row["entries"] = len(curves), values.size
            curves.append(values)
        row["order"], row["first_state"] = unit.rest.size, state
        state += unit.rest.size
        row["rate"] = unit.rate
        row["position"], row["axis"] = unit.position, unit.direction
        for field, value in unit.coefficients(vehicle.density, vehicle.gravity).items():
            row[field] = value
    packed = np.zeros((len(curves), max(curve.size for curve in curves)))
    for target, curve in zip(packed, curves, strict=True):
        target[: curve.size] = curve
    return table, packed


def discretise(vehicle: VehicleModel, duration: float) -> NDArray[Any]:
    """Return exact discretisations (n_u,) of all actuators for one duration in s, records of `layout.DISCRETE`."""
    table = np.zeros(len(vehicle.units), layout.DISCRETE)
    table["half_step"] = duration
    done: dict[Lag, tuple[FloatArray, FloatArray]] = {}  # the thrusters of a group have the same lag
    for row, unit in zip(table, vehicle.units, strict=True):
        order = unit.lag.order
        if order == 0:
            row["C"][0] = 1.0  # the state of a rate-limited actuator is its output
            continue
        if unit.lag not in done:
            done[unit.lag] = unit.lag.discretise(duration)
        A, B = done[unit.lag]
        row["A"][:order, :order] = A
        row["B"][:order] = B
        row["C"][:order] = unit.lag.C
    return table
