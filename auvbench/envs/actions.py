"""What a batch does first with the actions it is given."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.dynamics.compiled import compiled
from auvbench.errors import ActionError


def admit(action: Any, clipped: NDArray[np.float64]) -> None:
    """Writes actions (n, n_u), clipped to [-1, 1], to `clipped`.

    Raises:
        ActionError: they have another shape, are no numbers, or there is a NaN or an infinity among them.
    """
    given = np.asarray(action)
    if given.shape != clipped.shape:
        raise ActionError(
            f"an action of shape {given.shape}: must be {clipped.shape}, environments times actuators"
        )
    if given.dtype not in (np.float32, np.float64) or not given.flags.c_contiguous:
        if given.dtype.kind not in "fiub":
            raise ActionError(f"an action of type {given.dtype}: must be numbers")
        given = np.ascontiguousarray(given, dtype=np.float64)
    bad = clip(given, clipped)
    if bad >= 0:
        values = ", ".join(f"{value:g}" for value in given[bad])
        raise ActionError(f"the action of environment {bad} is ({values}): must be finite numbers")


@compiled()
def clip(action: NDArray[Any], clipped: NDArray[np.float64]) -> int:
    """Writes `action` (n, n_u), clipped to [-1, 1]; returns -1, or the first row with a NaN or an infinity."""
    for i in range(action.shape[0]):
        for j in range(action.shape[1]):
            value = float(action[i, j])
            if not math.isfinite(value):
                return i
            clipped[i, j] = min(1.0, max(-1.0, value))
    return -1
