"""Compute a controller's actions on the way to a waypoint or at a station. This module contains no network code."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.observation import ObservationSpec
from auvbench.pilot.live_observation import observe
from auvbench.pilot.mission import Logbook, Mission
from auvbench.vehicles.vehicle_model import VehicleModel

Floats = NDArray[np.float64]


class Controller(Protocol):
    """The part of `auvbench.agents.base.Agent` that a pilot uses."""

    def reset(self, episodes: NDArray[np.int64]) -> None: ...

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.floating]: ...


class Filter(Protocol):
    """The part of `auvbench.tasks.filters.flight.Protection` that a pilot uses."""

    name: str

    @property
    def changed(self) -> int: ...

    @property
    def infeasible(self) -> int: ...

    def begin(self) -> None: ...

    def refusal(self, point: Floats) -> str: ...

    def protect(self, pose: Floats, velocity: Floats, action: Floats) -> Floats: ...


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a pilot."""

    depth_low: float  # m, lowest z
    depth_high: float  # m, highest z
    goal_radius: float  # m, distance at which a waypoint is reached
    max_steps: int  # largest number of agent steps per waypoint
    pose_timeout: float = 0.5  # s, largest age of a pose; with an older pose, the pilot commands zero thrust
    lost_after: float = 5.0  # s, age of a pose at which the pilot disarms
    patience: float = 1.0  # s, longest time without a message from the pilot; then its supervisor disarms
    # whether to keep station: reaching the station does not end the mission, and a new mission begins every `max_steps` steps
    holds: bool = False
    # m, largest distance from the waypoint (for a manoeuvre: from the place of arming); at a larger distance, the pilot disarms
    reach: float = math.inf

    @property
    def depths(self) -> str:
        """Return the allowed heights as text."""
        return f"{self.depth_low:g} .. {self.depth_high:g} m"

    def within(self, z: float) -> bool:
        """Return whether a height in m is allowed."""
        return self.depth_low <= z <= self.depth_high


@dataclass(slots=True, eq=False)
class Steering:
    """Controller, its waypoint, and the recorded mission."""

    controller: Controller
    vehicle: VehicleModel
    """vehicle that the controller's actions move"""
    frequency: float
    """rate of the controller, Hz"""
    spec: ObservationSpec
    """layout of the controller's observation"""
    limits: Limits
    name: str = ""
    """name of the controller"""
    logbook: Logbook | None = None
    filter: Filter | None = None
    """safety filter between the controller and the vehicle"""
    waypoint: Floats | None = None
    """(3,) waypoint or station, m"""
    yaw: float = 0.0
    """yaw to keep at a station, rad"""
    once: bool = False
    """whether to make one manoeuvre, whose waypoint is the place of arming; the pilot ends after the manoeuvre"""
    mission: Mission | None = field(default=None, init=False)
    """current mission, which begins with the first action towards a waypoint; None before this action"""
    action_time: float = field(default=0.0, init=False)
    """computing time of the controller's last action, s"""
    ended: list[tuple[Mission, str]] = field(default_factory=list, init=False)
    """ended missions that `write` has not written yet, each with the reason for its end"""
    _action: Floats | None = field(default=None, init=False)
    """(n_u,) action of the present step; None before a mission's first action and after `skip_record`"""

    def distance(self, pose: Floats) -> float:
        """Return the distance in m from a pose (7,) to the waypoint; 0 without a waypoint."""
        return 0.0 if self.waypoint is None else math.dist(pose[:3], self.waypoint)

    def advance(self, pose: Floats) -> str:
        """Record the step that ended at `pose` (7,); return the mission's outcome if the step ended the mission, else ''."""
        if self.mission is None or self._action is None:
            return ""
        action = self._action
        vehicle = self.vehicle
        ended = self.mission.advance(pose, action, vehicle.force(action), float(vehicle.power(action)))
        if ended != "timeout" or not self.limits.holds:
            return ended
        mission, self.mission = self.mission, self._mission(pose, self.mission.waypoint)
        self._record(mission, "the next mission holds the same station")
        return ""

    def skip_record(self) -> None:
        """Do not record the present step: its result is unknown."""
        self._action = None

    def act(self, pose: Floats, velocity: Floats) -> Floats:
        """Return the action (n_u,) in [-1, 1] for the step from `pose` (7,) with `velocity` (6,), body axes.

        A waypoint must be set.

        Raises:
            RunError: the controller or the filter returned an invalid action.
            Exception: an exception of the controller or of the filter.
        """
        waypoint = self.waypoint
        assert waypoint is not None
        if self.mission is None:
            self.mission = self._mission(pose, waypoint)
            self._action = None
            self.controller.reset(np.zeros(1, dtype=np.int64))
        n_u = len(self.vehicle.actuators)
        previous = np.zeros(n_u) if self._action is None else self._action
        begun = time.monotonic()
        limits = self.limits
        yaw, depth = self.yaw if limits.holds else None, (limits.depth_low, limits.depth_high)
        seen = observe(self.spec, pose, velocity, waypoint, previous, yaw=yaw, depth=depth)
        answer = np.asarray(self.controller.act(seen[None]), dtype=np.float64)
        if answer.shape != (1, n_u):
            raise RunError(f"the controller's answer has shape {answer.shape}, must be {(1, n_u)}")
        if not np.all(np.isfinite(answer)):
            raise RunError("the controller's answer is not finite")
        action: Floats = np.clip(answer[0], -1.0, 1.0)
        if self.filter is not None:
            action = self.filter.protect(pose, velocity, action)
            if not np.all(np.isfinite(action)):
                raise RunError("the filter's answer is not finite")
        self.action_time = time.monotonic() - begun
        self._action = action
        return action

    def _mission(self, pose: Floats, waypoint: Floats) -> Mission:
        limits = self.limits
        return Mission(
            pose,
            waypoint,
            depth=(limits.depth_low, limits.depth_high),
            goal_radius=0.0 if limits.holds else limits.goal_radius,
            max_steps=limits.max_steps,
            frequency=self.frequency,
        )

    def end(self, reason: str) -> None:
        """End the present mission; if it has at least one step, the next `write` records it in the logbook, if any."""
        mission, self.mission, self._action = self.mission, None, None
        self._record(mission, reason)

    def _record(self, mission: Mission | None, reason: str) -> None:
        if mission is not None and self.logbook is not None and mission.steps:
            self.ended.append((mission, reason + self._interventions()))
        if self.filter is not None:
            self.filter.begin()

    def _interventions(self) -> str:
        """Return what the filter did since the mission began, as text to append to the reason of the mission's end."""
        if self.filter is None:
            return ""
        return f"; the filter changed {self.filter.changed} commands, {self.filter.infeasible} of them beyond the thrusters' limits"

    def write(self) -> None:
        """Write the missions that have ended; the vehicle must be at rest, since a disk may be slow or full.

        Raises:
            RunError: the logbook cannot be written.
        """
        while self.ended:
            assert self.logbook is not None
            self.logbook.add(*self.ended.pop(0))
