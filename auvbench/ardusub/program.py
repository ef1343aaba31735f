"""The program of `algo=ardusub`, which an environment variable names.

A run holds the program's digest and never its path: a run from another person must not choose a program to start.
"""

from __future__ import annotations

import copy
import hashlib
import os
from pathlib import Path

from omegaconf import DictConfig, open_dict

from auvbench.config import algorithms, schema
from auvbench.errors import ConfigError

VARIABLE = "AUVBENCH_ARDUSUB"


def settled(config: DictConfig, typed: schema.TrainConfig) -> DictConfig:
    """Return the configuration with the digest of its ArduSub, if it has one.

    Args:
        config: composed.
        typed: the same, checked.

    Raises:
        ConfigError: as `find`.
    """
    algo = typed.algo
    if not isinstance(algo, algorithms.ArduSub):
        return config
    result = copy.deepcopy(config)
    with open_dict(result):
        result.algo.sha256 = find(algo.sha256)[1]
    return result


def find(sha256: str = "") -> tuple[Path, str]:
    """Return the path of ArduSub's SITL and its SHA-256.

    Args:
        sha256: that it must have; empty for any.

    Raises:
        ConfigError: no program is named, it cannot be read, or it is another.
    """
    named = os.environ.get(VARIABLE, "")
    if not named:
        raise ConfigError(
            f"algo=ardusub: {VARIABLE} names no program; type export {VARIABLE}=.../build/sitl/bin/ardusub"
        )
    path = Path(named).absolute()
    try:
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ConfigError(f"{VARIABLE}={named}: ArduSub's SITL cannot be read: {error.strerror}") from error
    if sha256 not in ("", digest):
        raise ConfigError(f"{VARIABLE}={named}: is another program than that of algo.sha256={sha256[:12]}...")
    return path, digest
