"""Control by PID, the classical baseline: proportional-integral for velocity, proportional-derivative for the
heading, with optional integral action on the heading.

The outer loop, the allocation and the limits are in `cascade.py`. The drag at the commanded velocity is fed
forward; gains follow from bandwidths and the sheet's masses.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.base import Actions, Integers, Observations
from auvbench.agents.classical.cascade import YAW, Cascade, Estimator, to_level
from auvbench.config import schema
from auvbench.config.algorithms.pid import PID
from auvbench.errors import ConfigError
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.actuators import BuoyancyEngine, Fin, MassShifter, Thruster
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

HOLDING = np.radians(30.0)  # largest yaw error in rad at which the yaw error is integrated
STEERED = 2.0
"""Smallest bandwidth of the heading loop in rad/s if the guidance by a way or a sonar commands the heading. With 0.6 rad/s, the moment of a
cross current keeps a BlueROV2 up to 60 degrees off its course"""
STEEPEST = np.radians(35.0)  # largest commanded flight-path angle
RUDDER_GAIN = 4.0  # rad of rudder per rad of yaw error; the hull damps the turn by itself
TURNING_RADIUS = 14.0  # turning radius in m of the Tethys at full rudder, 0.9 m/s and 0.064 rad/s
MARGIN = 3.0  # m, assumed distance at which the vehicle reaches a waypoint
PATH_GAIN = 1.0  # rad of elevator per rad of flight-path error
LEAD_GAIN = 0.35  # rad of elevator per rad of commanded flight-path angle


def controller(config: schema.TrainConfig, vehicle: VehicleModel) -> PIDController | FinController:
    """Return the PID baseline for a vehicle with thrusters, or for a vehicle with propeller and fins."""
    fins = any(isinstance(unit, Fin) for unit in vehicle.units)
    return FinController(config, vehicle) if fins else PIDController(config, vehicle)


class PIDController(Cascade):
    """Controller with PI on velocities and PD or PID on the heading."""

    carried = ("integral", "heading_integral")

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, PID)
        self.gains = gains
        super().__init__(config, vehicle)
        steered = self.ranging is not None and self.ranging.turns
        self.heading_bandwidth = max(gains.heading_bandwidth, STEERED) if steered else gains.heading_bandwidth

    def reset(self, episodes: Integers) -> None:
        super().reset(episodes)
        self.integral: Floats = np.zeros((len(episodes), 3))
        self.heading_integral: Floats = np.zeros(len(episodes))

    def heading_error(self) -> Floats:
        """Return the yaw error (n,) in rad to correct."""
        return self.estimate.yaw_error

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        g, now = self.gains, self.estimate
        wrench = np.zeros((len(wanted), 6))
        miss = wanted - velocity
        wrench[:, :3] = self.mass[:3] * (g.bandwidth * miss + self.integral) + self._drag(wanted)
        omega = self.heading_bandwidth
        turn = now.turning - now.yaw_rate
        wrench[:, YAW] = self.turning_mass(2.0 * omega) * (
            omega**2 * (self.heading_error() + self.heading_integral) + 2.0 * omega * turn
        )
        return wrench

    def after(self, miss: Floats, scale: Floats) -> None:
        # Conditional integration: no wind-up while the thrusters are saturated.
        free = scale >= 1.0
        step = self.gains.bandwidth / self.gains.integral_time * self.dt
        self.integral += np.where(free[:, None], step * miss, 0.0)
        if self.gains.heading_integral_time is not None:
            error = self.heading_error()
            holds = free & (np.abs(error) < HOLDING)  # not during a turn to a new heading
            self.heading_integral += np.where(holds, error * self.dt / self.gains.heading_integral_time, 0.0)


class FinController:
    """Classical baseline for torpedo-shaped vehicles: propeller, rudder, elevator, buoyancy.

    Line-of-sight guidance (Fossen 2021, section 12.3): the rudder turns the bow towards the waypoint, the
    elevator sets a flight-path angle towards the waypoint's depth. If the waypoint is within the turning circle, the
    vehicle first moves straight on until the waypoint is outside the circle. On a path, the vehicle aims at the point
    of the tangent that is `TURNING_RADIUS` ahead, and keeps the path's speed.

    Signs come from the sheet: at forward speed, a fin behind the origin that turns about +z moves the bow to
    starboard; a fin that turns about +y raises the bow.

    Raises:
        ConfigError: integral action of the heading is configured.
    """

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        gains = config.algo
        assert isinstance(gains, PID)
        if gains.heading_integral_time is not None:
            raise ConfigError(
                f"algo.heading_integral_time={gains.heading_integral_time:g}: not available for "
                f"vehicle={vehicle.name}, whose fins steer "
                "without integral action; use algo.heading_integral_time=null"
            )
        self.vehicle = vehicle
        self.gains = gains
        self.follows = TASKS[config.task.name].has_yaw
        """whether the vehicle follows a path; otherwise it moves to a waypoint"""
        spec = observation_spec(config.task, vehicle.actuators)
        self.estimate = Estimator(1.0 / config.step.frequency, gains.filter_time, spec)
        self.span = vehicle.command_limits
        self.share = np.linalg.pinv(vehicle.allocation[:1])[:, 0]
        """(n_u,) thrust of each thruster per newton of surge force"""
        self.reset(np.empty(0, dtype=np.int64))

    def reset(self, episodes: Integers) -> None:
        self.estimate.reset(len(episodes))
        self.opening = np.zeros(len(episodes), dtype=np.bool_)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Estimator.memory` with `opening`: whether the vehicle moves on straight until it can reach the waypoint."""
        return {**self.estimate.memory(), "opening": self.opening}

    def act(self, observation: Observations) -> Actions:
        now = self.estimate
        now.update(observation.astype(np.float64))
        yaw_error, wanted = self.guidance()
        velocity = to_level(now.velocity, now.tilt)
        speed = np.linalg.norm(velocity, axis=1)
        path = np.arctan2(velocity[:, 2], np.maximum(np.hypot(*velocity[:, :2].T), 0.3))

        turn = RUDDER_GAIN * yaw_error
        climb = PATH_GAIN * (wanted - path) + LEAD_GAIN * wanted
        climb = np.where(speed < 0.1, 0.0, climb)
        lift = np.clip(now.error[:, 2] / 3.0, -1.0, 1.0)

        thrust = self._thrust()
        action = np.zeros((len(observation), len(self.vehicle.units)))
        for j, unit in enumerate(self.vehicle.units):
            if isinstance(unit, Thruster):
                action[:, j] = thrust[:, j]
            elif isinstance(unit, Fin):
                aft = 1.0 if unit.position[0] < 0.0 else -1.0
                angle = -aft * unit.direction[2] * turn + aft * unit.direction[1] * climb
                low, high = self.span[j]
                action[:, j] = np.clip(2.0 * (angle - low) / (high - low) - 1.0, -1.0, 1.0)
            elif isinstance(unit, MassShifter):
                # Weight moved aft raises the bow.
                action[:, j] = -np.sign(unit.direction[0]) * np.clip(wanted / STEEPEST, -1.0, 1.0)
            elif isinstance(unit, BuoyancyEngine):
                action[:, j] = lift
            else:
                action[:, j] = -1.0  # keep the drop weight
        return action

    def guidance(self) -> tuple[Floats, Floats]:
        """Return the yaw error (n,) to correct and the flight-path angle (n,) to take, in rad."""
        now = self.estimate
        aim = now.error
        if self.follows:
            speed = np.linalg.norm(now.target, axis=1, keepdims=True)
            aim = aim + TURNING_RADIUS * now.target / np.maximum(speed, 1e-6)
        level = np.hypot(aim[:, 0], aim[:, 1])
        climb = np.clip(np.arctan2(aim[:, 2], np.maximum(level, 1e-6)), -STEEPEST, STEEPEST)
        turn = np.arctan2(aim[:, 1], aim[:, 0]) if self.follows else self._to_waypoint(level)
        return turn, climb

    def _thrust(self) -> Floats:
        """Return the thrusters' actions (n, n_u): full thrust to a waypoint, or the thrust that keeps a path's speed."""
        now, g = self.estimate, self.gains
        if not self.follows:
            return np.full((len(now.error), len(self.vehicle.units)), g.effort)
        vehicle, speed = self.vehicle, np.linalg.norm(now.target, axis=1)
        drag = (vehicle.linear_damping[0] + vehicle.quadratic_damping[0] * speed) * speed
        push = drag + vehicle.M[0, 0] * g.bandwidth * (speed - np.linalg.norm(now.velocity, axis=1))
        return np.clip(vehicle.action(push[:, None] * self.share), -g.effort, g.effort)

    def _to_waypoint(self, level: Floats) -> Floats:
        """Return the yaw error (n,) in rad to correct; 0 while the vehicle moves straight away from a waypoint inside
        its turning circle.
        """
        error = self.estimate.yaw_error
        # `off`: distance of the waypoint from the centre of the tightest circle on which the vehicle can turn towards it.
        ahead, aside = level * np.cos(error), level * np.abs(np.sin(error))
        off = np.hypot(ahead, aside - TURNING_RADIUS)
        within = (off < TURNING_RADIUS - MARGIN) & (level > MARGIN)
        self.opening = np.where(self.opening, off < TURNING_RADIUS, within)
        return np.where(self.opening, 0.0, error)
