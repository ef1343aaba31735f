"""Guide vehicles along a known way, or by what their range sensors show: round obstacles, and at an altitude.

The controllers of `cascade` do this if the task observes the way or such a sensor. They know the sensor's keys.
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
"""m that a way between echoes is wider than the vehicle, on each side"""
LOOK_AHEAD = 6.0
"""m that a way must be free"""
TURNS = np.radians(np.arange(-90.0, 91.0, 5.0))
"""rad, directions among which a vehicle chooses"""
KEEPING = 0.3
"""weight of a change of direction, in rad of detour"""
NEAR = 1.0
"""m, level distance to the goal below which the way does not become steeper"""
FASTEST = 0.6
"""m/s: faster, a BlueROV2 raises its bow, and its sonar does not look ahead"""
STOPPING = 0.5
"""1/s: speed towards an echo, over the distance to it"""
SCANS, BETWEEN = 6, 0.8
"""echoes that are remembered: scans, and s between them. A beam passes over and under what is near"""
LEVEL = np.radians(12.0)
"""elevation of rays that show what is ahead"""

FAR = 1e6
"""m, of an echo that there is not"""

CLIMB = 0.8
"""1/s, bandwidth of the altitude"""
FASTEST_CLIMB = 0.5
"""m/s"""
GLITCH = 1.0
"""m: a distance that jumps by more is not believed"""
PATIENCE = 8
"""distances that jump after which the next one is believed"""
SURE = 0.5
"""confidence of a distance that is believed"""


def of(config: schema.TrainConfig, vehicle: VehicleModel, spec: ObservationSpec) -> Any:
    """Return the guidance for what a task observes: a way, or else a range sensor; None if it has no fitting one."""
    if "way" in blocks(config.task):
        return WayGuidance(spec)
    seen = {key_of(name) for name in blocks(config.task)}
    altitude = getattr(config.task, "altitude", None)
    if altitude is not None and "ping1d" in seen:
        return AltitudeGuidance(altitude, spec)
    sonar = sonar_of(config)
    return None if sonar is None else FreeWayGuidance(config, sonar, vehicle, spec)


def sonar_of(config: schema.TrainConfig) -> str | None:
    """Return the key of the observed sonar that looks ahead; None without one, or if the reference has a yaw of its own."""
    seen = {key_of(name) for name in blocks(config.task)}
    sonars = [key for key in ("multibeam", "ideal", "ping360") if key in seen]
    return sonars[0] if sonars and not TASKS[config.task.name].has_yaw else None


def rays_of(key: str, sensor: Any) -> tuple[Floats, Integers]:
    """Return the azimuths (k,) in rad, counter-clockwise from the bow, of the numbers of a sonar that look ahead, and their columns."""
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
    """Follow a way: move to the point of it that the observation shows, and turn the bow there."""

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
        """Return velocity and yaw error to correct; the arguments are those of `FreeWayGuidance.steer`."""
        ahead = observation[:, self.block]
        course = np.arctan2(ahead[:, 1], ahead[:, 0])
        speed = np.sqrt((wanted**2).sum(axis=1))
        far = np.maximum(np.sqrt((ahead**2).sum(axis=1)), 1e-6)
        return (speed / far)[:, None] * ahead, course


class FreeWayGuidance:
    """Steer towards the direction nearest to the goal in which a way as wide as the vehicle is free.

    After the vector field histogram of Borenstein and Koren (IEEE Transactions on Robotics and Automation 7(3), 1991), with the echoes
    of the last seconds in place of a grid, moved by dead reckoning.
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
        """(n,) rad, from the bow, of the last step"""
        self.echoes: Floats = np.full((n, SCANS, self.unit.shape[1], 2), FAR)
        """(n, scans, k, 2) m, level axes from the vehicle"""
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
        # Where no way is free for long enough, the longest.
        cost = np.where(enough.any(axis=1, keepdims=True), np.where(enough, cost, np.inf), -free)
        best = np.argmin(cost, axis=1)
        rows = np.arange(len(best))
        course = TURNS[best]
        speed = np.minimum(np.hypot(wanted[:, 0], wanted[:, 1]), FASTEST)
        speed = np.minimum(speed, STOPPING * np.maximum(free[rows, best], 0.0))
        # The vehicle moves where its sonar looks: it first turns.
        speed = speed * np.maximum(np.cos(course), 0.0) ** 2
        level = speed[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
        # It rises and sinks only as it moves on: a beam shows little of what is above and below.
        climb = np.clip(error[:, 2] / np.maximum(to_goal, NEAR) * speed, -FASTEST_CLIMB, FASTEST_CLIMB)
        self.course = course
        return np.concatenate([level, climb[:, None]], axis=1), course

    def _distances(self, observation: Floats) -> Floats:
        """Return the distances (n, k) in m of the echoes of now; infinite without an echo."""
        close = observation[:, self.columns]
        return np.where(close > 0.0, self.high * (1.0 - close), np.inf)

    def _remembered(self, distance: Floats, velocity: Floats, yaw_rate: Floats) -> Floats:
        """Return the echoes (n, m, 2) of now and of the last seconds in m, level axes, for distances (n, k)."""
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
    """Hold an altitude by an echo sounder, as ArduSub's SURFTRAK: glitches are left out, and the way since a distance is added."""

    turns = False

    def __init__(self, altitude: float, spec: ObservationSpec) -> None:
        self.altitude, self.block = altitude, spec["range.ping1d"]
        self.reset(0)

    def reset(self, n: int) -> None:
        self.held: Floats = np.full(n, np.inf)
        """(n,) m, last distance that was believed; infinite: none yet"""
        self.doubts = np.zeros(n, dtype=np.int64)
        """(n,) distances that were not believed since"""

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are carried from step to step."""
        return {"held": self.held, "doubts": self.doubts}

    def steer(
        self, observation: Floats, error: Floats, wanted: Floats, velocity: Floats, yaw_rate: Floats
    ) -> tuple[Floats, Floats | None]:
        """Return the commanded velocity (n, 3) in m/s, level axes; the arguments are those of `FreeWayGuidance.steer`."""
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
