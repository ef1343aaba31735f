"""From a pose to an action: one controller on its way to one waypoint, without a network.

What it is asked to steer, and whether it may, is decided by the `auvbench.ros2.pilot` that has it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import RunError
from auvbench.ros2.mission import Logbook, Mission
from auvbench.ros2.observation import observe

Floats = NDArray[np.float64]


class Controller(Protocol):
    """What steers: see `auvbench.agents.base.Agent`."""

    def reset(self, episodes: NDArray[np.int64]) -> None: ...

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.floating]: ...


class Thrust(Protocol):
    """What actions stand for, of one vehicle."""

    @property
    def actuators(self) -> Sequence[str]: ...

    @property
    def neutral(self) -> Floats: ...

    def quantities(self, action: Floats) -> Floats:
        """What is published for an action (n_u,): N of thrusters, rad, m or m3 of others."""

    def force(self, action: Floats) -> Floats:
        """N (n_u,) of the thrusters."""

    def power(self, action: Floats) -> float:
        """W."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What a pilot keeps to."""

    depth_low: float  # m, z
    depth_high: float  # m, z
    goal_radius: float  # m
    max_steps: int  # of the controller, per waypoint
    pose_timeout: float = 0.5  # s: zero thrust while the pose is older
    lost_after: float = 5.0  # s: disarmed when it stays older

    @property
    def depths(self) -> str:
        """The heights to be at, in words."""
        return f"{self.depth_low:g} .. {self.depth_high:g} m"

    def within(self, z: float) -> bool:
        """Whether a height in m is one to be at."""
        return self.depth_low <= z <= self.depth_high


class Steering:
    """A controller, the waypoint that it is on its way to, and the mission that is recorded of it.

    Args:
        controller: steers.
        thrust: what its actions stand for.
        frequency: Hz of the controller.
        body_frame: of the position error that it observes.
        limits: of a mission.
        logbook: keeps missions.

    Attributes:
        waypoint: (3,) m, or None.
        mission: under way, or None: it begins with the first action towards a waypoint.
        took: s that the controller needed for its last action.

    """

    def __init__(
        self,
        controller: Controller,
        thrust: Thrust,
        *,
        frequency: float,
        body_frame: bool,
        limits: Limits,
        logbook: Logbook | None = None,
    ) -> None:
        self.controller, self.thrust, self.limits = controller, thrust, limits
        self.frequency, self.body_frame, self.logbook = frequency, body_frame, logbook
        self.waypoint: Floats | None = None
        self.mission: Mission | None = None
        self.took = 0.0
        self._action: Floats | None = None  # under way since the last step

    def advance(self, pose: Floats) -> str:
        """Books the step that has just ended at `pose` (7,); the outcome of the mission, if that ended it."""
        if self.mission is None or self._action is None:
            return ""
        action = self._action
        return self.mission.advance(pose, action, self.thrust.force(action), self.thrust.power(action))

    def forget(self) -> None:
        """The step under way is not booked: what it led to is not known."""
        self._action = None

    def act(self, pose: Floats) -> Floats:
        """The action (n_u,) in [-1, 1] of the step that begins at `pose` (7,); there must be a waypoint.

        Raises:
            RunError: the controller answers with what is no action; and whatever else it raises.
        """
        waypoint = self.waypoint
        assert waypoint is not None
        if self.mission is None:
            self._begin(pose, waypoint)
        n_u = len(self.thrust.actuators)
        previous = np.zeros(n_u) if self._action is None else self._action
        begun = time.monotonic()
        seen = observe(pose, waypoint, previous, self.body_frame)
        answer = np.asarray(self.controller.act(seen[None]), dtype=np.float64)
        if answer.shape != (1, n_u):
            raise RunError(f"the controller answers with shape {answer.shape}, not {(1, n_u)}")
        if not np.all(np.isfinite(answer)):
            raise RunError("the controller answers with what is not finite")
        self.took = time.monotonic() - begun
        self._action = np.clip(answer[0], -1.0, 1.0)
        return self._action

    def _begin(self, pose: Floats, waypoint: Floats) -> None:
        limits = self.limits
        self.mission = Mission(
            pose,
            waypoint,
            depth=(limits.depth_low, limits.depth_high),
            goal_radius=limits.goal_radius,
            max_steps=limits.max_steps,
            frequency=self.frequency,
        )
        self._action = None
        self.controller.reset(np.zeros(1, dtype=np.int64))

    def end(self, reason: str) -> None:
        """Closes the mission that is under way, and keeps it if it has a step.

        Raises:
            RunError: the logbook cannot be written.
        """
        mission, self.mission, self._action = self.mission, None, None
        if mission is not None and self.logbook is not None and mission.steps:
            self.logbook.add(mission, reason)
