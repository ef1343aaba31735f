"""What the process that forks the workers does once, so that no worker has to do it again."""

from __future__ import annotations

import numpy as np

from auvbench.envs.batch import Batch
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import load_config


def kernels(run: RunDirectory) -> None:
    """Loads the compiled kernels, or compiles them, by stepping one environment of a run's configuration.

    A fork needs no second thought after it: the kernels start no threads of their own, and every draw is a
    function of its key, so no generator has moved.
    """
    batch = Batch(load_config(run), 1)
    batch.reset()
    batch.step(np.zeros((1, len(batch.vehicle.actuators))))
