"""Split an agent step so that delays are exact at any step frequency.

With agent steps of T seconds, the command of step k acts from k T + d on: d = m T + r, 0 <= r < T, so within a
step the command of m + 1 steps ago acts for r seconds and then that of m steps ago. A measurement that arrives at
k T was taken at k T - d = (k - p) T - s, 0 <= s < T: T - s seconds into a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

TOLERANCE = 1e-9
"""As a fraction of the step: a delay this close to whole steps is whole steps."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of an agent step during which one command acts."""

    duration: float  # s
    age: int  # of the acting command, in agent steps: 0 is the command of this step
    measure: bool  # a measurement is taken at its end


@dataclass(frozen=True, slots=True)
class Schedule:
    """The segments of every agent step and how long commands and measurements must be kept."""

    segments: tuple[Segment, ...]
    commands: int  # commands to keep, the newest included; 1 without an action delay
    measurements: int  # measurements to keep; 0 without an observation delay


def split(delay: float, frequency: float) -> tuple[int, float]:
    """Return the whole agent steps in a delay in s, and the rest as a fraction of a step in [0, 1).

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
    """Return the schedule for agent steps at `frequency` Hz with delays in s."""
    late, begins = split(action, frequency)  # the command of `late` steps ago begins to act at `begins`
    old, before_end = split(observation, frequency)
    measured = old > 0 or before_end > 0.0
    taken = 1.0 - before_end  # within a step, when it is measured
    if abs(taken - begins) < TOLERANCE:
        taken = begins  # one cut, not two with nothing between
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
