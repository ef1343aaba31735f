"""Read the state of disturbances from checkpoints of version 2, whose arrays `D` and `I` had numbered columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.tasks.disturbances.base import Disturbance

COLUMNS: Mapping[str, Mapping[str, tuple[str, int | slice]]] = {
    "current": {
        "top": ("D", slice(0, 3)),
        "bottom": ("D", slice(3, 6)),
        "fluctuation": ("D", slice(6, 9)),
    },
    "sensor": {"bias": ("D", slice(9, 13)), "drift": ("D", slice(13, 17))},
    "fault": {
        "held": ("D", 17),
        "mode": ("I", 0),
        "actuator": ("I", 1),
        "begin": ("I", 2),
        "begun": ("I", 3),
    },
}
"""Array and columns of each field, by disturbance."""


def load(name: str, part: Disturbance, state: Mapping[str, NDArray[Any]]) -> None:
    """Restore the state of one disturbance. State that version 2 did not save is a function of the episodes and is drawn again."""
    if name == "delay":
        part.load(state)
    elif name in COLUMNS:
        for field, (array, columns) in COLUMNS[name].items():
            part.state[field] = state[array][:, columns]
    else:
        part.draw_rows(np.arange(part.task.n))
