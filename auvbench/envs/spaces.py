"""Spaces of the waypoint task."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.schema import step_limit
from auvbench.vehicles.inspect import net_buoyancy, terminal_speed
from auvbench.vehicles.vehicle_model import VehicleModel

if TYPE_CHECKING:
    from auvbench.envs.batch import Batch

SIGMAS = 6.0
"""standard deviations of what is normally distributed that the bounds hold"""

LONGEST = 1e6
"""m; the bound where nothing slows a vehicle down"""


def of(batch: Batch) -> tuple[spaces.Box, spaces.Box]:
    """Observation space (4 + n_u,) and action space (n_u,) of one environment of the batch."""
    n_u = len(batch.vehicle.actuators)
    high = observation_bounds(batch.config, batch.vehicle)
    return spaces.Box(-high, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (n_u,), dtype=np.float32)


def observation_bounds(config: schema.TrainConfig, vehicle: VehicleModel) -> NDArray[np.float32]:
    """Upper bounds (4 + n_u,) of the observation; the lower ones are their negatives.

    Yaw error: pi. Previous action: 1. Position error: how far away the waypoint may be at the start, and how far the
    vehicle can move away from it until the episode times out (`top_speed`), vertically no farther than the depth
    limits; and the errors of the readings.
    """
    task = config.task
    seconds = step_limit(task, config.step.frequency) / config.step.frequency
    speed = top_speed(vehicle, config.disturbance)
    away = speed * seconds
    start, low, high = (
        np.asarray(v, dtype=np.float64) for v in (task.start, task.waypoint_low, task.waypoint_high)
    )
    apart = np.maximum(np.abs(low - start), np.abs(high - start))
    # The last step may lead beyond a depth limit before the episode ends.
    below, above = high[2] - task.depth_low, task.depth_high - low[2]
    vertical = min(apart[2] + away, max(below, above) + speed / config.step.frequency)
    level = apart[:2] + away
    if task.position_frame == "body":
        level = np.full(2, math.hypot(*level))
    bounds = np.array([*level, vertical]) + _misreading(config, seconds)
    bounds = np.ceil(np.minimum(bounds, LONGEST))
    return np.array([np.pi, *bounds, *[1.0] * len(vehicle.actuators)], dtype=np.float32)


def top_speed(vehicle: VehicleModel, disturbance: schema.Disturbance) -> float:
    """m/s over ground that nothing in an episode exceeds for long.

    Through the water: the speeds that all thrusters together and the net buoyancy would give along each body axis
    alone, the three at once, for the strongest, slipperiest vehicle that may be drawn. The water's own speed comes on
    top. Infinite where an axis has no damping.
    """
    drawn = disturbance.randomisation
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
    current = disturbance.current
    water = current.speed if current.speed_high is None else max(current.speed, current.speed_high)
    wander = math.hypot(
        current.gauss_markov.sigma, current.gauss_markov.sigma, current.gauss_markov.sigma_vertical
    )
    return math.hypot(*axes) + max(1.0, abs(current.profile.factor)) * water + SIGMAS * wander


def _misreading(config: schema.TrainConfig, seconds: float) -> NDArray[np.float64]:
    """(3,) m by which the readings of the position may be wrong."""
    sensor = config.disturbance.sensor
    errors = [
        math.hypot(getattr(sensor.gaussian, axis), getattr(sensor.bias, axis))
        + getattr(sensor.drift, axis) * math.sqrt(seconds)
        for axis in "xyz"
    ]
    return config.noise.position.high * config.noise.scale + SIGMAS * np.asarray(errors)
