"""Simulate on gz-sim 8 in this process (`simulator=gazebo`), with the interface of all simulators (`Simulator`)."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.errors import ConfigError
from auvbench.integrations.gazebo import bindings, sdf, spec
from auvbench.integrations.gazebo.spec import Gazebo
from auvbench.integrations.gazebo.world import CurrentForce, NewBody, World
from auvbench.simulators.base import VehicleBatch
from auvbench.vehicles.vehicle_model import VehicleModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer[Any]]

_PUBLISHED = "simulator=gazebo with simulator.hydrodynamics=published"

VEHICLES_PER_WORLD = 25
"""Largest number of vehicles in one world, since a Gazebo step of twice as many vehicles takes more than twice as long."""


class GazeboSimulator(VehicleBatch):
    """N copies of a vehicle in Gazebo that do not collide with each other.

    A world has up to `VEHICLES_PER_WORLD` vehicles. Gazebo computes the rigid body, added mass, damping, weight and buoyancy.
    auvbench computes the thrusters' forces and applies them to the body. Vehicles start at rest, since a body whose velocity
    was set through Gazebo's bindings keeps that velocity.

    Args:
        vehicle: vehicle to simulate.
        n: number of vehicles.
        max_step: longest physics step in s; a step of `duration` s consists of ceil(duration / max_step) equal
            physics steps.
        hydrodynamics: one of `sdf.HYDRODYNAMICS`.

    Raises:
        ConfigError: Gazebo's bindings are not installed, or a number is out of range.
        VehicleError: Gazebo cannot simulate this vehicle; see `sdf.check_vehicle`.
    """

    capabilities = spec.simulator.capabilities

    def __init__(
        self, vehicle: VehicleModel, n: int, max_step: float = 0.01, hydrodynamics: str = "corrected"
    ) -> None:
        super().__init__(vehicle, n, max_step)
        sdf.check_vehicle(vehicle, hydrodynamics)
        bindings.load()
        self.hydrodynamics = hydrodynamics
        self._thrust = Thrust(vehicle, self.actuators)
        self._allocation = vehicle.allocation
        self._worlds: list[World] = []
        self._fresh = set(range(n))  # vehicles that need a new body

    def reset(
        self, indices: IntArray, pose: ArrayLike, velocity: ArrayLike, scales: ArrayLike | None = None
    ) -> None:
        """Put vehicles `indices` (k,) at `pose` (k, 7), at rest; see `Simulator.reset`.

        The old bodies are removed, with their velocity and the state of their plugins.

        Raises:
            ConfigError: `velocity` (k, 6) is not zero.
        """
        if np.any(velocity):
            raise ConfigError("simulator=gazebo starts vehicles at rest: velocity must be 0")
        self._place(indices, pose, velocity)
        self.scales[indices] = 1.0 if scales is None else scales
        self._fresh.update(np.asarray(indices).tolist())

    def set_current(
        self,
        velocity: ArrayLike,
        bottom: ArrayLike | None = None,
        depths: tuple[ArrayLike, ArrayLike] = (0.0, 1.0),
    ) -> None:
        """Set the current of all vehicles; see `Simulator.set_current`.

        Raises:
            ConfigError: the depth of the bottom is not larger than the depth of the top; or, with the published hydrodynamics, the current
                changes within an episode or with depth.
        """
        before = self.current.copy()
        super().set_current(velocity, bottom, depths)
        if self.hydrodynamics == "published":
            if self.current[:, 3:6].any():
                raise ConfigError(f"{_PUBLISHED}: the current must be the same at all depths")
            changed = np.flatnonzero(np.any(before[:, :3] != self.current[:, :3], axis=1)).tolist()
            if not self._fresh.issuperset(changed):
                raise ConfigError(
                    f"{_PUBLISHED}: the current must be steady in an episode; reset the vehicle to change it"
                )

    def step(self, command: ArrayLike, duration: float) -> None:
        """Apply normalised commands (n, n_u), clipped to [-1, 1], for `duration` seconds."""
        action = np.clip(np.asarray(command, dtype=np.float64), -1.0, 1.0)
        if action.shape != self.command_force.shape:
            raise ValueError(f"command has shape {action.shape}, expected {self.command_force.shape}")
        steps = self.substeps(duration)
        self._set_step(duration / steps)
        self.command_force[...] = self.vehicle.force(action)
        self.power[...] = self.vehicle.power(action)
        forces = self._thrust.forces(action, steps, duration / steps)
        forces *= self.effectiveness * self.scales[:, 5:6]
        # Not a matrix product, whose last bits would depend on the number of vehicles.
        wrench = np.einsum("sna,ca->snc", forces, self._allocation) + self.external_wrench
        fresh = sorted(self._fresh)
        self._fresh.clear()
        for k, world in enumerate(self._worlds):
            part = slice(k * VEHICLES_PER_WORLD, k * VEHICLES_PER_WORLD + world.n)
            new_bodies = [self._new_body(i, i - part.start) for i in fresh if part.start <= i < part.stop]
            world.current[...] = self.current[part]
            world.advance(new_bodies, wrench[:, part])
            self.pose[part] = world.pose
            self.velocity[part] = world.velocity

    def state_dict(self) -> dict[str, FloatArray]:
        """Return an empty dictionary: Gazebo cannot restore a state (`capabilities.exact_resume`)."""
        return {}

    def load_state_dict(self, state: dict[str, FloatArray]) -> None:
        """Do nothing: a resumed run restarts the episodes that were running."""

    def _set_step(self, step: float) -> None:
        """Create the worlds if needed, and set their physics step in s."""

        def text(name: str) -> str:
            return sdf.world([], self.vehicle, name=name, step=step, real_time_factor=0.0, scene=False)

        if not self._worlds:
            sizes = [
                min(VEHICLES_PER_WORLD, self.n - first) for first in range(0, self.n, VEHICLES_PER_WORLD)
            ]
            self._worlds = [World(text, size, step) for size in sizes]
        for world in self._worlds:
            if abs(world.step - step) > 1e-12:
                world.set_step(step)

    def _new_body(self, index: int, place: int) -> NewBody:
        """Return a new body of vehicle `index` for place `place` in the vehicle's world."""
        vehicle = self.vehicle
        if np.any(self.scales[index] != 1.0):
            vehicle = scaled(vehicle, self.scales[index])
        drift, current = None, None
        if self.hydrodynamics == "corrected":
            drift = CurrentForce(vehicle.M_A, vehicle.linear_damping, vehicle.quadratic_damping)
        elif self.current[index, :3].any():
            current = self.current[index, :3].copy()
        text = sdf.model(vehicle, self.hydrodynamics, name="{name}", thrusters=False, current=current)
        return NewBody(place, text, self.pose[index].copy(), drift)


def scaled(vehicle: VehicleModel, scales: FloatArray) -> VehicleModel:
    """Return the vehicle with scaled mass, buoyancy, inertia, added mass and damping (the first five of `scales`)."""
    mass, buoyancy, inertia, added, damping = (float(factor) for factor in scales[:5])
    return dataclasses.replace(
        vehicle,
        mass=mass * vehicle.mass,
        weight=mass * vehicle.weight,
        buoyancy=buoyancy * vehicle.buoyancy,
        inertia=inertia * vehicle.inertia,
        M_A=added * vehicle.M_A,
        linear_damping=damping * vehicle.linear_damping,
        quadratic_damping=damping * vehicle.quadratic_damping,
    )


class Thrust:
    """Thruster forces of N vehicles under a constant command.

    Gazebo gets the forces in N without delay, so the thrusters' curves and lags are computed here. The lags are
    discretised exactly; each physics step uses the force at the middle of the step.

    Args:
        vehicle: vehicle with the thrusters.
        states: states of the actuators, (n, n_actuator_states); `forces` advances them in place.
    """

    def __init__(self, vehicle: VehicleModel, states: FloatArray) -> None:
        self.vehicle = vehicle
        self.states = states
        self._exact: dict[float, list[tuple[FloatArray, FloatArray]]] = {}

    def forces(self, command: FloatArray, steps: int, step: float) -> FloatArray:
        """Advance the states by `steps` physics steps; return the thrusters' forces in N in these steps, (steps, n, n_u).

        Args:
            command: (n, n_u) commands in [-1, 1].
            steps: number of physics steps.
            step: physics step, s.
        """
        forces = np.empty((steps, *command.shape))
        exact = self._discretised(step / 2.0)
        first = 0
        for a, unit in self.vehicle.thrusters:
            value = unit.curve(command[:, a])
            order = unit.lag.order
            if order == 0:
                forces[:, :, a] = value
            else:
                Ad, Bd = exact[a]
                x = self.states[:, first : first + order]
                for k in range(steps):
                    x = _moved(x, Ad) + value[:, None] * Bd
                    forces[k, :, a] = _moved(x, unit.lag.C[None])[:, 0]
                    x = _moved(x, Ad) + value[:, None] * Bd
                self.states[:, first : first + order] = x
            first += order
            if unit.rotor_constant:
                forces[:, :, a] *= unit.rotor_constant * np.abs(forces[:, :, a])
        return forces

    def _discretised(self, step: float) -> list[tuple[FloatArray, FloatArray]]:
        if step not in self._exact:
            self._exact.clear()
            self._exact[step] = [unit.lag.discretise(step) for unit in self.vehicle.units]
        return self._exact[step]


def _moved(x: FloatArray, A: FloatArray) -> FloatArray:
    """Return A x for each row of `x` (n, order); the last bits of a matrix product would depend on n."""
    return np.asarray(np.einsum("nj,ij->ni", x, A))


def make(settings: Gazebo, vehicle: VehicleModel, n: int, longest: float) -> GazeboSimulator:
    """Return the simulator of a configuration; see `config.simulators.SimulatorSpec.factory`."""
    step = min(settings.max_step, longest)
    return GazeboSimulator(vehicle, n, max_step=step, hydrodynamics=settings.hydrodynamics)


def check(settings: Gazebo, vehicle: VehicleModel) -> None:
    """Check before a run that Gazebo can simulate the vehicle.

    Raises:
        ConfigError: Gazebo's bindings are not installed.
        VehicleError: Gazebo cannot simulate the vehicle.
    """
    sdf.check_vehicle(vehicle, settings.hydrodynamics)
    bindings.modules()
