"""Compute the bounds of an observation from the largest distance to the reference and the largest errors of readings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.navigation import is_estimated
from auvbench.config.schema import step_limit
from auvbench.observation import ObservationSpec
from auvbench.tasks.disturbances.base import extreme, misreading, water_speed
from auvbench.tasks.observation_spec import observation_spec
from auvbench.tasks.records import LOST
from auvbench.vehicles.inspect import net_buoyancy, terminal_speed
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]

SIGMAS = 6.0
"""Number of standard deviations of a normal error that the bounds of the observation include"""

LONGEST = 1e6
"""Largest bound of a position error, m; it applies if the vehicle has no damping along an axis"""


def bounded_spec(config: schema.TrainConfig, vehicle: VehicleModel) -> ObservationSpec:
    """Return the specification of the observation, with bounds."""
    return observation_spec(config.task, vehicle.actuators, position_bounds(config, vehicle).tolist())


def position_bounds(config: schema.TrainConfig, vehicle: VehicleModel) -> Floats:
    """Return the largest position errors (3,) in whole m, rounded up, including the errors of the readings."""
    seconds = step_limit(config.task, config.step.frequency) / config.step.frequency
    return np.asarray(
        np.ceil(np.minimum(_true_bounds(config, vehicle, seconds) + _misreading(config, seconds), LONGEST))
    )


def start_bounds(config: schema.TrainConfig, vehicle: VehicleModel) -> Floats:
    """Return the largest true position errors (3,) in m for which all readings stay within the bounds of the observation."""
    seconds = step_limit(config.task, config.step.frequency) / config.step.frequency
    return position_bounds(config, vehicle) - _misreading(config, seconds)


def _true_bounds(config: schema.TrainConfig, vehicle: VehicleModel, seconds: float) -> Floats:
    """Return the largest true position errors (3,) in m, without the errors of the readings."""
    speed = top_speed(vehicle, config.disturbance)
    return np.array(config.task.farthest(speed, seconds, config.step.frequency))


def top_speed(vehicle: VehicleModel, disturbance: schema.Disturbance) -> float:
    """Return a speed over ground in m/s that no vehicle exceeds for long: speed through the water plus speed of the water.

    Along each body axis, the speed through the water is the terminal speed under full thrust and net buoyancy. The
    computation uses the most thrust and the least damping that the disturbance may draw. The result is infinite if an axis has no
    damping.
    """
    drawn = disturbance.randomisation
    vehicle = extreme(vehicle, disturbance, -1.0)
    force = np.abs(vehicle.allocation[:3]) @ np.abs(vehicle.force_limits).max(axis=1, initial=0.0)
    force = force * drawn.thrust.high
    heavier = vehicle.weight * (drawn.mass.high - drawn.mass.low)
    lighter = vehicle.buoyancy * (drawn.buoyancy.high - drawn.buoyancy.low)
    # A vehicle without thrusters glides: its net buoyancy drives it along every axis.
    force = force + abs(net_buoyancy(vehicle)) + heavier + lighter
    least = drawn.damping.low
    axes = [
        terminal_speed(float(f), least * float(d), least * float(q))
        for f, d, q in zip(force, vehicle.linear_damping[:3], vehicle.quadratic_damping[:3], strict=True)
    ]
    mean, spread = water_speed(disturbance, vehicle)
    return math.hypot(*axes) + mean + SIGMAS * spread


def _misreading(config: schema.TrainConfig, seconds: float) -> Floats:
    """Return the largest errors (3,) of position readings in m."""
    errors = misreading(config.disturbance, seconds)
    if is_estimated(config):
        return np.full(3, LOST)
    return config.noise.position.high * config.noise.scale + SIGMAS * errors
