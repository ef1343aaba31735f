"""`gymnasium.make_vec("auvbench/Waypoint-v0", vectorization_mode="vector_entry_point")`: the whole batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.envs import spaces
from auvbench.envs.sharded import make_batch
from auvbench.errors import ConfigError

Arrays = NDArray[Any]


class WaypointVectorEnv(VectorEnv[Arrays, Arrays, Arrays]):
    """N environments in one batch; an episode that ends begins anew in the same step.

    Environment i of a batch seeded s draws from (s, i), whatever N is.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 1,
        overrides: Sequence[str] = (),
        config: schema.TrainConfig | None = None,
    ) -> None:
        typed = spaces.configuration(config, overrides)
        self.batch = make_batch(typed, num_envs)
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces.of(self.batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeded = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Arrays, dict[str, Any]]:
        """Begins an episode everywhere.

        Raises:
            ConfigError: a list of seeds; one seed serves the batch, environments differ by their index.
        """
        if isinstance(seed, list):
            raise ConfigError("seed: give one number; environment i of the batch draws from (seed, i)")
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            self.batch.reseed(int(seed) if seed is not None else int(self.np_random.integers(1 << 32)))
            self._seeded = True
        return self.batch.reset().copy(), {}

    def step(self, actions: Arrays) -> tuple[Arrays, Arrays, Arrays, Arrays, dict[str, Any]]:
        """One agent step of every environment; `info["final_obs"]`, `info["record"]` where one ended."""
        result = self.batch.step(np.asarray(actions))
        info: dict[str, Any] = {}
        if result.records:
            mask = result.terminated | result.truncated
            final = np.full(self.num_envs, None, dtype=object)
            records = np.full(self.num_envs, None, dtype=object)
            for i, observation, record in zip(
                result.ended, result.final_observation, result.records, strict=True
            ):
                final[i], records[i] = observation, record
            info = {"final_obs": final, "_final_obs": mask, "record": records, "_record": mask.copy()}
        return (
            result.observation.copy(),
            result.reward.copy(),
            result.terminated.copy(),
            result.truncated.copy(),
            info,
        )
