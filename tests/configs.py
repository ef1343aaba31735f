"""Configurations of the package's own files; each is composed once per process, then copied.

Trainings here have the original study's vehicle and observation unless a test says otherwise: most expected values were found with
them.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.config.compose import compose
from auvbench.config.copies import copied
from auvbench.config.validate import evaluate_config, train_config


@cache
def _composed(entry: str, overrides: tuple[str, ...]) -> DictConfig:
    return compose(entry, overrides, folder=None)


ORIGINAL = ("vehicle=bluerov2", "task=waypoint")


def original(*overrides: str) -> tuple[str, ...]:
    """Return overrides with those of ORIGINAL that they leave open."""
    keys = [override.partition("=")[0].lstrip("+~") for override in overrides]
    chosen = {"vehicle", "task"} if "experiment" in keys else set(keys)
    return (*(line for line in ORIGINAL if line.partition("=")[0] not in chosen), *overrides)


def composed(*overrides: str) -> DictConfig:
    """Return the configuration of a training, as `compose` does."""
    return copied(_composed("train", original(*overrides)))


def training(*overrides: str) -> schema.TrainConfig:
    """Return the typed, checked configuration of a training."""
    return train_config(composed(*overrides))


def plain(*overrides: str) -> dict[str, Any]:
    """Return the configuration of a training as plain values, as `config.yaml` holds it."""
    values = OmegaConf.to_container(composed(*overrides), resolve=True)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}


def protocol(*overrides: str) -> schema.Protocol:
    """Return the typed, checked protocol of `auvbench evaluate`."""
    return evaluate_config(copied(_composed("evaluate", overrides))).protocol
