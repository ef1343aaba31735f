"""Define observations as named blocks of numbers. A task declares its blocks; agents, policy cards and ROS 2 use this declaration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvbench.errors import ConfigError

WORLD = "world axes (east, north, up)"
BODY = "levelled body axes (forward, port, up), turned by the yaw reading"


@dataclass(frozen=True, slots=True)
class Block:
    """Group of numbers in an observation, such as the three components of the velocity."""

    name: str
    labels: tuple[str, ...]  # name of each number
    unit: str
    bounds: tuple[float, ...]  # largest magnitude of each number
    meaning: str
    axes: str = ""  # axes of a vector, such as WORLD or BODY; empty: not a vector


class ObservationSpec:
    """The blocks of an observation, in order.

    >>> spec = ObservationSpec(Block("depth", ("depth",), "m", (60.0,), "z"), Block("rate", ("r",), "rad/s", (1.0,), "yaw"))
    >>> spec.size, spec["rate"], spec.pack(rate=0.5, depth=-3.0).tolist()
    (2, slice(1, 2, None), [-3.0, 0.5])
    """

    def __init__(self, *blocks: Block) -> None:
        self.blocks = {block.name: block for block in blocks}
        ends = np.cumsum([len(block.labels) for block in blocks]).tolist()
        self._columns = {b.name: slice(e - len(b.labels), e) for b, e in zip(blocks, ends, strict=True)}
        self.size: int = ends[-1]
        self.bounds: NDArray[np.float32] = np.array([x for b in blocks for x in b.bounds], dtype=np.float32)
        """(size,) largest magnitude of each number"""

    def __getitem__(self, name: str) -> slice:
        """Return the columns of a block.

        Raises:
            ConfigError: the task does not observe the block.
        """
        if name not in self._columns:
            raise ConfigError(
                f"the task does not observe {name}, which this agent needs; the task observes {', '.join(self._columns)}"
            )
        return self._columns[name]

    def pack(self, **values: ArrayLike) -> NDArray[np.float32]:
        """Return the observation (size,) that consists of the given values; each block needs a value."""
        return np.concatenate([np.ravel(values[name]) for name in self.blocks]).astype(np.float32)

    def card(self) -> list[dict[str, str]]:
        """Return name, unit and meaning of each number in the observation, for the card of an exported policy."""
        return [
            {"name": label, "unit": b.unit, "meaning": f"{b.meaning}, {b.axes}" if b.axes else b.meaning}
            for b in self.blocks.values()
            for label in b.labels
        ]
