"""`gymnasium.make("auvbench/Waypoint-v0")`: one environment of the batch, by Gymnasium's interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from auvbench.config import schema
from auvbench.envs import spaces
from auvbench.envs.batch import Batch

Observation = NDArray[np.float32]


class WaypointEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Track a waypoint with an underwater vehicle.

    Args:
        overrides: as on the command line, e.g. `["reward.k=40", "step.frequency=25", "vehicle=rexrov"]`.
        config: a typed configuration instead of overrides.

    The same seed and actions give the same floats as environment 0 of the vectorised face.

    >>> import gymnasium
    >>> env = gymnasium.make("auvbench/Waypoint-v0", overrides=["step.frequency=25"])
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape
    (10,)
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, overrides: Sequence[str] = (), config: schema.TrainConfig | None = None) -> None:
        typed = spaces.configuration(config, overrides)
        self.batch = Batch(typed, 1, autoreset=False)
        self.observation_space, self.action_space = spaces.of(self.batch)  # type: ignore[assignment]
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode: episode 0 of `seed`, or the next one where no seed is given."""
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            self.batch.reseed(seed if seed is not None else int(self.np_random.integers(1 << 32)))
            self._seeded = True
        return self.batch.reset()[0].copy(), {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """One agent step; `info["record"]` holds the episode's row when it ends."""
        result = self.batch.step(np.asarray(action)[None])
        info: dict[str, Any] = {}
        if result.records:
            record = result.records[0]
            info = {"record": record, "is_success": record["outcome"] == "success"}
        return (
            result.observation[0].copy(),
            float(result.reward[0]),
            bool(result.terminated[0]),
            bool(result.truncated[0]),
            info,
        )
