"""Base class of range sensors: a function for one episode, and the sensor's state in this episode.

A sensor measures the solids from the true pose at the end of an agent step or, with delayed measurements, from the delayed pose. The
sensor changes its state once in each step of the episode, so that a second observation of the same step is equal to the first.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.layout import Matrix, Vector
from auvbench.dynamics.random import RANGE, uniform4
from auvbench.dynamics.vectors import rotation_matrix
from auvbench.tasks import records
from auvbench.tasks.ranges.beams import mounted
from auvbench.tasks.records import Record
from auvbench.tasks.rows import row
from auvbench.worlds.casting import nearest_along

Floats = NDArray[np.float64]

NOW = 1e-9
"""Tolerance of times, as a fraction of a period: a ping that is due within this time is due now"""


class Scene(NamedTuple):
    """Solids that a sensor can measure, and the pose from which it measures."""

    solids: Any  # (most,) records, the first `n_solids` exist
    n_solids: int
    heights: Any  # heights of terrain, m
    time: float  # s since the start of the episode
    position: Vector  # m, world axes
    rotation: Matrix  # rotation from body to world axes
    stream: int  # flag of the random streams: TEST, VALIDATION or 0


@row
def scene(solids: Any, n_solids: int, heights: Any, time: float, pose: Any, stream: int) -> Scene:
    """Return the scene that a sensor measures from a pose (7,), `time` s after the start of the episode."""
    rotation: Matrix = rotation_matrix((pose[3], pose[4], pose[5], pose[6]))
    return Scene(solids, n_solids, heights, time, (pose[0], pose[1], pose[2]), rotation, stream)


@row
def distance_along(scene: Scene, rotation: Matrix, rays: Any, first: int, stop: int, longest: float) -> float:
    """Return the distance in m of the nearest echo along several rays; `longest` if no surface is nearer.

    Args:
        scene: solids and the vehicle's pose.
        rotation: rotation from the axes of the rays to world axes.
        rays: (k, 3) unit vectors; first .. stop - 1 are used.
        first: index of the first ray.
        stop: index after the last ray.
        longest: largest distance, m.
    """
    solids = scene.solids[: scene.n_solids]
    here = scene.time, scene.position
    return float(nearest_along(solids, scene.heights, *here, rotation, rays, first, stop, longest))


@row
def draws(e: Record, p: Record, stream: int, block: int) -> tuple[float, float, float, float]:
    """Return four random numbers in (0, 1) for a sensor in this step; each `block` has its own numbers."""
    return uniform4(e.seed, RANGE | stream, p.channel + block, e.steps, e.episode, e.environment)


@row
def normal(u: float, v: float) -> float:
    """Return a standard normal number from two uniform numbers (Box and Muller, 1958)."""
    return float(math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v))


@row
def closeness(e: Record, p: Record, stream: int, block: int, distance: float, low: float) -> float:
    """Return 1 - distance / high with the sensor's noise; 0 without an echo or when the echo is lost."""
    if p.noise > 0.0 or p.dropout > 0.0:
        lost, u, v, _ = draws(e, p, stream, block)
        if lost < p.dropout:
            return 0.0
        if p.noise > 0.0 and distance < p.high:
            distance += p.noise * normal(u, v)
    return float(1.0 - min(max(distance, low), p.high) / p.high)


@row
def pings_until(steps: int, p: Record) -> int:
    """Return the number of pings from the start of an episode to the end of an agent step, without the ping at the start."""
    pings: int = math.floor(steps * p.duration / p.period + NOW)
    return pings


@row
def new_step(e: Record, d: Record) -> bool:
    """Return whether this step of the episode is new to the sensor, and mark it as seen."""
    new = e.steps == 0 or d.step != e.steps
    d.step = e.steps
    return bool(new)


@row
def keep(e: Record, p: Record, memory: Floats) -> None:
    """Store the present measurement in the ring of delayed measurements; at the start of an episode, store it in all slots.

    Args:
        e: the episode.
        p: parameters of the sensor, with `size` and `slots` of `more`.
        memory: (size * (1 + slots),) present measurement, then the ring.
    """
    for slot in range(p.slots):
        if e.steps == 0 or slot == e.steps % p.slots:
            for j in range(p.size):
                memory[(1 + slot) * p.size + j] = memory[j]


@row
def arrived(e: Record, p: Record, memory: Floats, j: int) -> float:
    """Return value j of the delayed measurement that arrives at this step."""
    slot = 1 + (e.steps + 1) % p.slots
    return float(memory[slot * p.size + j])


class RangeSensor:
    """One sensor of N episodes.

    Args:
        name: name of the block.
        settings: configuration, with the schema of the sensor's spec.
        n: number of episodes.
        frequency: frequency of the agent's steps, Hz.
        shared: parameters of every task, by name.
    """

    sense: ClassVar[Callable[..., None]]
    """`sense(e, d, memory, p, rays, scene, out)`: writes the numbers of the block for the episode e, with the parameters p. The record d
    and the floats `memory` are the sensor's state in the episode"""
    fields: ClassVar[tuple[tuple[Any, ...], ...]] = ()
    """Fields that an episode stores in addition to `memory`: (name, type)"""

    def __init__(
        self, name: str, settings: Any, n: int, frequency: float, shared: Mapping[str, float]
    ) -> None:
        self.name, self.settings, self.frequency = name, settings, frequency
        owner = f"task.observation={name}"
        size, delay = self.size(), getattr(settings, "delay", 0.0)
        slots = 1 + math.ceil(delay * frequency - NOW) if size else 0
        more = {"size": size, "slots": slots, "channel": zlib.crc32(name.encode()) & 0xFFFF0000}
        own = {**records.of_schema(settings), **self.more(), **more}
        self.parameters = records.one_row(own, shared, owner)
        """Parameters (1,) of the sensor"""
        self.rays = mounted(self.directions(), settings.yaw, settings.pitch)
        """Directions (k, 3) of the rays, unit vectors in body axes"""
        self.state = records.state(n, (*self.fields, ("step", "i8")), owner)
        """State (n,) of the sensor in each episode"""
        # `memory` is not a field of the records, because each shape of a record's fields needs its own compiled code.
        self.memory: Floats = np.zeros((n, size * (1 + slots)))
        """Present measurement of each episode, followed by the delayed measurements (`keep`)"""

    def directions(self) -> Floats:
        """Return the rays (k, 3) of a sensor that points forward: unit vectors."""
        raise NotImplementedError

    def size(self) -> int:
        """Return the number of values of a measurement that an episode stores; 0: it stores no measurement."""
        return 0

    def more(self) -> dict[str, Any]:
        """Return parameters in addition to the keys of the schema, by name."""
        return {}
