"""The batch as a Stable-Baselines3 `VecEnv`: no Python per environment but where an episode ends."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvObs, VecEnvStepReturn

from auvbench.envs import spaces
from auvbench.envs.batch import Batch
from auvbench.envs.sharded import ShardedBatch
from auvbench.tasks.record import Record

# SB3 looks into the info of every environment at every step; those of running episodes are all this one.
_NOTHING: dict[str, Any] = {}


class WaypointVecEnv(VecEnv):
    """Feeds SB3's learners from a `Batch`.

    `finished` holds the rows of the episodes that ended in the last step.
    """

    def __init__(self, batch: Batch | ShardedBatch) -> None:
        self.batch = batch
        self.finished: list[Record] = []
        self._actions: NDArray[np.float32] | None = None
        observation_space, action_space = spaces.of(batch)
        self.render_mode = None
        super().__init__(batch.n, observation_space, action_space)

    def reset(self) -> VecEnvObs:
        if self._seeds[0] is not None:
            self.batch.reseed(int(self._seeds[0]))
        self._reset_seeds()
        self._reset_options()
        return self.batch.reset().copy()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """One seed serves the batch: environment i draws from (seed, i)."""
        if seed is not None:
            self._seeds = [seed] * self.num_envs
        return self._seeds

    def step_async(self, actions: NDArray[np.float32]) -> None:
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        assert self._actions is not None
        result = self.batch.step(self._actions)
        self.finished = result.records
        infos = [_NOTHING] * self.num_envs
        for i, observation, record in zip(
            result.ended, result.final_observation, result.records, strict=True
        ):
            infos[i] = {
                "terminal_observation": observation,
                "TimeLimit.truncated": bool(result.truncated[i]),
                "is_success": record["outcome"] == "success",
                "episode": {"r": record["return"], "l": record["steps"]},
            }
        done = result.terminated | result.truncated
        return result.observation.copy(), result.reward.astype(np.float32), done, infos

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        result = getattr(self.batch, method_name)(*method_args, **method_kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(
        self, wrapper_class: type[gymnasium.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        return [None] * self.num_envs
