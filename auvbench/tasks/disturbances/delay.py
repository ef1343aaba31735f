"""Delays: commands that act late, and measurements that arrive late."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config.disturbances import Delay
from auvbench.simulators.base import Simulator
from auvbench.tasks.disturbances.base import Disturbance

Floats = NDArray[np.float64]

TOLERANCE = 1e-9
"""Tolerance as a fraction of a step: a delay within this tolerance of a whole number of steps is rounded to that number."""


class DeadTime(Disturbance):
    """Delayed commands and measurements of N episodes."""

    settings: Delay

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        task, n_u = self.task, len(self.vehicle.actuators)
        self.schedule = schedule(task.frequency, self.settings.action, self.settings.observation)
        self.commands: Floats = np.zeros((self.schedule.commands, task.n, n_u))
        """Ring (k, n, n_u) of the last commands: the command of step t is at index t modulo k"""
        self.measurements: Floats = np.zeros((self.schedule.measurements, task.n, 7))
        """Ring (k, n, 7) of the last measured poses"""
        self.velocities: Floats = np.zeros(
            (self.schedule.measurements if task.reads_velocity else 0, task.n, 6)
        )
        """Ring (k, n, 6) of the last measured velocities; empty if the task does not observe velocities"""
        self.clock: NDArray[np.int64] = np.zeros((), dtype=np.int64)  # number of agent steps of the batch

    def begin(self, indices: NDArray[np.int64], simulator: Simulator) -> None:
        """Fill the rings of new episodes with zero commands, the start pose and zero velocities."""
        self.commands[:, indices] = 0.0
        self.measurements[:, indices] = simulator.pose[indices]
        self.velocities[:, indices] = 0.0

    def carry(
        self,
        simulator: Simulator,
        command: Floats,
        power: Floats,
        act: Callable[[Simulator, Floats, float], None],
    ) -> None:
        """Carry out an agent step: let `act` simulate each segment, and write the mean power (n,)."""
        duration, reads_velocity = self.task.duration, self.task.reads_velocity
        kept, now = len(self.commands), int(self.clock)
        self.commands[now % kept] = command
        power[:] = 0.0
        for segment in self.schedule.segments:
            act(simulator, self.commands[(now - segment.age) % kept], segment.duration)
            power += simulator.power * (segment.duration / duration)
            if segment.measure:
                self.measurements[now % len(self.measurements)] = simulator.pose
                if reads_velocity:
                    self.velocities[now % len(self.velocities)] = simulator.velocity
        self.clock += 1

    def measured(self, simulator: Simulator) -> tuple[Floats, Floats]:
        """Return the poses (n, 7) and velocities (n, 6) that arrive now, without the errors of the readings."""
        kept = len(self.measurements)
        if not kept:
            return simulator.pose, simulator.velocity
        # The oldest measurement is at index `clock`, where the next measurement will replace it.
        oldest = int(self.clock) % kept
        velocity = self.velocities[oldest] if self.task.reads_velocity else simulator.velocity
        return self.measurements[oldest], velocity

    def arrays(self) -> dict[str, NDArray[Any]]:
        arrays: dict[str, NDArray[Any]] = {
            "commands": self.commands,
            "measurements": self.measurements,
            "clock": self.clock,
        }
        return arrays | ({"velocities": self.velocities} if self.task.reads_velocity else {})


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of an agent step during which one command acts."""

    duration: float  # s
    age: int  # age of the acting command in agent steps; 0: the command of this step
    measure: bool  # whether a measurement is taken at the end of the segment


@dataclass(frozen=True, slots=True)
class Schedule:
    """The segments of every agent step, and how many commands and measurements must be stored."""

    segments: tuple[Segment, ...]
    commands: int  # commands to keep, the newest included; 1 without an action delay
    measurements: int  # measurements to keep; 0 without an observation delay


def split(delay: float, frequency: float) -> tuple[int, float]:
    """Return the number of whole agent steps in a delay (s), and the rest of the delay as a fraction of a step in [0, 1).

    >>> split(0.25, 10.0)
    (2, 0.5)
    >>> split(0.3, 10.0)
    (3, 0.0)
    """
    steps = delay * frequency
    whole = math.floor(steps + TOLERANCE)
    rest = steps - whole
    return whole, rest if rest > TOLERANCE else 0.0


def schedule(frequency: float, action: float, observation: float) -> Schedule:
    """Return the schedule for agent steps at `frequency` Hz with delays in s, exact at any frequency.

    With agent steps of T seconds and an action delay d = m T + r, 0 <= r < T, the command of step k acts from k T + d
    on. Within a step, the command of m + 1 steps ago acts for r seconds, and then the command of m steps ago acts.
    With an observation delay d, a measurement that arrives at k T was taken at k T - d = (k - p) T - s, 0 <= s < T,
    which is T - s seconds into a step.
    """
    late, begins = split(action, frequency)  # the command of `late` steps ago begins to act at `begins`
    old, before_end = split(observation, frequency)
    measured = old > 0 or before_end > 0.0
    taken = 1.0 - before_end  # time of the measurement, as a fraction of a step
    if abs(taken - begins) < TOLERANCE:
        taken = begins  # one cut instead of two cuts at the same time
    cuts = sorted({0.0, begins, taken, 1.0})
    segments = tuple(
        Segment(
            duration=(end - start) / frequency,
            age=late if start >= begins else late + 1,
            measure=measured and end == taken,
        )
        for start, end in pairwise(cuts)
    )
    return Schedule(
        segments=segments,
        commands=late + 1 + (begins > 0.0),
        measurements=old + 1 if measured else 0,
    )
