"""Guide vehicles along a known way, round obstacles that a sonar shows, or at an altitude that an echo sounder measures.

The controllers of `cascade` use this guidance if the task observes a way, a sonar or an echo sounder. The guidance knows the sensor's
configuration.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.ranges import GRADIANS, key_of
from auvbench.config.tasks import blocks
from auvbench.observation import ObservationSpec
from auvbench.registry import TASKS
from auvbench.tasks.ranges.beams import middles, spread
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

MARGIN = 0.45
"""Clearance that a free way needs on each side of the vehicle, m"""
LOOK_AHEAD = 6.0
"""Length over which a way must be free, m"""
TURNS = np.radians(np.arange(-90.0, 91.0, 5.0))
"""Directions among which a vehicle chooses, rad from the bow"""
KEEPING = 0.3
"""Cost of changing the direction by 1 rad, in rad of deviation from the goal's bearing"""
NEAR = 1.0
"""Smallest horizontal distance to the goal that the commanded slope assumes, m: near the goal, the slope stops growing"""
FASTEST = 0.6
"""Largest speed in m/s: above it, a BlueROV2 raises its bow, and its sonar does not look ahead"""
STOPPING = 0.5
"""Largest speed of the vehicle per metre of free distance ahead, 1/s"""
SCANS, BETWEEN = 6, 0.8
"""Number of stored scans, and time between them in s. A beam passes over or under near obstacles, so these need stored echoes"""
LEVEL = np.radians(12.0)
"""Largest elevation of rays that look ahead, rad"""

FAR = 1e6
"""Coordinates in m that are stored for a missing echo: too far away to block a way"""

CLIMB = 0.8
"""Bandwidth of the altitude loop, 1/s"""
FASTEST_CLIMB = 0.5
"""Largest vertical speed, m/s"""
GLITCH = 1.0
"""Largest accepted jump from one measured distance to the next, m"""
PATIENCE = 8
"""Number of rejected distances in a row after which a jump is accepted"""
SURE = 0.5
"""Smallest confidence at which a measured distance is accepted"""


def of(config: schema.TrainConfig, vehicle: VehicleModel, spec: ObservationSpec) -> Any:
    """Return the guidance by an observed way or, without a way, by an observed range sensor; None if the task observes neither."""
    if "way" in blocks(config.task):
        return WayGuidance(spec)
    seen = {key_of(name) for name in blocks(config.task)}
    altitude = getattr(config.task, "altitude", None)
    if altitude is not None and "ping1d" in seen:
        return AltitudeGuidance(altitude, spec)
    sonar = sonar_of(config)
    return None if sonar is None else FreeWayGuidance(config, sonar, vehicle, spec)


def sonar_of(config: schema.TrainConfig) -> str | None:
    """Return the key of the observed sonar that looks ahead; None without a sonar, or if the reference has its own yaw."""
    seen = {key_of(name) for name in blocks(config.task)}
    sonars = [key for key in ("multibeam", "ideal", "ping360") if key in seen]
    return sonars[0] if sonars and not TASKS[config.task.name].has_yaw else None


def rays_of(key: str, sensor: Any) -> tuple[Floats, Integers]:
    """Return azimuths (k,) in rad, counter-clockwise from the bow, and columns (k,) in the sonar's block, of the rays that look ahead."""
    if key == "multibeam":
        return sensor.yaw - middles(sensor.horizontal, sensor.beams), np.arange(sensor.beams)
    if key == "ping360":
        span = 2.0 * np.pi * sensor.beams * sensor.step / GRADIANS
        return middles(span, sensor.sectors) + sensor.yaw, np.arange(sensor.sectors)
    azimuths = -spread(sensor.horizontal, sensor.columns)
    elevations = spread(sensor.vertical, sensor.rows) + sensor.pitch
    ahead = np.flatnonzero(np.abs(np.repeat(elevations, sensor.columns)) <= LEVEL)
    return np.tile(azimuths, sensor.rows)[ahead] + sensor.yaw, ahead


class WayGuidance:
    """Follow a way: move towards the point of the way that the observation shows, and turn the bow to this point."""

    turns = True
    """whether the heading follows the guidance"""

    def __init__(self, spec: ObservationSpec) -> None:
        self.block = spec["way"]

    def reset(self, n: int) -> None:
        """Begin n episodes."""

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are carried from step to step: none."""
        return {}

    def steer(
        self, observation: Floats, error: Floats, wanted: Floats, velocity: Floats, yaw_rate: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the commanded velocity and the yaw error to correct; see `FreeWayGuidance.steer`."""
        ahead = observation[:, self.block]
        course = np.arctan2(ahead[:, 1], ahead[:, 0])
        speed = np.sqrt((wanted**2).sum(axis=1))
        far = np.maximum(np.sqrt((ahead**2).sum(axis=1)), 1e-6)
        return (speed / far)[:, None] * ahead, course


class FreeWayGuidance:
    """Steer in the direction nearest to the goal in which a way as wide as the vehicle is free.

    After the vector field histogram of Borenstein and Koren (IEEE Transactions on Robotics and Automation 7(3), 1991). In place of a grid,
    it stores the echoes of the last seconds, and moves them by dead reckoning.
    """

    turns = True

    def __init__(
        self, config: schema.TrainConfig, key: str, vehicle: VehicleModel, spec: ObservationSpec
    ) -> None:
        sensor: Any = getattr(config.task.range, key)
        self.dt = 1.0 / config.step.frequency
        self.every = max(1, round(BETWEEN / self.dt))
        azimuths, columns = rays_of(key, sensor)
        self.columns = columns + spec[f"range.{key}"].start
        self.unit = np.stack([np.cos(azimuths), np.sin(azimuths)])  # (2, k)
        self.high = float(sensor.high)
        self.wide = float(vehicle.hull[0]) + 0.5 * float(vehicle.hull[1]) + MARGIN
        self.reset(0)

    def reset(self, n: int) -> None:
        self.course: Floats = np.zeros(n)
        """(n,) direction chosen in the previous step, rad from the bow"""
        self.echoes: Floats = np.full((n, SCANS, self.unit.shape[1], 2), FAR)
        """(n, scans, k, 2) stored echoes in m from the vehicle, level axes"""
        self.steps = np.zeros(n, dtype=np.int64)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are carried from step to step."""
        return {"course": self.course, "echoes": self.echoes, "steps": self.steps}

    def steer(
        self, observation: Floats, error: Floats, wanted: Floats, velocity: Floats, yaw_rate: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the commanded velocity (n, 3) in m/s, level axes, and the yaw error (n,) in rad to correct.

        Args:
            observation: (n, n_obs).
            error: (n, 3) m, vector to the goal, level axes.
            wanted: (n, 3) m/s, velocity straight to the goal, level axes.
            velocity: (n, 3) m/s, level axes.
            yaw_rate: (n,) rad/s.
        """
        distance = self._distances(observation)
        to_goal = np.hypot(error[:, 0], error[:, 1])
        bearing = np.arctan2(error[:, 1], error[:, 0])
        free = self._free(self._remembered(distance, velocity, yaw_rate), to_goal)
        off = np.abs(_wrap(TURNS - bearing[:, None]))
        cost = off + KEEPING * np.abs(TURNS - self.course[:, None])
        enough = free >= np.minimum(LOOK_AHEAD, to_goal)[:, None]
        # If no direction is free far enough, choose the direction with the longest free way.
        cost = np.where(enough.any(axis=1, keepdims=True), np.where(enough, cost, np.inf), -free)
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(best))
        course = TURNS[best]
        speed = np.minimum(np.hypot(wanted[:, 0], wanted[:, 1]), FASTEST)
        speed = np.minimum(speed, STOPPING * np.maximum(free[rows, best], 0.0))
        # The vehicle turns before it moves, so that its sonar looks in the direction of motion.
        speed = speed * np.maximum(np.cos(course), 0.0) ** 2
        level = speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        # The vehicle climbs and sinks only while it moves ahead: the sonar sees little above and below the vehicle.
        climb = np.clip(error[:, 2] / np.maximum(to_goal, NEAR) * speed, -FASTEST_CLIMB, FASTEST_CLIMB)
        self.course = course
        return np.concatenate([level, climb[:, None]], axis=1), course

    def _distances(self, observation: Floats) -> Floats:
        """Return the distances (n, k) in m of the present echoes; infinite without an echo."""
        close = observation[:, self.columns]
        return np.where(close > 0.0, self.high * (1.0 - close), np.inf)

    def _remembered(self, distance: Floats, velocity: Floats, yaw_rate: Floats) -> Floats:
        """Store the present echoes at distances (n, k); return the echoes (n, m, 2) of the last seconds in m, level axes."""
        x, y = np.moveaxis(self.echoes, -1, 0)
        moved = (velocity[:, :2] * self.dt)[:, :, None, None]
        x, y = x - moved[:, 0], y - moved[:, 1]
        c, s = (f(yaw_rate * self.dt)[:, None, None] for f in (np.cos, np.sin))
        echoes = np.stack([c * x + s * y, c * y - s * x], axis=-1)
        now = np.where(
            np.isfinite(distance)[..., None], np.nan_to_num(distance)[..., None] * self.unit.T, FAR
        )
        slot = self.steps // self.every % SCANS
        echoes[np.arange(len(slot)), slot] = now
        self.echoes, self.steps = echoes, self.steps + 1
        return np.concatenate([now, echoes.reshape(len(slot), -1, 2)], axis=1)

    def _free(self, echoes: Floats, to_goal: Floats) -> Floats:
        """Return the length (n, directions) in m of the free way in each direction."""
        x, y = np.moveaxis(echoes, -1, 0)
        near = np.hypot(x, y) <= np.minimum(to_goal + self.wide, LOOK_AHEAD + 2.0)[:, None]
        rows = np.nonzero(near)[0]  # few echoes are near, and only these can block a way
        x, y = x[near][:, None], y[near][:, None]
        ahead = np.cos(TURNS) * x + np.sin(TURNS) * y
        aside = np.cos(TURNS) * y - np.sin(TURNS) * x
        blocked = (np.abs(aside) < self.wide) & (ahead > 0.0)
        free: Floats = np.full((len(echoes), len(TURNS)), FAR)
        seeing, first = np.unique(rows, return_index=True)
        if len(seeing):
            free[seeing] = np.minimum.reduceat(np.where(blocked, ahead - self.wide, FAR), first)
        return free


class AltitudeGuidance:
    """Hold an altitude by an echo sounder, like ArduSub's SURFTRAK: reject glitches, and add the vertical motion since the measurement."""

    turns = False

    def __init__(self, altitude: float, spec: ObservationSpec) -> None:
        self.altitude, self.block = altitude, spec["range.ping1d"]
        self.reset(0)

    def reset(self, n: int) -> None:
        self.held: Floats = np.full(n, np.inf)
        """(n,) last accepted distance in m; infinite before the first one"""
        self.doubts = np.zeros(n, dtype=np.int64)
        """(n,) number of distances rejected since the last accepted distance"""

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are carried from step to step."""
        return {"held": self.held, "doubts": self.doubts}

    def steer(
        self, observation: Floats, error: Floats, wanted: Floats, velocity: Floats, yaw_rate: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the commanded velocity (n, 3) in m/s, level axes, and None for the yaw error; see `FreeWayGuidance.steer`."""
        distance, confidence, age = observation[:, self.block].T
        near = (np.abs(distance - self.held) <= GLITCH) | (self.doubts >= PATIENCE) | np.isinf(self.held)
        believed = near & (confidence >= SURE)
        self.doubts = np.where(believed, 0, self.doubts + 1)
        self.held = np.where(believed, distance, self.held)
        above = self.held + velocity[:, 2] * age - self.altitude
        climb = np.where(np.isinf(self.held), 0.0, np.clip(-CLIMB * above, -FASTEST_CLIMB, FASTEST_CLIMB))
        return np.concatenate([wanted[:, :2], climb[:, None]], axis=1), None


def _wrap(angle: Floats) -> Floats:
    return np.asarray(np.mod(angle + np.pi, 2.0 * np.pi) - np.pi)
