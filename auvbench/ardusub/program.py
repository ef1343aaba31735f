"""The program of `algo=ardusub`: a run is known by its content, not by where it lies."""

from __future__ import annotations

import copy
import hashlib
from pathlib import Path

from omegaconf import DictConfig, open_dict

from auvbench.config import algorithms, schema
from auvbench.errors import ConfigError


def settled(config: DictConfig, typed: schema.TrainConfig) -> DictConfig:
    """Return the configuration with the absolute path and the digest of its ArduSub, if it has one.

    Args:
        config: composed.
        typed: the same, checked.

    Raises:
        ConfigError: the program is missing, or another than `algo.sha256` says.
    """
    algo = typed.algo
    if not isinstance(algo, algorithms.ArduSub):
        return config
    result = copy.deepcopy(config)
    with open_dict(result):
        result.algo.sha256 = check(algo)
        result.algo.path = str(Path(algo.path).absolute())
    return result


def check(algo: algorithms.ArduSub) -> str:
    """Return the SHA-256 of the program.

    Raises:
        ConfigError: it is missing, or another than `algo.sha256` says.
    """
    if not algo.path:
        raise ConfigError(
            "algo.path: a value is missing; name ArduSub's SITL: algo.path=build/sitl/bin/ardusub"
        )
    try:
        with Path(algo.path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ConfigError(
            f"algo.path={algo.path}: ArduSub's SITL cannot be read: {error.strerror}"
        ) from error
    if algo.sha256 not in ("", digest):
        raise ConfigError(
            f"algo.path={algo.path}: is another program than that of algo.sha256={algo.sha256[:12]}..."
        )
    return digest
