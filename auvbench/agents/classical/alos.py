"""Guide a vehicle along a path by adaptive line of sight (ALOS); the PID autopilot is the inner loop.

    psi_d   = pi_h - beta_hat  - atan(y_e / Delta_h),   beta_hat'  = gamma_h Delta_h / sqrt(Delta_h^2 + y_e^2) Proj(y_e)
    theta_d = pi_v + alpha_hat + atan(z_e / Delta_v),   alpha_hat' = gamma_v Delta_v / sqrt(Delta_v^2 + z_e^2) Proj(z_e)

after T. I. Fossen and A. P. Aguiar, "A uniform semiglobal exponential stable adaptive line-of-sight (ALOS)
guidance law for 3-D path following", Automatica 163, 111556 (2024); compared with `GNC/ALOS3D.m` of
github.com/cybergalactic/MSS, commit 108ceda48c5f. pi_h and pi_v are azimuth and elevation of the path, y_e
and z_e the errors across it, beta_hat and alpha_hat the learned crab angle and angle of attack. The
projection follows the paper: an estimate that exceeds its limit slows down, and stops at the limit plus `BEYOND`. In
`ALOS3D.m` the factor c of the projection is always 1, so that an estimate stops abruptly.

In `ALOS3D.m`, azimuths are clockwise from north, y_e is to starboard and z_e downwards. Here azimuths are
counter-clockwise and y_e is to port, which mirrors both sides of the first equation; z_e stays positive
below the path.

The controllers command no sway force. With a sway force, a vehicle would resist a current without a crab angle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.cascade import Estimator, wrap
from auvbench.agents.classical.pid import STEEPEST, FinController, PIDController
from auvbench.config import schema
from auvbench.config.algorithms.alos import ALOS
from auvbench.config.tasks import blocks
from auvbench.errors import ConfigError
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.actuators import Fin
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

SWAY = 1
FOLLOWED = 0.5
"""largest yaw error in rad at which crab angle and angle of attack are learned: while the vehicle still turns, the
cross-track error does not come from a crab angle
"""
BEYOND = 0.001
"""angle in rad by which an estimate may exceed its limit, as in `ALOS3D.m`"""


def controller(config: schema.TrainConfig, vehicle: VehicleModel) -> ALOSController | FinALOSController:
    """Return the ALOS controller for a vehicle with thrusters, or for a vehicle with propeller and fins.

    Raises:
        ConfigError: the task has no path, or the observation lacks the path's direction.
    """
    if not TASKS[config.task.name].path:
        able = " or ".join(f"task={name}" for name, spec in TASKS.items() if spec.path)
        raise ConfigError(
            f"algo={config.algo.name} follows a path, which task={config.task.name} does not have; use {able}"
        )
    for block in ("velocity_error", "velocity"):
        if block not in blocks(config.task):
            raise ConfigError(
                f"algo={config.algo.name} needs the path's direction, from velocity_error and velocity; "
                "task.observation has "
                f"no {block}"
            )
    fins = any(isinstance(unit, Fin) for unit in vehicle.units)
    return FinALOSController(config, vehicle) if fins else ALOSController(config, vehicle)


class Guidance(Estimator):
    """ALOS guidance law for N vehicles, with an estimator of their motion; it learns crab angle and angle of attack."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        assert isinstance(config.algo, ALOS)
        self.gains = config.algo
        spec = observation_spec(config.task, vehicle.actuators)
        super().__init__(1.0 / config.step.frequency, config.algo.filter_time, spec)

    def reset(self, n: int) -> None:
        super().reset(n)
        self.crab: Floats = np.zeros(n)
        """(n,) learned crab angle beta_hat, rad"""
        self.attack: Floats = np.zeros(n)
        """(n,) learned angle of attack alpha_hat, rad"""

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return `Estimator.memory` with the learned angles."""
        return {**super().memory(), "crab": self.crab, "attack": self.attack}

    def steer(self) -> tuple[Floats, Floats]:
        """Return yaw error (n,) and flight-path angle (n,) in rad from the latest readings, and update the
        learned angles.

        The yaw error that the task observes is the path's azimuth minus the vehicle's yaw.
        """
        azimuth = self.yaw_error
        x, y, z = self.target.T
        elevation = np.arctan2(z, np.hypot(x, y))
        # The position error points from the vehicle to the path.
        x, y, z = self.error.T
        ahead = np.cos(azimuth) * x + np.sin(azimuth) * y
        port = np.sin(azimuth) * x - np.cos(azimuth) * y
        below = np.cos(elevation) * z - np.sin(elevation) * ahead
        turn, climb = self.angles(port, below)
        yaw_error = wrap(azimuth + turn)
        self.learn(port, below, np.abs(yaw_error) < FOLLOWED)
        return yaw_error, np.clip(elevation + climb, -STEEPEST, STEEPEST)

    def angles(self, port: Floats, below: Floats) -> tuple[Floats, Floats]:
        """Return the turn to port and the climb, (n,) rad each, to add to azimuth and elevation of the path.

        Args:
            port: (n,) distance of the vehicle to port of the path, m.
            below: (n,) distance of the vehicle below the path, m.
        """
        g = self.gains
        turn = -self.crab - np.arctan(port / g.look_ahead)
        return turn, self.attack + np.arctan(below / g.look_ahead_vertical)

    def learn(self, port: Floats, below: Floats, where: NDArray[np.bool_]) -> None:
        """Update the learned angles from the errors of one step.

        Args:
            port: (n,) distance of the vehicle to port of the path, m.
            below: (n,) distance of the vehicle below the path, m.
            where: (n,) whether the vehicle has its commanded heading; other vehicles keep their learned angles.
        """
        g = self.gains
        for estimate, error, distance, gain in (
            (self.crab, port, g.look_ahead, g.adaptation),
            (self.attack, below, g.look_ahead_vertical, g.adaptation_vertical),
        ):
            rate = gain * distance / np.sqrt(distance**2 + error**2)
            estimate += np.where(where, self.dt * rate * projected(estimate, error, g.largest_angle), 0.0)


def projected(estimate: Floats, error: Floats, limit: float) -> Floats:
    """Return the error (n,), reduced where it would push an estimate (n,) further beyond its limit. The reduced
    error fades to 0 at `limit` + BEYOND.
    """
    c = np.minimum(1.0, (estimate**2 - limit**2) / ((limit + BEYOND) ** 2 - limit**2))
    outwards = (np.abs(estimate) > limit) & (estimate * error > 0.0)
    return np.where(outwards, (1.0 - c) * error, error)


class ALOSController(PIDController):
    """ALOS over the PID autopilot of a vehicle with thrusters: surge, heave and heading."""

    estimate: Guidance

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        super().__init__(config, vehicle)
        self.estimate = Guidance(config, vehicle)

    def guidance(self) -> Floats:
        self._turn, climb = self.estimate.steer()
        speed = np.linalg.norm(self.estimate.target, axis=1)
        # The vehicle first turns, then moves ahead.
        ahead = speed * np.cos(climb) * np.maximum(np.cos(self._turn), 0.0)
        return np.stack([ahead, np.zeros(len(speed)), speed * np.sin(climb)], axis=1)

    def heading_error(self) -> Floats:
        return self._turn

    def law(self, wanted: Floats, velocity: Floats) -> Floats:
        wrench = super().law(wanted, velocity)
        wrench[:, SWAY] = 0.0
        return wrench


class FinALOSController(FinController):
    """ALOS over the PID autopilot of a vehicle with propeller and fins."""

    estimate: Guidance

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        super().__init__(config, vehicle)
        self.estimate = Guidance(config, vehicle)

    def guidance(self) -> tuple[Floats, Floats]:
        return self.estimate.steer()
