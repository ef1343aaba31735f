"""Steer by an artificial potential field around a sonar's echoes; the PID autopilot is the inner loop.

    F = F_goal + sum over nearest echoes of  repulsion (1 / rho - 1 / influence) / rho^2  away from the echo,   rho < influence

after O. Khatib, "Real-time obstacle avoidance for manipulators and mobile robots", International Journal of Robotics Research 5(1), 1986.
rho is the distance of an echo from the hull. Khatib uses the nearest point of each obstacle. A sonar does not tell obstacles apart, so here
each of SECTORS sectors round the vehicle has one nearest echo. F is a velocity, and F_goal is the velocity of the PID guidance. If F
vanishes or alternates in direction before the goal, the vehicle stays in a local minimum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from auvbench.agents.classical.pid import PIDController
from auvbench.agents.classical.ranging import FASTEST, FASTEST_CLIMB, NEAR, FreeWayGuidance, sonar_of
from auvbench.config import schema
from auvbench.config.algorithms.apf import APF
from auvbench.config.tasks import blocks
from auvbench.errors import ConfigError
from auvbench.observation import ObservationSpec
from auvbench.registry import TASKS
from auvbench.tasks.observation_spec import observation_spec
from auvbench.vehicles.actuators import Fin
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

SECTORS = 12
"""Number of sectors round the vehicle; the nearest echo of each sector repels the vehicle"""
TOUCHING = 0.05
"""Smallest rho in m, so that the force is finite at contact"""


def controller(config: schema.TrainConfig, vehicle: VehicleModel) -> PotentialController:
    """Return the potential-field controller for a vehicle with thrusters.

    Raises:
        ConfigError: the reference has its own yaw, no observed sonar looks ahead, or the vehicle steers by fins.
    """
    name = config.algo.name
    if TASKS[config.task.name].has_yaw:
        able = " or ".join(f"task={task}" for task, spec in TASKS.items() if not spec.has_yaw)
        raise ConfigError(
            f"algo={name}: steers to a point, but task={config.task.name} has a reference with its own yaw; use {able}"
        )
    if sonar_of(config) is None:
        raise ConfigError(
            f"algo={name}: needs a sonar that looks ahead, but task.observation has only {', '.join(blocks(config.task))}; add "
            "range.multibeam, range.ideal or range.ping360"
        )
    if any(isinstance(unit, Fin) for unit in vehicle.units):
        raise ConfigError(
            f"algo={name}: needs thrusters, but vehicle={vehicle.name} steers by fins; use algo=pid"
        )
    return PotentialController(config, vehicle)


class PotentialController(PIDController):
    """PID controller whose guidance follows a potential field."""

    def __init__(self, config: schema.TrainConfig, vehicle: VehicleModel) -> None:
        super().__init__(config, vehicle)
        sonar = sonar_of(config)
        assert sonar is not None
        self.ranging = PotentialGuidance(
            config, sonar, vehicle, observation_spec(config.task, vehicle.actuators)
        )


class PotentialGuidance(FreeWayGuidance):
    """Guidance along the force of a potential field, computed from the echoes that `FreeWayGuidance` stores."""

    def __init__(
        self, config: schema.TrainConfig, key: str, vehicle: VehicleModel, spec: ObservationSpec
    ) -> None:
        assert isinstance(config.algo, APF)
        self.influence, self.repulsion = config.algo.influence, config.algo.repulsion
        self.hull = float(vehicle.hull[0]) + 0.5 * float(vehicle.hull[1])
        super().__init__(config, key, vehicle, spec)

    def steer(
        self, observation: Floats, error: Floats, wanted: Floats, velocity: Floats, yaw_rate: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the commanded velocity and the yaw error to correct; see `FreeWayGuidance.steer`."""
        echoes = self._remembered(self._distances(observation), velocity, yaw_rate)
        to_goal = np.hypot(error[:, 0], error[:, 1])
        fastest = np.minimum(np.hypot(wanted[:, 0], wanted[:, 1]), FASTEST)
        pull = (fastest / np.maximum(to_goal, 1e-9))[:, None] * error[:, :2]
        force = pull + self.repelled(echoes)
        course = np.arctan2(force[:, 1], force[:, 0])
        # The vehicle turns before it moves, so that its sonar looks in the direction of motion.
        speed = np.minimum(np.hypot(force[:, 0], force[:, 1]), fastest) * np.maximum(np.cos(course), 0.0) ** 2
        level = speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        climb = np.clip(error[:, 2] / np.maximum(to_goal, NEAR) * speed, -FASTEST_CLIMB, FASTEST_CLIMB)
        return np.concatenate([level, climb[:, None]], axis=1), course

    def repelled(self, echoes: Floats) -> Floats:
        """Return the repulsion (n, 2) in m/s, level axes, of echoes (n, m, 2) in m."""
        x, y = np.moveaxis(echoes, -1, 0)
        away = np.hypot(x, y)
        sector = np.floor((np.arctan2(y, x) / (2.0 * np.pi) + 0.5) * SECTORS).astype(np.int64) % SECTORS
        force = np.zeros((len(echoes), 2))
        rows = np.arange(len(echoes))
        for k in range(SECTORS):
            nearest = np.where(sector == k, away, np.inf).argmin(axis=1)
            distance = np.where(sector[rows, nearest] == k, away[rows, nearest], np.inf)
            rho = np.clip(distance - self.hull, TOUCHING, self.influence)
            size = self.repulsion * (1.0 / rho - 1.0 / self.influence) / rho**2
            towards = echoes[rows, nearest] / np.maximum(away[rows, nearest], 1e-9)[:, None]
            force -= size[:, None] * towards
        return force
