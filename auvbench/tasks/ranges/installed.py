"""The range sensors of a task's observation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.config.ranges import key_of
from auvbench.registry import BLOCKS, resolve
from auvbench.tasks import records
from auvbench.tasks.ranges.base import RangeSensor


class Sensors:
    """The sensors of N episodes in the order of `loops.observed`, that is, sorted by name.

    Args:
        names: sorted names of the sensors' blocks.
        config: configuration with a world that has solids.
        n: number of episodes.
        shared: parameters of every task, by name.
    """

    def __init__(
        self, names: Sequence[str], config: schema.TrainConfig, n: int, shared: Mapping[str, float]
    ) -> None:
        self.sensors: list[RangeSensor] = [
            resolve(BLOCKS[name].sensor)(
                name, getattr(config.task.range, key_of(name), None), n, config.step.frequency, shared
            )
            for name in names
        ]

    def tables(self, interpreted: bool) -> tuple[tuple[Any, ...], ...]:
        """Return states, memories, parameters and rays of the sensors, as the observing loop takes them."""
        states, parameters = [s.state for s in self.sensors], [s.parameters for s in self.sensors]
        if not interpreted:
            states, parameters = [*map(records.plain, states)], [*map(records.plain, parameters)]
        memories, rays = [s.memory for s in self.sensors], [s.rays for s in self.sensors]
        return tuple(states), tuple(memories), tuple(parameters), tuple(rays)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that an exact resume needs, by the names of the blocks."""
        states = {sensor.name: records.bare(sensor.state) for sensor in self.sensors}
        return states | {f"{sensor.name}.memory": sensor.memory for sensor in self.sensors}
