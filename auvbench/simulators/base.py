"""Interface of simulators. A simulator advances N copies of one vehicle together.

A simulator does not know tasks or rewards. World ENU with the surface at z = 0, body FLU, quaternion (w, x,
y, z) body to world, SI units.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.config.schema import SCALES
from auvbench.config.simulators import Capabilities
from auvbench.dynamics.layout import CURRENT, CURRENT_COLUMNS
from auvbench.dynamics.waves import Waves
from auvbench.errors import ConfigError
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer[Any]]


class Simulator(Protocol):
    """N vehicles in water."""

    vehicle: VehicleModel
    n: int
    capabilities: Capabilities  # features of the simulator; a configuration that needs more is rejected
    pose: FloatArray  # (n, 7) x y z qw qx qy qz, m
    velocity: FloatArray  # (n, 6) u v w p q r in body axes, m/s and rad/s
    actuators: FloatArray  # (n, n_actuator_states)
    command_force: FloatArray  # (n, n_u) forces of the last command, N
    power: FloatArray  # (n,) electrical power of the last command, W
    effectiveness: FloatArray  # (n, n_u) factor on each thruster's force: 1 healthy, 0 dead

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6), actuators at rest.

        `scales` (k, 6) are factors on mass, buoyancy, inertia, added mass, damping and thrust; None means 1,
        the sheet's values. Effectiveness returns to 1; the current does not change.
        """

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current: `velocity` (3,) or (n, 3) in m/s, world axes, the same at all depths.

        With `bottom` (3,) or (n, 3), the current is `velocity` above the depth `depths[0]`, `bottom` below the depth
        `depths[1]`, and linear between these depths. The depths are in m, positive down; scalars or (n,).
        """

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds."""

    def state_dict(self) -> dict[str, FloatArray]:
        """Return copies of the arrays that an exact resume needs."""

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Restore a state from `state_dict`."""


class WavySimulator(Simulator, Protocol):
    """A simulator with `capabilities.waves`."""

    def set_waves(self, waves: Waves) -> None:
        """Set the waves. The simulator uses the caller's arrays without a copy; a step of T seconds adds T to `waves.time`."""


class DrawnSimulator(Simulator, Protocol):
    """A simulator with `capabilities.vehicles`, in which each vehicle may differ from the sheet."""

    def set_vehicles(self, indices: IntArray, changes: NDArray[Any]) -> None:
        """Set how vehicles `indices` (k,) differ from the sheet: records (k,) of `layout.CHANGE`.

        The changes apply until the next call. The scales of `reset` are additional factors.
        """


class VehicleBatch:
    """Base of the simulators that run in auvbench's own process: their common arrays and the number of substeps.

    Attributes in addition to `Simulator`'s:
        current: (n, 8) current. It changes with depth within one layer. The columns are the velocity above the layer (3), the
            change of the velocity across the layer (3), z of the layer's top, and 1 / the layer's thickness. `set_current`
            writes this array.
        external_wrench: (n, 6) force (N) and moment (N m) at the body origin, body axes, added to the actuators'
            wrench; it acts until it is changed.
        scales: (n, 6) scales of the last `reset`.

    Raises:
        ConfigError: a number is out of range.
    """

    def __init__(self, vehicle: VehicleModel, n: int, max_step: float) -> None:
        if n < 1:
            raise ConfigError(f"number of vehicles is {n}, must be at least 1")
        if not (max_step > 0.0 and math.isfinite(max_step)):
            raise ConfigError(f"simulator.max_step is {max_step}, must be a positive number of seconds")
        self.vehicle = vehicle
        self.n = n
        self.max_step = max_step
        self.pose = np.zeros((n, 7))
        self.pose[:, 3] = 1.0
        self.velocity = np.zeros((n, 6))
        self.command_force = np.zeros((n, len(vehicle.units)))
        self.power = np.zeros(n)
        self.effectiveness = np.ones((n, len(vehicle.units)))
        self.current = np.zeros((n, CURRENT_COLUMNS))
        self.external_wrench = np.zeros((n, 6))
        self.scales = np.ones((n, len(SCALES)))
        self._rest = np.concatenate([np.zeros(0), *(unit.rest for unit in vehicle.units)])
        self.actuators = np.tile(self._rest, (n, 1))

    def substeps(self, duration: float) -> int:
        """Return the number of equal substeps for `duration` seconds."""
        # Subtracting 1e-9 absorbs rounding errors: 1/25 s must give four substeps of 0.01 s.
        return max(1, math.ceil(duration / self.max_step - 1e-9))

    def _place(self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7) with `velocity` (k, 6), actuators at rest."""
        self.pose[indices] = pose
        self.velocity[indices] = velocity
        self.actuators[indices] = self._rest
        self.command_force[indices] = 0.0
        self.power[indices] = 0.0
        self.effectiveness[indices] = 1.0

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current of all vehicles; see `Simulator.set_current`.

        Raises:
            ConfigError: the second depth is not below the first.
        """
        top, thickness = depths[0], np.subtract(depths[1], depths[0])
        if not (thickness > 0.0 if isinstance(thickness, float) else np.all(thickness > 0.0)):
            raise ConfigError(
                f"current from depth {depths[0]} to {depths[1]} m: the second depth must be larger"
            )
        rows = self.current.view(CURRENT)[:, 0]
        rows["velocity"] = velocity
        rows["change"] = 0.0 if bottom is None else np.subtract(bottom, velocity)
        rows["top"], rows["per_thickness"] = np.negative(top), 1.0 / thickness
