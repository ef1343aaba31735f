"""Replay commands in the simulator by the rules of the task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.envs.batch import Batch
from auvbench.evaluation.bounds.files import Commands
from auvbench.record import Record

Floats = NDArray[np.float64]

UNIT = 32512
"""Commands are stored and replayed as multiples of 1/UNIT of their range. This resolution is fine enough for unstable vehicles."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """Start pose and waypoint of an episode, in the world frame."""

    pose: Floats
    """Pose (7,): x, y, z in m, and quaternion (w, x, y, z) of a level attitude"""
    yaw: float
    """Heading at the start, rad"""
    waypoint: Floats
    """Waypoint (3,), m"""

    @property
    def target(self) -> Floats:
        """Return the waypoint (3,) in the frame of the start: x along the heading at the start, z as in the world."""
        east, north = self.waypoint[:2] - self.pose[:2]
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([c * east + s * north, c * north - s * east, self.waypoint[2]])

    def relative(self, pose: Floats) -> Floats:
        """Return poses (..., 7) in the frame of the start (see `target`)."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        east, north = np.moveaxis(pose[..., :2] - self.pose[:2], -1, 0)
        place = c * east + s * north, c * north - s * east, pose[..., 2]
        # Quaternion of a turn by -yaw about z, times the vehicle's quaternion.
        c, s = np.cos(0.5 * self.yaw), np.sin(0.5 * self.yaw)
        w, x, y, z = np.moveaxis(pose[..., 3:], -1, 0)
        return np.stack([*place, c * w + s * z, c * x + s * y, c * y - s * x, c * z - s * w], axis=-1)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of replayed commands."""

    record: Record
    """record of the episode; `outcome` is timeout if the commands end before the episode does"""
    pose: Floats
    """Poses (T + 1, 7) at the start and after each step"""
    velocity: Floats
    """Velocities (T + 1, 6) at the start and after each step, body axes"""

    @property
    def arrived(self) -> bool:
        return self.record["outcome"] == "success"

    @property
    def steps(self) -> int:
        return int(self.record["steps"])


class Trial:
    """Simulation of one vehicle in still water, without noise."""

    def __init__(self, config: schema.TrainConfig) -> None:
        self.batch = Batch(silent(config), 1, seed=0, test=True, autoreset=False)
        self.vehicle = self.batch.vehicle

    def run(self, scenario: Scenario, commands: Commands) -> Outcome:
        """Apply stored commands (T, n_u) from the start until the commands or the episode end."""
        flown = actions(commands)
        return self.fly(scenario, len(flown), lambda step, pose, velocity: flown[step])

    def fly(self, scenario: Scenario, steps: int, action: Callable[[int, Floats, Floats], Floats]) -> Outcome:
        """Apply the actions of a function from the start for `steps` steps, or until the episode ends.

        Args:
            scenario: start pose and waypoint.
            steps: largest number of steps.
            action: function of step, pose (7,) and velocity (6,) that returns an action (n_u,).
        """
        batch = self.batch
        batch.reset(pose=scenario.pose[None], waypoint=scenario.waypoint[None])
        pose, velocity = [batch.simulator.pose[0].copy()], [batch.simulator.velocity[0].copy()]
        for step in range(steps):
            transition = batch.step(action(step, pose[-1], velocity[-1])[None])
            pose.append(batch.simulator.pose[0].copy())
            velocity.append(batch.simulator.velocity[0].copy())
            if transition.records:
                return Outcome(transition.records[0], np.array(pose), np.array(velocity))
        record = batch.task.records(np.array([0]))[0]
        return Outcome(record | {"outcome": "timeout"}, np.array(pose), np.array(velocity))


def silent(config: schema.TrainConfig) -> schema.TrainConfig:
    """Return the configuration without noise."""
    return replace(config, noise=replace(config.noise, scale=0.0))


def stored(actions: Floats) -> Commands:
    """Return actions (T, n_u) in [-1, 1] as stored commands, which are multiples of 1/`UNIT`."""
    return np.rint(UNIT * np.clip(actions, -1.0, 1.0)).astype(np.int16)


def actions(commands: Commands) -> Floats:
    """Return stored commands as actions (..., n_u) in [-1, 1]."""
    return commands.astype(np.float64) / UNIT


def scenarios(batch: Batch) -> list[Scenario]:
    """Return the scenarios of a batch that was just reset."""
    pose = batch.simulator.pose
    return [
        Scenario(pose[i].copy(), float(e.start_yaw), e.reference.copy())
        for i, e in enumerate(batch.task.episodes)
    ]
