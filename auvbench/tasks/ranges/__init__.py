"""Range sensors: blocks of an observation that measure the solids of a world.

`base` has the common parts of all sensors, `specs` describes their blocks, `beams` computes rays, and `installed` makes the sensors of a
task. Each other file is one sensor or the ideal map `solids`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from auvbench.config import tasks
from auvbench.registry import BLOCKS

if TYPE_CHECKING:
    from auvbench.config import schema
    from auvbench.tasks.ranges.installed import Sensors


def make(config: schema.TrainConfig, n: int, shared: Mapping[str, float]) -> Sensors | None:
    """Return the sensors of an observation; None if it has no sensors."""
    names = [name for name in sorted(tasks.blocks(config.task)) if BLOCKS[name].sensor]
    if not names:
        return None
    from auvbench.tasks.ranges.installed import Sensors

    return Sensors(names, config, n, shared)
