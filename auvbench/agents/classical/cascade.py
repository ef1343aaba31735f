"""What the thruster controllers share: guidance, allocation, limits. The control law between them is their own.

Guidance: the velocity of the reference, if the task observes it, and one towards the reference, `cruise_speed` when far and
`approach` x distance when near, less where the thrusters could not hold it against the drag; the bow turns to the yaw that
the task asks for, in the waypoint task to the waypoint, and turns along with a reference that moves. The control law makes a
wrench of what is missing. Allocation: the pseudo-inverse (Fossen 2021, section 11.2, unconstrained allocation), scaled down as a whole
where a thruster would saturate, so that the wrench keeps its direction.

No better sensors than the learners' (see `Estimator`). Where the task observes gravity and angular velocity and the thrusters
span roll and pitch, they hold the vehicle level: at speed, the Munk moment may be larger than the restoring one. Otherwise
no moment is asked for; where thrust brings one along (the BlueROV2's thrusters lie below its origin), it is kept below a
share of what the restoring moment can hold.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.config import algorithms, schema
from auvbench.errors import ConfigError
from auvbench.observation import BODY, ObservationSpec
from auvbench.tasks.observation import observation_spec
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

HEAVE, ROLL, PITCH, YAW = 2, 3, 4, 5

# Share of the thrust that steady motion may take; the rest is for control.
CRUISE_SHARE = 0.85
# Share of the largest restoring moment that thrust may lean against: a heel of about 27 degrees.
RIGHTING_SHARE = 0.45
LEVELLING = 2.5
"""rad/s, bandwidth of the loop that holds a vehicle level"""


class Estimator:
    """Readings and velocities of N vehicles.

    Yaw is the bearing of the waypoint less the yaw error; velocities are those that the task observes, or else differences
    of readings through a first-order low-pass filter, discretised exactly.

    Args:
        dt: s between readings.
        filter_time: s, time constant of the filter.
        spec: of the observation.

    Raises:
        ConfigError: the task observes no yaw error or no position error.
    """

    def __init__(self, dt: float, filter_time: float, spec: ObservationSpec) -> None:
        self.dt = dt
        self._yaw_error, self._error = spec["yaw_error"], spec["position_error"]
        self.body_frame = spec.blocks["position_error"].axes == BODY
        # In world axes a reading in body axes would have to be turned by a yaw that is itself an estimate.
        names = ("velocity", "angular_velocity", "velocity_error", "gravity") if self.body_frame else ()
        self._read = {name: spec[name] for name in names if name in spec.blocks}
        self._turns = "velocity_error" in self._read
        self.levels = {"gravity", "angular_velocity"} <= self._read.keys()
        """whether roll and pitch are known"""
        self._smoothing = 1.0 - np.exp(-dt / filter_time)
        self.reset(0)

    def reset(self, n: int) -> None:
        self.first: NDArray[np.bool_] = np.ones(n, dtype=np.bool_)
        """(n,) where no reading has come yet"""
        self.error: Floats = np.zeros((n, 3))
        """(n, 3) m to the waypoint, world axes; axes of the body at the start with `body_frame`"""
        self.yaw: Floats = np.zeros(n)
        self.yaw_error: Floats = np.zeros(n)
        self.velocity: Floats = np.zeros((n, 3))
        """(n, 3) m/s in the axes of `error`"""
        self.yaw_rate: Floats = np.zeros(n)
        self.turning: Floats = np.zeros(n)
        """(n,) rad/s, yaw rate of a reference that moves"""
        self.target: Floats = np.zeros((n, 3))
        """(n, 3) m/s in the axes of `error`, velocity of the reference where the task observes it"""
        self.tilt: Floats = np.zeros((n, 2))
        """(n, 2) rad, roll and pitch where the task observes gravity"""
        self.tilt_rate: Floats = np.zeros((n, 2))
        """(n, 2) rad/s"""

    def update(self, observation: Floats) -> None:
        """Take in observations (n, n_obs)."""
        yaw_error = observation[:, self._yaw_error].ravel()
        error = observation[:, self._error].copy()
        bearing = np.arctan2(error[:, 1], error[:, 0])
        # In the body frame the bearing is the yaw error and yaw stays 0: the frame turns with the vehicle, and
        # its turning is small within the filter's time.
        yaw = np.zeros(len(error)) if self.body_frame else wrap(bearing - yaw_error)
        # One reading tells no velocity.
        a = np.where(self.first, 0.0, self._smoothing)
        # The waypoint stands still: the error shrinks by the way made.
        self.velocity += a[:, None] * ((self.error - error) / self.dt - self.velocity)
        turned = wrap(self.yaw_error - yaw_error) if self.body_frame else wrap(yaw - self.yaw)
        self.yaw_rate += a * (turned / self.dt - self.yaw_rate)
        if "angular_velocity" in self._read:
            rates = observation[:, self._read["angular_velocity"]]
            self.tilt_rate, self.yaw_rate = rates[:, :2].copy(), rates[:, 2].copy()
            if self._turns:
                # What the yaw error gains, and the vehicle turns, is the turning of the reference.
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
        """Return what it carries from reading to reading, by name: its own arrays, a row for each vehicle."""
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
    """Return angles in [-pi, pi)."""
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)


def to_body(world: Floats, yaw: Floats) -> Floats:
    """Return vectors (n, 3) from world axes to the levelled body's, turned by yaw (n,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = world.T
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)


def to_level(body: Floats, tilt: Floats) -> Floats:
    """Return vectors (n, 3) from the body's axes to level ones of the same yaw, at roll and pitch (n, 2)."""
    (cr, cp), (sr, sp) = np.cos(tilt).T, np.sin(tilt).T
    x, y, z = body.T
    down = sr * y + cr * z
    return np.stack([cp * x + sp * down, cr * y - sr * z, cp * down - sp * x], axis=1)


def from_level(level: Floats, tilt: Floats) -> Floats:
    """Return vectors (n, 3) from level axes to the body's; the inverse of `to_level`."""
    (cr, cp), (sr, sp) = np.cos(tilt).T, np.sin(tilt).T
    x, y, z = level.T
    down = sp * x + cp * z
    return np.stack([cp * x - sp * z, cr * y + sr * down, cr * down - sr * y], axis=1)


class Cascade:
    """Guidance and allocation for vehicles whose thrusters span surge, sway, heave and yaw.

    Raises:
        ConfigError: the vehicle has actuators that are no thrusters.
    """

    carried: ClassVar[tuple[str, ...]] = ()
    """the law's arrays, a row for each vehicle, that it carries from step to step"""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, algorithms.Cascade)
        if others := vehicle.others:
            raise ConfigError(
                f"algo={gains.name} steers by thrusters alone and vehicle={vehicle.name} has {', '.join(others)}; algo=pid steers it"
            )
        self.vehicle = vehicle
        self.cruise_speed, self.approach = gains.cruise_speed, gains.approach
        self.dt = 1.0 / config.step.frequency
        spec = observation_spec(config.task, vehicle.actuators)
        self.estimate = Estimator(self.dt, gains.filter_time, spec)
        self.mass = np.diag(vehicle.M).copy()
        self.inertia = vehicle.M_RB + vehicle.coriolis_sign * vehicle.M_A
        self.inverse: Floats = np.asarray(np.linalg.pinv(_controlled(vehicle.allocation)), dtype=np.float64)
        limits = gains.effort * vehicle.force_limits
        self.reach = np.maximum(np.stack([-limits[:, 0], limits[:, 1]]), 1e-9)
        self.lift = vehicle.buoyancy - vehicle.weight
        # Moments per newton that thrust brings along uncontrolled, and what the restoring moment can hold.
        self.tilting = vehicle.allocation[[ROLL, PITCH]]
        if self.estimate.levels:
            # What is controlled is asked for.
            self.tilting = np.where(_controlled(vehicle.allocation)[[ROLL, PITCH]] != 0.0, 0.0, self.tilting)
        stiffness = (
            vehicle.buoyancy * vehicle.center_of_buoyancy[2] - vehicle.weight * vehicle.center_of_gravity[2]
        )
        self.tilt_limit = RIGHTING_SHARE * max(float(stiffness), 0.0)
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        self.estimate.reset(len(episodes))

    def memory(self) -> dict[str, NDArray[Any]]:
        """As `Estimator.memory`, with what the law carries from step to step."""
        return {**self.estimate.memory(), **{name: getattr(self, name) for name in self.carried}}

    def act(self, observation: Observations) -> Actions:
        now = self.estimate
        now.update(observation.astype(np.float64))
        wanted = self._feasible(from_level(self.guidance(), now.tilt))
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
        self.after(wanted - velocity, scale >= 1.0)
        return self.vehicle.action(thrust * scale[:, None])

    def guidance(self) -> Floats:
        """Return the velocity (n, 3) in m/s to go at, level axes."""
        now = self.estimate
        distance = np.linalg.norm(now.error, axis=1, keepdims=True)
        speed = np.minimum(self.cruise_speed, self.approach * distance)
        towards = speed * now.error / np.maximum(distance, 1e-9)
        return to_body(towards + now.target, now.yaw)

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        """Return the wrench (n, 6) in N and N m for a wanted and a present velocity (n, 3) in m/s, body axes."""
        raise NotImplementedError

    def after(self, miss: Floats, free: NDArray[np.bool_]) -> None:
        """Update the law's memory with the velocities missed (n, 3) and whether (n,) no thruster saturated."""

    def turning_mass(self, rate: float) -> float:
        """Return the inertia in kg m2 that a heading loop reckons with: at least damping / rate.

        A vehicle whose damping outweighs its inertia would else turn far more slowly than the loop is meant to.

        Args:
            rate: 1/s, yaw acceleration that the loop asks for per rad/s of missing yaw rate.
        """
        return max(float(self.mass[YAW]), float(self.vehicle.linear_damping[YAW]) / rate)

    def _drag(self, velocity: Floats) -> Floats:
        """Return the drag (n, 3) in N at a velocity (n, 3) along the body's axes."""
        vehicle = self.vehicle
        return np.asarray(
            (vehicle.linear_damping[:3] + vehicle.quadratic_damping[:3] * np.abs(velocity)) * velocity
        )

    def _munk(self, velocity: Floats) -> Floats:
        """Return the moments (n, 3) in N m that hold against those of the motion itself: v x p + w x L (Kirchhoff)."""
        now = self.estimate
        rates = np.column_stack([now.tilt_rate, now.yaw_rate])
        momentum = _product(np.column_stack([velocity, rates]), self.inertia)
        return np.asarray(np.cross(velocity, momentum[:, :3]) + np.cross(rates, momentum[:, 3:]))

    def _feasible(self, velocity: Floats) -> Floats:
        """Return the velocity, slowed where holding it would take more than CRUISE_SHARE of the thrust."""
        for _ in range(3):
            scale = self._scale(self._allocate(self._drag(velocity)) / CRUISE_SHARE)
            # Drag grows with up to the square of the speed: the root does not slow down too much.
            velocity = velocity * np.sqrt(scale)[:, None]
        return velocity

    def _allocate(self, wrench: Floats) -> Floats:
        """Return the thrust (n, n_u) in N for wrenches (n, 6), or for forces (n, 3) alone."""
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
    """`rows @ matrix.T` (n, m), each sum in the order of its terms.

    A matrix product, and a sum, may round differently in a batch of another size.
    """
    terms = rows[:, None, :] * matrix
    return np.asarray(np.cumsum(terms, axis=2)[:, :, -1] + 0.0)  # never a negative zero


def _controlled(allocation: Floats) -> Floats:
    """Return the rows of the allocation that are controlled: surge, sway, heave, yaw, and roll and pitch if spanned."""
    rows = allocation.copy()
    kept = [0, 1, 2, YAW]
    for row in (ROLL, PITCH):
        if np.linalg.matrix_rank(allocation[[*kept, row]], tol=1e-6) == len(kept) + 1:
            kept.append(row)
    rows[[row for row in range(6) if row not in kept]] = 0.0
    return rows
