"""Simulate on a server with the ROS 2 interface of docs/ros2.md (`simulator=ros2`).

The Python interface is the interface of all simulators (`Simulator`).
"""

from __future__ import annotations

import atexit
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.config import simulators
from auvbench.config.schema import SCALES
from auvbench.dynamics.kernel import commanded
from auvbench.errors import ConfigError, TrainingError
from auvbench.integrations.ros2.connection import Connection
from auvbench.integrations.ros2.spec import Ros2
from auvbench.simulators.fossen import actuator_table
from auvbench.vehicles.physical import PhysicalCommands
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer[Any]]

_current: tuple[int, tuple[Any, ...], Connection] | None = None
"""process, key and connection of the last `connect`; the connection is kept, since an evaluation creates many batches and
finding a server takes half a second
"""


def connect(settings: Ros2, vehicle: VehicleModel) -> Connection:
    """Return the connection to the server; reuse the earlier connection while it is usable.

    Raises:
        ConfigError, InterfaceError: see `Connection`.
    """
    global _current
    namespace = settings.namespace or vehicle.name
    key = (namespace, vehicle.actuators, settings.clock)
    existing = _connection()
    if existing is not None and _current is not None and _current[1] == key and existing.usable:
        existing.timeout = settings.timeout
        return existing
    leave()
    connection = Connection(namespace, vehicle.actuators, settings.clock, settings.timeout)
    _current = (os.getpid(), key, connection)
    return connection


def _connection() -> Connection | None:
    """Return this process's connection; a forked process has no connection."""
    return _current[2] if _current is not None and _current[0] == os.getpid() else None


@atexit.register
def leave() -> None:
    """Close this process's connection."""
    global _current
    connection, _current = _connection(), None
    if connection is not None:
        connection.close()


def used() -> dict[str, str]:
    """Return the server of this process's connection, for manifests; empty without a connection."""
    connection = _connection()
    if connection is None:
        return {}
    server = ", ".join(f"{name} {value}" for name, value in sorted(connection.about.items()))
    return {"ros2": f"jazzy, clock {connection.clock}; server: {server or 'unknown'}"}


def clock() -> str:
    """Return the clock of this process's connection; '' without a connection."""
    connection = _connection()
    return connection.clock if connection is not None else ""


class Ros2Simulator:
    """N vehicles on a ROS 2 server.

    Commands are sent as physical quantities, computed with the sheet's curves as in the embedded simulator.
    In lock-step with `auvbench serve`, the server applies all disturbances, and the results equal the results of the server's
    simulator bit for bit. With other clocks, commands and poses are late, a fault scales the command, and currents are
    steady.

    Args:
        vehicle: vehicle on the server.
        n: number of vehicles.
        settings: namespace, clock and timeout.

    Raises:
        ConfigError: the server has fewer than `n` vehicles, or ROS 2 is not installed.
        InterfaceError: a topic or service is missing, or another program uses it.
    """

    def __init__(self, vehicle: VehicleModel, n: int, settings: Ros2) -> None:
        self.vehicle = vehicle
        self.n = n
        self.settings = settings
        self.capabilities = simulators.capabilities(settings)
        self._connection = connect(settings, vehicle)
        if n > self._connection.n:
            raise ConfigError(
                f"{n} vehicles are needed at once, but the server has {self._connection.n}: start it with --vehicles {n},"
                " or train with fewer environments (algo.n_envs)"
            )
        self._connection.owner = self
        n_u = len(vehicle.units)
        self.pose = np.zeros((n, 7))
        self.pose[:, 3] = 1.0
        self.velocity = np.zeros((n, 6))
        self.actuators = np.zeros((n, 0))
        self.command_force = np.zeros((n, n_u))
        self.power = np.zeros(n)
        self.effectiveness = np.ones((n, n_u))
        self._table, self._curves = actuator_table(vehicle)
        self._thrusters = np.isin(vehicle.actuators, vehicle.others, invert=True)
        self._physical = PhysicalCommands(vehicle)
        # Lock-step also needs commands to the server's other vehicles.
        self._all = np.tile(self._physical.neutral, (self._connection.n, 1))
        self._command = np.zeros((n, n_u))
        self._quantity = np.zeros((n, n_u))
        self._sent_effectiveness = np.ones((n, n_u))
        self._current: FloatArray = np.zeros((n, 8))
        self._current[:, 7] = 1.0
        # The server may still have the currents of an earlier client.
        self._sent_current: FloatArray = np.full((n, 8), np.nan)
        self._scaled = np.ones(n, dtype=np.bool_)

    @property
    def exact(self) -> bool:
        """Return whether the server is in lock-step; such a server applies the disturbances."""
        return self._connection.clock == "lockstep"

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6); see `Simulator.reset`.

        Raises:
            ConfigError: `scales` are not 1, and the server is not in lock-step.
            InterfaceError: the server rejects the reset.
            TrainingError: the server does not answer.
        """
        self._own()
        which = np.asarray(indices).tolist()
        if not which:
            return
        self.pose[indices] = pose
        self.velocity[indices] = velocity
        factors = (
            np.ones((len(which), len(SCALES))) if scales is None else np.asarray(scales, dtype=np.float64)
        )
        parameters: dict[int, dict[str, Any]] = {}
        for row, i in enumerate(which):
            entries = {"start_pose": self.pose[i].tolist(), "start_velocity": self.velocity[i].tolist()}
            drawn = bool(np.any(factors[row] != 1.0))
            if drawn and not self.exact:
                raise ConfigError(
                    "simulator=ros2: drawn vehicles (factors that differ from the sheet) need a server in "
                    "lock-step (auvbench serve)"
                )
            if self.exact and (drawn or self._scaled[i]):
                entries["scales"] = factors[row].tolist()
                self._scaled[i] = drawn
            parameters[i] = entries
        self._connection.reset(which, parameters)
        if not self.exact:  # the vehicle moves while the client waits
            self._connection.await_poses(which, self.pose[which])
            self.pose[indices] = self._connection.pose[indices]
            self.velocity[indices] = self._connection.velocity[indices]
        self.command_force[indices] = 0.0
        self.power[indices] = 0.0
        self.effectiveness[indices] = self._sent_effectiveness[indices] = 1.0

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current of all vehicles, to be sent before the next step; see `Simulator.set_current`."""
        self._current[:, :3] = velocity
        self._current[:, 3:6] = velocity if bottom is None else bottom
        self._current[:, 6], self._current[:, 7] = depths

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds.

        Raises:
            TrainingError: the server does not answer, or another batch of this process uses the server's vehicles.
        """
        self._own()
        given = np.asarray(command, dtype=np.float64)
        if given.shape != self._command.shape:
            raise ValueError(f"command has shape {given.shape}, expected {self._command.shape}")
        np.clip(given, -1.0, 1.0, out=self._command)
        commanded(self._command, self._table, self._curves, self._quantity, self.command_force, self.power)
        message = self._physical.quantities(self._quantity)
        if self.exact:
            self._send()
        else:
            message *= np.where(self._thrusters, self.effectiveness, 1.0)
            water = self._current[0, :3]
            # The server may not have discovered this topic yet, so the current is sent again until a server listens.
            if np.any(water != self._sent_current[0, :3]) and self._connection.publish_current(water):
                self._sent_current[...] = self._current
        self._all[: self.n] = message
        self._connection.step(self._all, duration)
        self.pose[...] = self._connection.pose[: self.n]
        self.velocity[...] = self._connection.velocity[: self.n]

    def _send(self) -> None:
        """Send the faults and currents that have changed."""
        parameters: dict[int, dict[str, Any]] = {}
        for i in np.flatnonzero(np.any(self.effectiveness != self._sent_effectiveness, axis=1)).tolist():
            parameters.setdefault(i, {})["effectiveness"] = self.effectiveness[i].tolist()
        for i in np.flatnonzero(np.any(self._current != self._sent_current, axis=1)).tolist():
            parameters.setdefault(i, {})["current"] = self._current[i].tolist()
        if parameters:
            self._connection.set(parameters)
            self._sent_effectiveness[...] = self.effectiveness
            self._sent_current[...] = self._current

    def _own(self) -> None:
        if self._connection.owner is not self:
            raise TrainingError(
                f"{self._connection.names[0].odometry}: another batch of this process uses these vehicles; "
                "use one batch at a time"
            )

    def state_dict(self) -> dict[str, FloatArray]:
        """Return an empty dictionary: the interface cannot restore a state (`capabilities.exact_resume`)."""
        return {}

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Do nothing: a resumed run restarts the episodes that were running."""


def make(settings: Ros2, vehicle: VehicleModel, n: int, longest: float) -> Ros2Simulator:
    """Return the simulator of a configuration; see `config.simulators.SimulatorSpec.factory`."""
    return Ros2Simulator(vehicle, n, settings)


class Served:
    """Properties of the server that a test needs; see `config.simulators.SimulatorSpec.served`."""

    @staticmethod
    def vehicles(settings: Ros2, vehicle: VehicleModel) -> int:
        return connect(settings, vehicle).n

    @staticmethod
    def clock() -> str:
        return clock()
