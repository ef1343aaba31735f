"""The classical baseline: a cascaded waypoint controller through the inverse of the thruster allocation.

Outer loop: a velocity towards the waypoint, `cruise_speed` when far and `approach` x distance when near. Inner
loop: proportional-integral control of the velocity with the drag at the wanted speed as feed-forward, and of the
heading towards the waypoint. The wanted wrench is allocated to the thrusters by the pseudo-inverse (Fossen 2021,
section 11.2.1, unconstrained allocation) and scaled down as a whole where a thruster would saturate, so that its
direction is kept. A vehicle with fins runs ahead and steers with them (`steering.py`). Gains follow from bandwidths
and the masses of the vehicle's sheet.

It has no better sensors than the learners: yaw is the bearing to the waypoint less the yaw error, velocities are
filtered differences of the noisy readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.steering import Steering
from auvbench.config import schema
from auvbench.vehicles.inspect import reach
from auvbench.vehicles.model import VehicleModel

Floats = NDArray[np.float64]

SURGE, SWAY, HEAVE, ROLL, PITCH, YAW = range(6)


class PIDController:
    """A waypoint controller for vehicles whose thrusters span surge, heave and yaw.

    Args:
        config: gains in `config.algo`, the step frequency, the frame of the observation.
        vehicle: its masses, damping and allocation.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, schema.PID)
        self.gains = gains
        self.vehicle = vehicle
        self.dt = 1.0 / config.step.frequency
        self.body_frame = config.task.position_frame == "body"
        self.mass = np.diag(vehicle.M).copy()
        self.allocation = np.linalg.pinv(_controlled(vehicle.allocation))
        # Nobody plans a speed out of reach: what little thrust is left must still hold the heading.
        ahead = [row.speed for row in reach(vehicle) if row.axis == SURGE and row.sign > 0]
        self.cruise_speed = min([gains.cruise_speed, *(0.9 * speed for speed in ahead)])
        # Exact discretisation of a first-order low-pass filter.
        self.smoothing = 1.0 - np.exp(-self.dt / gains.filter_time)
        self.lift = vehicle.buoyancy - vehicle.weight
        special = any(unit.kind != "thruster" for unit in vehicle.units)
        self.steering = Steering(vehicle, gains.heading_bandwidth, self.dt) if special else None
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        n = len(episodes)
        self.first = True
        self.error: Floats = np.zeros((n, 3))
        self.yaw: Floats = np.zeros(n)
        self.velocity: Floats = np.zeros((n, 3))
        self.yaw_rate: Floats = np.zeros(n)
        self.integral: Floats = np.zeros((n, 3))
        if self.steering is not None:
            self.steering.reset(n)

    def act(self, observation: Observations) -> Actions:
        g = self.gains
        error, yaw, yaw_error = self._readings(observation.astype(np.float64))
        self._estimate_velocity(error, yaw)
        distance = np.linalg.norm(error, axis=1, keepdims=True)
        speed = np.minimum(self.cruise_speed, g.approach * distance)
        wanted = speed * error / np.maximum(distance, 1e-9)

        # World to the levelled body frame: the readings hold no roll and pitch.
        miss = _to_body(wanted - self.velocity, yaw)
        feed = _to_body(wanted, yaw)
        vehicle = self.vehicle
        drag = (vehicle.linear_damping[:3] + vehicle.quadratic_damping[:3] * np.abs(feed)) * feed
        force = self.mass[:3] * (g.bandwidth * miss + self.integral) + drag
        force[:, HEAVE] -= self.lift
        if self.steering is not None:
            # Fins work by way through the water: always ahead, with all there is.
            force[:, SURGE] = np.sum(vehicle.force_limits[:, 1])
        omega = g.heading_bandwidth
        moment = self.mass[YAW] * (omega**2 * yaw_error - 2.0 * omega * self.yaw_rate)

        wrench = np.zeros((len(observation), 6))
        wrench[:, :3] = force
        wrench[:, YAW] = moment
        # Column by column: a matrix product may round a row differently in a batch of another size.
        thrust = np.zeros((len(observation), self.allocation.shape[0]))
        for row in range(6):
            thrust += wrench[:, row : row + 1] * self.allocation[:, row]
        action, saturated = self._within_limits(thrust)
        if self.steering is not None:
            action = action + self.steering.act(error, yaw_error, self.velocity)
        # Conditional integration: no wind-up while the thrusters give all they have.
        step = g.bandwidth / g.integral_time * self.dt
        self.integral += np.where(saturated[:, None], 0.0, step * miss)
        return action

    def _readings(self, o: Floats) -> tuple[Floats, Floats, Floats]:
        """World position error (n, 3), yaw (n,) and yaw error (n,)."""
        yaw_error = o[:, 0]
        error = o[:, 1:4].copy()
        if self.body_frame:
            # Only differences of yaw matter then: any heading may be called zero, so the body's is.
            return error, np.zeros(len(o)), yaw_error
        bearing = np.arctan2(error[:, 1], error[:, 0])
        return error, _wrap(bearing - yaw_error), yaw_error

    def _estimate_velocity(self, error: Floats, yaw: Floats) -> None:
        if self.first:
            self.error, self.yaw, self.first = error, yaw, False
            return
        a = self.smoothing
        # The waypoint stands still: the error shrinks by the way made.
        self.velocity += a * ((self.error - error) / self.dt - self.velocity)
        self.yaw_rate += a * (_wrap(yaw - self.yaw) / self.dt - self.yaw_rate)
        self.error, self.yaw = error, yaw

    def _within_limits(self, thrust: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Normalised commands for thruster forces (n, n_u) in N, scaled down as a whole to the limits."""
        limits = self.gains.effort * self.vehicle.force_limits
        bound = np.where(thrust >= 0.0, limits[:, 1], -limits[:, 0])
        ratio = np.max(np.abs(thrust) / np.maximum(bound, 1e-9), axis=1)
        scale = 1.0 / np.maximum(ratio, 1.0)
        return self.vehicle.action(thrust * scale[:, None]), ratio > 1.0


def _controlled(allocation: Floats) -> Floats:
    """The rows of the allocation that are controlled.

    Roll and pitch are not measured; where the thrusters can produce their moments independently of what is wanted,
    they are asked for none, else thrust below the centre of gravity would tip a vehicle with a weak restoring moment.
    """
    rows = allocation.copy()
    wanted = [SURGE, SWAY, HEAVE, YAW]
    for moment in (ROLL, PITCH):
        rank = np.linalg.matrix_rank(allocation[wanted])
        if np.linalg.matrix_rank(allocation[[*wanted, moment]]) > rank:
            wanted.append(moment)
        else:
            rows[moment] = 0.0
    return rows


def _to_body(world: Floats, yaw: Floats) -> Floats:
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, z = world.T
    return np.stack([c * x + s * y, c * y - s * x, z], axis=1)


def _wrap(angle: Floats) -> Floats:
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)
