"""Spaces of the waypoint task and the configuration behind an id of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium import spaces

from auvbench.config import schema
from auvbench.envs.batch import Batch, observation_bounds
from auvbench.envs.sharded import ShardedBatch


def of(batch: Batch | ShardedBatch) -> tuple[spaces.Box, spaces.Box]:
    """Observation space (4 + n_u,) and action space (n_u,) of one environment of the batch."""
    n_u = len(batch.vehicle.actuators)
    high = observation_bounds(n_u)
    return spaces.Box(-high, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (n_u,), dtype=np.float32)


def configuration(config: schema.TrainConfig | None, overrides: Sequence[str]) -> schema.TrainConfig:
    """The configuration of an environment: given, or composed from `conf/train.yaml` and overrides."""
    if config is not None:
        return config
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config

    return train_config(compose("train", overrides))
