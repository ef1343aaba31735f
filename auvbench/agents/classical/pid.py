"""The classical baseline: a cascaded waypoint controller through the inverse of the thruster allocation.

Outer loop: a velocity towards the waypoint, `cruise_speed` when far and `approach` x distance when near, less where
the thrusters could not hold it against the drag. Inner loop: proportional-integral control of the velocity with the
drag as feed-forward, and of the heading towards the waypoint. The wanted wrench is allocated to the thrusters by the
pseudo-inverse (Fossen 2021, section 11.2, unconstrained allocation) and scaled down as a whole where a thruster
would saturate, so that its direction is kept. Gains follow from bandwidths and the masses of the vehicle's sheet.

It has no better sensors than the learners (see `estimate.py`): roll and pitch are not observed. Where the thrusters
span them, no moment is asked for; where thrust brings one along (the BlueROV2's thrusters lie below its origin), it
is kept below a share of what the restoring moment can hold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical.estimate import Estimator, to_body
from auvbench.agents.classical.fins import FinController
from auvbench.config import algorithms, schema
from auvbench.vehicles.model import VehicleModel

Floats = NDArray[np.float64]

HEAVE, ROLL, PITCH, YAW = 2, 3, 4, 5

# Share of the thrust that steady motion may take; the rest is for control.
CRUISE_SHARE = 0.85
# Share of the largest restoring moment that thrust may lean against: a heel of about 27 degrees.
RIGHTING_SHARE = 0.45


def controller(config: schema.TrainConfig, vehicle: VehicleModel) -> PIDController | FinController:
    """The PID baseline for a vehicle: by thrusters, or by propeller and fins."""
    fins = any(unit.kind == "fin" for unit in vehicle.units)
    return FinController(config, vehicle) if fins else PIDController(config, vehicle)


class PIDController:
    """A waypoint controller for vehicles whose thrusters span surge, sway, heave and yaw.

    Args:
        config: gains in `config.algo`, the step frequency, the frame of the observation.
        vehicle: its masses, damping and allocation.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, algorithms.PID)
        self.gains = gains
        self.vehicle = vehicle
        self.dt = 1.0 / config.step.frequency
        self.estimate = Estimator(self.dt, gains.filter_time, body_frame=config.task.position_frame == "body")
        self.mass = np.diag(vehicle.M).copy()
        self.inverse = np.linalg.pinv(_controlled(vehicle.allocation))
        self.limits = gains.effort * vehicle.force_limits
        self.lift = vehicle.buoyancy - vehicle.weight
        # Moments per newton that thrust brings along uncontrolled, and what the restoring moment can hold.
        self.tilting = vehicle.allocation[[ROLL, PITCH]]
        stiffness = (
            vehicle.buoyancy * vehicle.center_of_buoyancy[2] - vehicle.weight * vehicle.center_of_gravity[2]
        )
        self.tilt_limit = RIGHTING_SHARE * max(float(stiffness), 0.0)
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        self.estimate.reset(len(episodes))
        self.integral: Floats = np.zeros((len(episodes), 3))

    def act(self, observation: Observations) -> Actions:
        g, now = self.gains, self.estimate
        now.update(observation.astype(np.float64))
        distance = np.linalg.norm(now.error, axis=1, keepdims=True)
        speed = np.minimum(g.cruise_speed, g.approach * distance)
        wanted = self._feasible(to_body(speed * now.error / np.maximum(distance, 1e-9), now.yaw))
        miss = wanted - to_body(now.velocity, now.yaw)

        wrench = np.zeros((len(observation), 6))
        wrench[:, :3] = self.mass[:3] * (g.bandwidth * miss + self.integral) + self._drag(wanted)
        wrench[:, HEAVE] -= self.lift
        omega = g.heading_bandwidth
        wrench[:, YAW] = self.mass[YAW] * (omega**2 * now.yaw_error - 2.0 * omega * now.yaw_rate)
        thrust = self._allocate(wrench)
        scale = self._scale(thrust)
        # Conditional integration: no wind-up while the thrusters give all they may.
        step = g.bandwidth / g.integral_time * self.dt
        self.integral += np.where(scale[:, None] < 1.0, 0.0, step * miss)
        return self.vehicle.action(thrust * scale[:, None])

    def _drag(self, velocity: Floats) -> Floats:
        """Drag (n, 3) in N at a velocity (n, 3) along the body's axes."""
        vehicle = self.vehicle
        return np.asarray(
            (vehicle.linear_damping[:3] + vehicle.quadratic_damping[:3] * np.abs(velocity)) * velocity
        )

    def _feasible(self, velocity: Floats) -> Floats:
        """The velocity, slowed where holding it would take more than CRUISE_SHARE of the thrust."""
        for _ in range(3):
            wrench = np.zeros((len(velocity), 6))
            wrench[:, :3] = self._drag(velocity)
            scale = self._scale(self._allocate(wrench) / CRUISE_SHARE)
            # Drag grows with up to the square of the speed: the root does not slow down too much.
            velocity = velocity * np.sqrt(scale)[:, None]
        return velocity

    def _allocate(self, wrench: Floats) -> Floats:
        """Thrust (n, n_u) in N for wrenches (n, 6)."""
        # Row by row: a matrix product may round differently in a batch of another size.
        thrust = np.zeros((len(wrench), self.inverse.shape[0]))
        for row in range(6):
            thrust += wrench[:, row : row + 1] * self.inverse[:, row]
        return thrust

    def _scale(self, thrust: Floats) -> Floats:
        """Factor (n,) <= 1 that keeps every thruster within its limits and the vehicle upright."""
        bound = np.where(thrust >= 0.0, self.limits[:, 1], -self.limits[:, 0])
        ratio = np.max(np.abs(thrust) / np.maximum(bound, 1e-9), axis=1)
        if self.tilt_limit > 0.0:
            for moment in self.tilting:
                tilt = np.zeros(len(thrust))
                for j, arm in enumerate(moment):
                    tilt += arm * thrust[:, j]
                ratio = np.maximum(ratio, np.abs(tilt) / self.tilt_limit)
        return np.asarray(1.0 / np.maximum(ratio, 1.0))


def _controlled(allocation: Floats) -> Floats:
    """The rows of the allocation that are controlled: surge, sway, heave, yaw, and roll and pitch if spanned."""
    rows = allocation.copy()
    kept = [0, 1, 2, YAW]
    for row in (ROLL, PITCH):
        if np.linalg.matrix_rank(allocation[[*kept, row]], tol=1e-6) == len(kept) + 1:
            kept.append(row)
    rows[[row for row in range(6) if row not in kept]] = 0.0
    return rows
