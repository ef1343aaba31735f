"""Store the echoes of an agent's own rays as small spheres, for a filter that does not know the map.

The spheres are at rest in the world. Their positions follow from the poses and distances that the agent measures.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, tasks
from auvbench.dynamics import frames
from auvbench.errors import ConfigError
from auvbench.observation import ObservationSpec
from auvbench.tasks.ranges.ideal import IdealFan
from auvbench.worlds.kinds import SPHERE
from auvbench.worlds.solids import SOLID

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK = "range.ideal"
"""Name of the block whose rays show where an echo is"""
SCANS, BETWEEN = 6, 0.8
"""Number of stored scans, and time between them, s. Until the next scan begins, each step overwrites the newest scan. Therefore a
stored echo is forgotten after 4.0 s and one agent step"""
RADIUS = 0.1
"""Radius of an echo's sphere, m"""
FAR = 1e6
"""Each coordinate of an unused sphere, m: far enough away that the filter ignores it"""


class Echoes:
    """The echoes of N vehicles.

    Args:
        config: configuration with `filter.knows=ranges`.
        spec: specification of the observation.
        n: number of episodes.

    Raises:
        ConfigError: the observation has no rays that show where an echo is.
    """

    def __init__(self, config: schema.TrainConfig, spec: ObservationSpec, n: int) -> None:
        if BLOCK not in (names := tasks.blocks(config.task)):
            raise ConfigError(
                f"filter.knows=ranges: needs {BLOCK}, since other sensors do not show where in a beam an echo is; task.observation has "
                f"{', '.join(names)}; add {BLOCK}, or use filter.knows=map"
            )
        sensor: Any = config.task.range.ideal
        shared = {"duration": 1.0 / config.step.frequency}
        self.rays: Floats = IdealFan(BLOCK, sensor, 1, config.step.frequency, shared).rays
        """Directions (k, 3) of the rays, unit vectors in body axes"""
        self.columns, self.high = spec[BLOCK], float(sensor.high)
        self.every = max(1, round(BETWEEN * config.step.frequency))
        count = SCANS * len(self.rays)
        self.counts: Integers = np.full(n, count)
        """Number (n,) of spheres in each episode"""
        self.solids = np.zeros((n, count), SOLID)
        """Spheres (n, SCANS * k)"""
        self.solids["kind"], self.solids["radius"], self.solids["reach"] = SPHERE, RADIUS, RADIUS
        for name, axis in zip(("along_x", "along_y", "along_z"), np.eye(3), strict=True):
            self.solids[name] = axis
        self.solids["position"] = FAR

    def forget(self, indices: Integers) -> None:
        """Forget the echoes of episodes that begin."""
        self.solids["position"][indices] = FAR

    def see(
        self, pose: Floats, observation: NDArray[np.float32], steps: Integers, start: int, stop: int
    ) -> None:
        """Store the echoes that the vehicles start .. stop - 1 observe at poses (n, 7), after `steps` (n,) steps of their episodes."""
        close = observation[start:stop, self.columns].astype(np.float64)
        R = frames.rotation(pose[start:stop, 3:])
        # Summed term by term, because a matrix product may round differently in a batch of another size.
        along = sum(R[:, None, :, j] * self.rays[None, :, None, j] for j in range(3))
        places = pose[start:stop, None, :3] + (self.high * (1.0 - close))[:, :, None] * along
        rows, k = np.arange(start, stop)[:, None], len(self.rays)
        slots = steps[start:stop, None] // self.every % SCANS * k + np.arange(k)
        self.solids["position"][rows, slots] = np.where(close[:, :, None] > 0.0, places, FAR)
