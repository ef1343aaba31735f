"""Provide guidance, allocation and limits for the thruster controllers; each adds its own control law.

Guidance: the velocity of the reference, if the task observes it, plus a velocity towards the reference:
`cruise_speed` when far and `approach` x distance when near. The sum is reduced if the thrusters could not
overcome the drag. The bow turns to the task's yaw (in the waypoint task, to the waypoint), and turns along
with a moving reference. The control law computes a wrench from the missing velocity. Allocation uses the
pseudo-inverse (Fossen 2021, section 11.2, unconstrained allocation). If a thruster would saturate, all thrusts are
scaled down by the same factor, so that the wrench keeps its direction.

The controllers get the same observations as learners (see `Estimator`). If the task observes gravity and
angular velocity and the thrusters span roll and pitch, the thrusters keep the vehicle level: at speed, the
Munk moment may exceed the restoring moment. Otherwise no moment is commanded. If thrust causes a moment (the
BlueROV2's thrusters are below its origin), thrust is limited so that the moment stays below a share of the
largest restoring moment.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical import ranging
from auvbench.config import schema
from auvbench.config.algorithms.cascade import Cascade as Gains
from auvbench.errors import ConfigError
from auvbench.observation import BODY, ObservationSpec
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

HEAVE, ROLL, PITCH, YAW = 2, 3, 4, 5
CONTROLLED = [0, 1, 2, YAW]
"""Axes on which these controllers command forces and moments of every vehicle: surge, sway, heave and yaw."""

# Largest share of the thrust that steady motion may take; the rest is for control.
CRUISE_SHARE = 0.85
# Largest tilting moment of the thrust, as a share of the largest restoring moment: a heel of about 27 degrees.
RIGHTING_SHARE = 0.45
LEVELLING = 2.5
"""bandwidth of the loop that keeps a vehicle level, rad/s"""


class Estimator:
    """Latest readings of N vehicles, and velocities from them.

    Yaw is the bearing of the waypoint minus the yaw error. If the task observes velocities, the estimator takes them
    from the observation. Otherwise it computes differences of successive readings, and smooths them by a first-order
    low-pass filter with exact discretisation.

    Args:
        dt: time between readings, s.
        filter_time: time constant of the filter, s.
        spec: specification of the observation.

    Raises:
        ConfigError: the task does not observe yaw error and position error.
    """

    def __init__(self, dt: float, filter_time: float, spec: ObservationSpec) -> None:
        self.dt = dt
        self._yaw_error, self._error = spec["yaw_error"], spec["position_error"]
        self.body_frame = spec.blocks["position_error"].axes == BODY
        # Blocks in body axes are read only with `body_frame`: only an estimate of the yaw could turn them to world axes.
        names = ("velocity", "angular_velocity", "velocity_error", "gravity") if self.body_frame else ()
        self._read = {name: spec[name] for name in names if name in spec.blocks}
        self._turns = "velocity_error" in self._read
        self.levels = {"gravity", "angular_velocity"} <= self._read.keys()
        """whether roll, pitch and their rates are observed"""
        self._smoothing = 1.0 - np.exp(-dt / filter_time)
        self.reset(0)

    def reset(self, n: int) -> None:
        self.first: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        """(n,) whether the row has had no reading yet"""
        self.error: Floats = np.zeros((n, 3))
        """(n, 3) vector to the waypoint in m, world axes; with `body_frame`, level axes with the vehicle's yaw"""
        self.yaw: Floats = np.zeros(n)
        self.yaw_error: Floats = np.zeros(n)
        self.velocity: Floats = np.zeros((n, 3))
        """(n, 3) velocity in m/s: in body axes if the task observes the velocity, else in the axes of `error`"""
        self.yaw_rate: Floats = np.zeros(n)
        self.turning: Floats = np.zeros(n)
        """(n,) yaw rate of a moving reference, rad/s"""
        self.target: Floats = np.zeros((n, 3))
        """(n, 3) velocity of the reference in m/s, in the axes of `error`; 0 if the task does not observe this velocity"""
        self.tilt: Floats = np.zeros((n, 2))
        """(n, 2) roll and pitch, rad; 0 unless `levels`"""
        self.tilt_rate: Floats = np.zeros((n, 2))
        """(n, 2) rates of roll and pitch, rad/s; 0 if the task does not observe the angular velocity"""

    def update(self, observation: Floats) -> None:
        """Process observations (n, n_obs)."""
        yaw_error = observation[:, self._yaw_error].ravel()
        error = observation[:, self._error].copy()
        bearing = np.arctan2(error[:, 1], error[:, 0])
        # In the body frame the bearing is the yaw error and yaw stays 0: the frame turns with the vehicle, and turns
        # little within the filter's time.
        yaw = np.zeros(len(error)) if self.body_frame else wrap(bearing - yaw_error)
        # One reading does not determine a velocity.
        a = np.where(self.first, 0.0, self._smoothing)
        # The waypoint does not move: the error shrinks by the vehicle's motion.
        self.velocity += a[:, None] * ((self.error - error) / self.dt - self.velocity)
        turned = wrap(self.yaw_error - yaw_error) if self.body_frame else wrap(yaw - self.yaw)
        self.yaw_rate += a * (turned / self.dt - self.yaw_rate)
        if "angular_velocity" in self._read:
            rates = observation[:, self._read["angular_velocity"]]
            self.tilt_rate, self.yaw_rate = rates[:, :2].copy(), rates[:, 2].copy()
            if self._turns:
                # The yaw rate of the reference is the vehicle's yaw rate plus the rate at which the yaw error grows.
                self.turning += a * (self.yaw_rate - turned / self.dt - self.turning)
        if self.levels:
            x, y, z = observation[:, self._read["gravity"]].T
            self.tilt = np.stack([np.arctan2(-y, -z), np.arcsin(np.clip(x, -1.0, 1.0))], axis=1)
        if "velocity" in self._read:
            self.velocity = observation[:, self._read["velocity"]].copy()
        if "velocity_error" in self._read:
            self.target = observation[:, self._read["velocity_error"]] + to_level(self.velocity, self.tilt)
        self.error, self.yaw, self.yaw_error = error, yaw, yaw_error
        self.first = np.zeros(len(error), dtype=np.bool_)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the estimator carries from reading to reading, by name, with a row for each
        vehicle.
        """
        names = (
            "first",
            "error",
            "yaw",
            "yaw_error",
            "velocity",
            "yaw_rate",
            "turning",
            "target",
            "tilt",
            "tilt_rate",
        )
        return {name: getattr(self, name) for name in names}


def wrap(angle: Floats) -> Floats:
    """Return angles wrapped to [-pi, pi)."""
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def to_body(world: Floats, yaw: Floats) -> Floats:
    """Return vectors (n, 3) turned from world axes to level axes with the body's yaw (n,) in rad."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = world.T
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)


def to_level(body: Floats, tilt: Floats) -> Floats:
    """Return vectors (n, 3) turned from body axes to level axes with the same yaw. `tilt` is roll and pitch (n, 2)
    in rad.
    """
    (cr, cp), (sr, sp) = np.cos(tilt).T, np.sin(tilt).T
    x, y, z = body.T
    down = sr * y + cr * z
    return np.stack([cp * x + sp * down, cr * y - sr * z, cp * down - sp * x], axis=1)


def from_level(level: Floats, tilt: Floats) -> Floats:
    """Return vectors (n, 3) turned from level axes to body axes; the inverse of `to_level`."""
    (cr, cp), (sr, sp) = np.cos(tilt).T, np.sin(tilt).T
    x, y, z = level.T
    down = sp * x + cp * z
    return np.stack([cp * x - sp * z, cr * y + sr * down, cr * down - sr * y], axis=1)


class Cascade:
    """Guidance and allocation for vehicles whose thrusters span surge, sway, heave and yaw.

    Raises:
        ConfigError: an actuator of the vehicle is not a thruster.
    """

    carried: ClassVar[tuple[str, ...]] = ()
    """names of the arrays that the control law carries from step to step; each array has a row for each vehicle"""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, Gains)
        if others := vehicle.others:
            raise ConfigError(
                f"algo={gains.name} needs a vehicle with only thrusters; vehicle={vehicle.name} also has "
                f"{', '.join(others)}; use algo=pid"
            )
        self.vehicle = vehicle
        self.cruise_speed, self.approach = gains.cruise_speed, gains.approach
        self.dt = 1.0 / config.step.frequency
        spec = observation_spec(config.task, vehicle.actuators)
        self.estimate = Estimator(self.dt, gains.filter_time, spec)
        self.ranging = ranging.of(config, vehicle, spec)
        """Guidance by an observed way or range sensor; None if the task observes neither"""
        self.mass = np.diag(vehicle.M).copy()
        self.inertia = vehicle.M_RB + vehicle.coriolis_sign * vehicle.M_A
        self.inverse: Floats = np.asarray(np.linalg.pinv(_controlled(vehicle.allocation)), dtype=np.float64)
        limits = gains.effort * vehicle.force_limits
        self.reach = np.maximum(np.stack([-limits[:, 0], limits[:, 1]]), 1e-9)
        self.lift = vehicle.buoyancy - vehicle.weight
        # Thrust may cause roll and pitch moments that the control law does not command. `tilting`: these moments per
        # newton of each thruster. `tilt_limit`: largest allowed moment, which the restoring moment can balance.
        self.tilting = vehicle.allocation[[ROLL, PITCH]]
        if self.estimate.levels:
            # If roll or pitch is controlled, the allocation gives exactly the commanded moment, so no other moment arises.
            self.tilting = np.where(_controlled(vehicle.allocation)[[ROLL, PITCH]] != 0.0, 0.0, self.tilting)
        stiffness = (
            vehicle.buoyancy * vehicle.center_of_buoyancy[2] - vehicle.weight * vehicle.center_of_gravity[2]
        )
        self.tilt_limit = RIGHTING_SHARE * max(float(stiffness), 0.0)
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        self.estimate.reset(len(episodes))
        if self.ranging is not None:
            self.ranging.reset(len(episodes))

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Estimator.memory` with the arrays that law and guidance carry from step to step."""
        guided = {} if self.ranging is None else self.ranging.memory()
        own = {name: getattr(self, name) for name in self.carried}
        return {**self.estimate.memory(), **guided, **own}

    def act(self, observation: Observations) -> Actions:
        now = self.estimate
        seen = observation.astype(np.float64)
        now.update(seen)
        level, read = self.guidance(), now.yaw_error
        if self.ranging is not None:
            moving = to_level(to_body(now.velocity, now.yaw), now.tilt)
            level, turn = self.ranging.steer(seen, to_body(now.error, now.yaw), level, moving, now.yaw_rate)
            now.yaw_error = read if turn is None else turn
        wanted = self._feasible(from_level(level, now.tilt))
        velocity = to_body(now.velocity, now.yaw)
        wrench = self.law(wanted, velocity)
        wrench[:, HEAVE] -= self.lift
        if now.levels:
            wrench[:, ROLL:] += self._munk(velocity)
            wrench[:, ROLL : PITCH + 1] -= self.mass[ROLL : PITCH + 1] * (
                LEVELLING**2 * now.tilt + 2.0 * LEVELLING * now.tilt_rate
            )
        thrust = self._allocate(wrench)
        scale = self._scale(thrust)
        self.after(wanted - velocity, scale)
        now.yaw_error = read
        return self.vehicle.action(thrust * scale[:, None])

    def guidance(self) -> Floats:
        """Return the commanded velocity (n, 3) in m/s, level axes."""
        now = self.estimate
        distance = np.linalg.norm(now.error, axis=1, keepdims=True)
        speed = np.minimum(self.cruise_speed, self.approach * distance)
        towards = speed * now.error / np.maximum(distance, 1e-9)
        return to_body(towards + now.target, now.yaw)

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        """Return the wrench (n, 6) in N and N m, body axes.

        Args:
            wanted: (n, 3) commanded velocity, m/s, body axes.
            velocity: (n, 3) present velocity, m/s, body axes.
        """
        raise NotImplementedError

    def after(self, miss: Floats, scale: Floats) -> None:
        """Update the arrays that the control law carries to the next step, e.g. its integrals.

        Args:
            miss: (n, 3) commanded velocity minus present velocity, m/s.
            scale: (n,) applied share of the wrench: 1 unless a thruster saturates or thrust would tilt the vehicle too far.
        """

    def turning_mass(self, rate: float) -> float:
        """Return the inertia in kg m2 that a heading loop assumes: at least damping / rate.

        If the loop assumed the true inertia, a vehicle with large damping would turn far more slowly than the loop
        intends.

        Args:
            rate: yaw acceleration that the loop commands per missing yaw rate, 1/s.
        """
        return max(float(self.mass[YAW]), float(self.vehicle.linear_damping[YAW]) / rate)

    def _drag(self, velocity: Floats) -> Floats:
        """Return the drag (n, 3) in N at velocities (n, 3) in m/s, both in body axes."""
        return np.asarray(self._damping(velocity, CONTROLLED[:3]) * velocity)

    def _damping(self, velocity: Floats, axes: list[int]) -> Floats:
        """Return the damping (n, k) in N s/m and N m s/rad at velocities (n, k) along and about k axes."""
        vehicle = self.vehicle
        return np.asarray(vehicle.linear_damping[axes] + vehicle.quadratic_damping[axes] * np.abs(velocity))

    def _munk(self, velocity: Floats) -> Floats:
        """Return the moments (n, 3) in N m that balance the Munk and gyroscopic moments: v x p + w x L (Kirchhoff)."""
        now = self.estimate
        rates = np.column_stack([now.tilt_rate, now.yaw_rate])
        momentum = _product(np.column_stack([velocity, rates]), self.inertia)
        return np.asarray(np.cross(velocity, momentum[:, :3]) + np.cross(rates, momentum[:, 3:]))

    def _feasible(self, velocity: Floats) -> Floats:
        """Return the velocity (n, 3) in m/s, reduced if its drag needs more than CRUISE_SHARE of the thrust."""
        for _ in range(3):
            scale = self._scale(self._allocate(self._drag(velocity)) / CRUISE_SHARE)
            # Drag grows at most with the square of the speed, so the factor sqrt(scale) does not reduce the speed too much.
            velocity = velocity * np.sqrt(scale)[:, None]
        return velocity

    def _allocate(self, wrench: Floats) -> Floats:
        """Return the thrust (n, n_u) in N for wrenches (n, 6), or for forces (n, 3)."""
        return _product(wrench, self.inverse[:, : wrench.shape[1]])

    def _scale(self, thrust: Floats) -> Floats:
        """Return the factor (n,) <= 1 that keeps every thruster within its limits and the vehicle upright."""
        backwards, forwards = self.reach
        ratio = (np.abs(thrust) / np.where(thrust >= 0.0, forwards, backwards)).max(axis=1)
        if self.tilt_limit > 0.0:
            tilt = np.abs(_product(thrust, self.tilting)).max(axis=1)
            ratio = np.maximum(ratio, tilt / self.tilt_limit)
        return np.asarray(1.0 / np.maximum(ratio, 1.0))


def _product(rows: Floats, matrix: Floats) -> Floats:
    """Return `rows @ matrix.T` (n, m), whose rows do not depend on the batch size.

    `cumsum` adds the terms one after the other. `@` and `sum` may add them in another order for another batch size,
    and then round differently.
    """
    terms = rows[:, None, :] * matrix
    return np.asarray(np.cumsum(terms, axis=2)[:, :, -1] + 0.0)  # never a negative zero


def _controlled(allocation: Floats) -> Floats:
    """Return the allocation (6, n_u) with zeros on the axes that are not controlled. Controlled are surge, sway, heave
    and yaw, and also roll and pitch if the thrusters span them.
    """
    rows = allocation.copy()
    axes = [*CONTROLLED]
    for row in (ROLL, PITCH):
        if np.linalg.matrix_rank(allocation[[*axes, row]], tol=1e-6) == len(axes) + 1:
            axes.append(row)
    rows[[row for row in range(6) if row not in axes]] = 0.0
    return rows
