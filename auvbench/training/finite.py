"""Notices a NaN or an infinity in the physics when it appears, and stops the run.

A run that goes on with a NaN wastes its budget and would overwrite its last good checkpoint.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.errors import TrainingError


def check_step(observations: NDArray[Any], rewards: NDArray[Any], step: int) -> None:
    """Raises `TrainingError` when what the environments returned in this step is not finite.

    Args:
        observations: (n, d), as the environments give them: no clipping has hidden an infinity.
        rewards: (n,), likewise.
        step: environment steps so far, for the message.
    """
    for what, values in (("observation", observations), ("reward", rewards)):
        fine = np.isfinite(values)
        if not fine.all():
            bad = ~fine
            environment = int(np.nonzero(bad)[0][0])
            value = values[bad][0]
            raise TrainingError(f"step {step}: the {what} of environment {environment} is {value}")
