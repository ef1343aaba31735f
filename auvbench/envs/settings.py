"""The configuration behind an environment that Python makes: overrides, keywords for the usual ones, a cache."""

from __future__ import annotations

import copy
import dataclasses
import operator
import shlex
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from auvbench.config import schema
from auvbench.errors import ConfigError, closest

if TYPE_CHECKING:
    from auvbench.envs.batch import Batch

Overrides = str | Sequence[str]

STEPS = 1000
"""`max_episode_steps` of the registered ids; the thesis's episodes"""

KEYS = {
    "task": "task",
    "vehicle": "vehicle",
    "k": "reward.k",
    "frequency": "step.frequency",
    "noise": "noise",
    "disturbance": "disturbance",
}
"""What a keyword argument of an environment stands for."""


def configuration(
    config: schema.TrainConfig | None = None,
    overrides: Overrides = (),
    conf: str | Path | None = None,
    **keywords: Any,
) -> schema.TrainConfig:
    """Return the configuration of an environment: the given one, or one composed from the package's files.

    Args:
        config: a typed one; nothing else may be said then.
        overrides: as on the command line, a sequence, or one string with spaces between them.
        conf: a folder that is searched before the package's files, e.g. with a vehicle of one's own in
            `<conf>/vehicle/`. Unlike the command line, Python does not look into `./conf` by itself.
        keywords: of KEYS; None says nothing. `overrides` have the last word.

    Raises:
        ConfigError: a keyword, a key, a type or a value is wrong, or there is no folder `conf`.
    """
    for key in keywords:
        if key not in KEYS:
            raise ConfigError(f"{key}: unknown keyword; {closest(key, KEYS)}")
    lines = shlex.split(overrides) if isinstance(overrides, str) else list(overrides)
    for line in lines:
        if not isinstance(line, str):
            raise ConfigError(f"overrides: {line!r} is no text; an override is written 'reward.k=40'")
    lines = [f"{KEYS[key]}={value}" for key, value in keywords.items() if value is not None] + lines
    if config is not None:
        if lines or conf is not None:
            raise ConfigError(
                f"config: is complete; {(lines or [f'conf={conf}'])[0]} cannot be given as well"
            )
        return config
    if conf is None:
        return copy.deepcopy(_composed(tuple(lines)))
    folder = Path(conf)
    if not folder.is_dir():
        raise ConfigError(f"conf={conf}: there is no such folder")
    return _compose(lines, folder)


@lru_cache(maxsize=256)
def _composed(overrides: tuple[str, ...]) -> schema.TrainConfig:
    """Composing takes some tenths of a second; the package's files do not change while it is in use."""
    return _compose(overrides, None)


def _compose(overrides: Sequence[str], folder: Path | None) -> schema.TrainConfig:
    from auvbench.config.compose import compose
    from auvbench.config.validate import train_config

    return train_config(compose("train", overrides, folder=folder))


def limited(config: schema.TrainConfig, steps: int | None) -> schema.TrainConfig:
    """Return the configuration with another limit of an episode's steps.

    None and STEPS, which Gymnasium passes by default, leave it as it is; -1 takes it away.

    Raises:
        ConfigError: another number below 1.
    """
    if steps is None or steps == STEPS:
        return config
    most = 10_000_000
    if steps != -1 and not 1 <= steps <= most:
        raise ConfigError(f"max_episode_steps={steps}: must be from 1 to {most}, or -1 for no limit")
    task = dataclasses.replace(config.task, max_steps=most if steps == -1 else int(steps), time_limit=None)
    return dataclasses.replace(config, task=task)


def folded(seed: Any) -> int:
    """Return a seed as 32 bits: itself below 2^32, a hash (numpy's SeedSequence) above.

    Raises:
        ConfigError: it is no whole number, or negative.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        raise ConfigError(f"seed={seed!r}: must be a whole number") from None
    if number < 0:
        raise ConfigError(f"seed={number}: must be at least 0")
    return number if number < 1 << 32 else int(np.random.SeedSequence(number).generate_state(1)[0])


def spaces_of(batch: Batch) -> tuple[spaces.Box, spaces.Box]:
    """Return the observation space (n_obs,) and the action space (n_u,) of one environment of the batch."""
    high = batch.task.spec.bounds
    n_u = len(batch.vehicle.actuators)
    return spaces.Box(-high, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (n_u,), dtype=np.float32)
