"""A large disturbed batch on several threads: contiguous parts, each a `Batch` of its own.

Between the kernels of a disturbed step the interpreter decides what comes next, so that whole steps run side by
side only as far as its lock permits; undisturbed batches do better (`team.py`). Environment i draws from (seed, i)
in whichever part it lies: results, and the saved state, do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema, simulators
from auvbench.envs.actions import admit
from auvbench.envs.batch import Batch, State, Transition
from auvbench.envs.team import TeamBatch

SMALLEST = 64
"""environments from which a second thread pays in an undisturbed batch"""

SMALLEST_DISTURBED = 1024
"""environments from which a second thread pays in a disturbed batch"""


def make_batch(
    config: schema.TrainConfig, n: int | None = None, *, seed: int | None = None, autoreset: bool = True
) -> Batch | ShardedBatch:
    """The batch for a configuration, on `simulator.threads` threads where they pay."""
    count = int(config.algo.n_envs if n is None else n)
    if simulators.threads(config.simulator) > 1 and count >= SMALLEST:
        if Batch(config, 1, seed=seed).disturbances is None:
            return TeamBatch(config, count, seed=seed, autoreset=autoreset)
        if count >= SMALLEST_DISTURBED:
            return ShardedBatch(config, count, seed=seed, autoreset=autoreset)
    return Batch(config, count, seed=seed, autoreset=autoreset)


class ShardedBatch:
    """N environments on `config.simulator.threads` threads; the interface of `Batch`."""

    def __init__(
        self, config: schema.TrainConfig, n: int, *, seed: int | None = None, autoreset: bool = True
    ) -> None:
        self.config = config
        self.n = n
        threads = config.simulator.threads
        bounds = np.linspace(0, n, threads + 1).astype(int).tolist()
        self._slices = [slice(a, b) for a, b in pairwise(bounds)]
        self.parts = [
            Batch(config, s.stop - s.start, seed=seed, first=s.start, autoreset=autoreset)
            for s in self._slices
        ]
        self.vehicle = self.parts[0].vehicle
        self._action = np.zeros((n, len(self.vehicle.actuators)))
        self._pool = ThreadPoolExecutor(threads - 1)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "_pool"}  # threads do not travel

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ = state | {"_pool": ThreadPoolExecutor(len(state["parts"]) - 1)}

    @property
    def seed(self) -> int:
        return self.parts[0].seed

    @property
    def exact_resume(self) -> bool:
        """As `Batch.exact_resume`."""
        return self.parts[0].exact_resume

    @property
    def restarted(self) -> NDArray[np.float32] | None:
        """As `Batch.restarted`."""
        first = [part.restarted for part in self.parts if part.restarted is not None]
        return np.concatenate(first) if len(first) == len(self.parts) else None

    def reseed(self, seed: int, indices: NDArray[np.int64] | None = None) -> None:
        """As `Batch.reseed`."""
        for part, own, _ in self._shares(np.arange(self.n) if indices is None else indices):
            part.reseed(seed, own)

    def reseed_each(self, indices: NDArray[np.int64], seeds: Sequence[int]) -> None:
        """As `Batch.reseed_each`."""
        given = np.asarray(seeds, dtype=np.int64)
        for part, own, at in self._shares(indices):
            part.reseed_each(own, given[at].tolist())

    @property
    def state(self) -> State:
        """As `Batch.state`."""
        return State.joined([part.state for part in self.parts])

    def _shares(
        self, indices: NDArray[np.int64]
    ) -> Iterator[tuple[Batch, NDArray[np.int64], NDArray[np.bool_]]]:
        """For each part with some of the environments `indices`: the part, their numbers in it, where they stand."""
        for part, rows in zip(self.parts, self._slices, strict=True):
            at = (rows.start <= indices) & (indices < rows.stop)
            if at.any():
                yield part, indices[at] - rows.start, at

    def reset(
        self,
        indices: NDArray[np.int64] | None = None,
        *,
        pose: NDArray[np.float64] | None = None,
        waypoint: NDArray[np.float64] | None = None,
        distance: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float32]:
        """As `Batch.reset`."""
        for part, own, at in self._shares(np.arange(self.n) if indices is None else indices):
            part.reset(
                own,
                pose=None if pose is None else pose[at],
                waypoint=None if waypoint is None else waypoint[at],
                distance=None if distance is None else distance[at],
            )
        return np.concatenate([part.task.observation for part in self.parts])

    def step(self, action: NDArray[np.floating], begin: NDArray[np.int64] | None = None) -> Transition:
        """As `Batch.step`."""
        admit(action, self._action)  # of all, before any part moves
        some = np.empty(0, dtype=np.int64) if begin is None else begin
        begins = [some[(rows.start <= some) & (some < rows.stop)] - rows.start for rows in self._slices]
        work = list(zip(self.parts, self._slices, begins, strict=True))
        jobs = [self._pool.submit(part.step, self._action[rows], own) for part, rows, own in work[1:]]
        results = [
            self.parts[0].step(self._action[self._slices[0]], begins[0]),
            *(job.result() for job in jobs),
        ]
        return Transition(
            observation=np.concatenate([r.observation for r in results]),
            reward=np.concatenate([r.reward for r in results]),
            terminated=np.concatenate([r.terminated for r in results]),
            truncated=np.concatenate([r.truncated for r in results]),
            ended=np.concatenate([r.ended + s.start for r, s in zip(results, self._slices, strict=True)]),
            final_observation=np.concatenate([r.final_observation for r in results]),
            final_state=State.joined([r.final_state for r in results]),
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
