"""A large disturbed batch on several threads: contiguous parts, each a `Batch` of its own.

Between the kernels of a disturbed step the interpreter decides what comes next, so that whole steps run side by
side only as far as its lock permits; undisturbed batches do better (`team.py`). Environment i draws from (seed, i)
in whichever part it lies: results, and the saved state, do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, simulators
from auvbench.envs.batch import Batch, Transition
from auvbench.envs.team import TeamBatch

SMALLEST = 64
"""environments from which a second thread pays in an undisturbed batch"""

SMALLEST_DISTURBED = 1024
"""environments from which a second thread pays in a disturbed batch"""


def make_batch(
    config: schema.TrainConfig, n: int | None = None, *, seed: int | None = None
) -> Batch | ShardedBatch:
    """The batch for a configuration, on `simulator.threads` threads where they pay."""
    count = int(config.algo.n_envs if n is None else n)
    if simulators.threads(config.simulator) > 1 and count >= SMALLEST:
        if Batch(config, 1, seed=seed).disturbances is None:
            return TeamBatch(config, count, seed=seed)
        if count >= SMALLEST_DISTURBED:
            return ShardedBatch(config, count, seed=seed)
    return Batch(config, count, seed=seed)


class ShardedBatch:
    """N environments on `config.simulator.threads` threads; the interface of `Batch`."""

    def __init__(self, config: schema.TrainConfig, n: int, *, seed: int | None = None) -> None:
        self.config = config
        self.n = n
        threads = config.simulator.threads
        bounds = np.linspace(0, n, threads + 1).astype(int).tolist()
        self._slices = [slice(a, b) for a, b in pairwise(bounds)]
        self.parts = [Batch(config, s.stop - s.start, seed=seed, first=s.start) for s in self._slices]
        self.vehicle = self.parts[0].vehicle
        self._pool = ThreadPoolExecutor(threads - 1)

    @property
    def seed(self) -> int:
        return self.parts[0].seed

    @property
    def exact_resume(self) -> bool:
        """As `Batch.exact_resume`."""
        return self.parts[0].exact_resume

    def reseed(self, seed: int) -> None:
        """As `Batch.reseed`."""
        for part in self.parts:
            part.reseed(seed)

    def reset(self) -> NDArray[np.float32]:
        """As `Batch.reset`."""
        return np.concatenate([part.reset() for part in self.parts])

    def step(self, action: NDArray[np.floating]) -> Transition:
        """As `Batch.step`."""
        rest = list(zip(self.parts, self._slices, strict=True))[1:]
        jobs = [self._pool.submit(part.step, action[rows]) for part, rows in rest]
        results = [self.parts[0].step(action[self._slices[0]]), *(job.result() for job in jobs)]
        return Transition(
            observation=np.concatenate([r.observation for r in results]),
            reward=np.concatenate([r.reward for r in results]),
            terminated=np.concatenate([r.terminated for r in results]),
            truncated=np.concatenate([r.truncated for r in results]),
            ended=np.concatenate([r.ended + s.start for r, s in zip(results, self._slices, strict=True)]),
            final_observation=np.concatenate([r.final_observation for r in results]),
            records=[record for r in results for record in r.records],
        )

    def state_dict(self) -> dict[str, NDArray[Any]]:
        """As `Batch.state_dict`; the same arrays at any number of threads."""
        states = [part.state_dict() for part in self.parts]
        joined = {}
        for key, first in states[0].items():
            axis = _environment_axis(first, self.parts[0].n)
            joined[key] = first if axis is None else np.concatenate([s[key] for s in states], axis)
        return joined

    def load_state_dict(self, state: Mapping[str, NDArray[Any]]) -> None:
        """As `Batch.load_state_dict`."""
        for part, rows in zip(self.parts, self._slices, strict=True):
            own = {}
            for key, array in state.items():
                axis = _environment_axis(array, self.n)
                index = [slice(None)] * array.ndim
                if axis is not None:
                    index[axis] = rows
                own[key] = array[tuple(index)]
            part.load_state_dict(own)


def _environment_axis(array: NDArray[Any], n: int) -> int | None:
    """Which axis counts environments: the first, or the second behind the slots of a delay; None: a scalar."""
    return next((axis for axis in range(min(array.ndim, 2)) if array.shape[axis] == n), None)
