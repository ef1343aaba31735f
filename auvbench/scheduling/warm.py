"""What the process that forks the workers does once, so that no worker has to do it again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auvbench.config.simulators import Fossen
from auvbench.envs.batch import Batch
from auvbench.runs.directory import RunDirectory
from auvbench.runs.plan import load_config


def kernels(run: RunDirectory) -> None:
    """Loads the compiled kernels, or compiles them, by stepping one environment of a run's configuration.

    A fork needs no second thought after it: the kernels start no threads of their own, and every draw is a
    function of its key, so no generator has moved.
    """
    config = load_config(run)
    if not isinstance(
        config.simulator, Fossen
    ):  # another one is each worker's own: what it opens does not survive a fork
        config = replace(config, simulator=Fossen(name="fossen", max_step=0.01, threads=1))
    batch = Batch(config, 1)
    batch.reset()
    batch.step(np.zeros((1, len(batch.vehicle.actuators))))
