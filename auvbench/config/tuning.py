"""Define the schema of `auvbench tune`: all keys of a run's configuration, and the settings of the search."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.config.fields import require
from auvbench.config.schema import choice, number
from auvbench.config.validate import evaluate_protocol, resolved, structured
from auvbench.errors import ConfigError

STREAM = "validation"
"""The only stream of scenarios that may be used to choose settings."""


@dataclass(kw_only=True)
class Tune:
    """Settings of a search."""

    trials: int = number(1, 100_000)
    sampler: str = choice("tpe", "random")
    startup: int = number(1, 100_000)
    preset: bool = False
    rungs: list[int]
    pruner: str = choice("halving", "none")
    reduction: int = number(2, 100)
    seeds: list[int]
    fresh_seeds: list[int]
    objective: str
    then: str
    space: dict[str, Any]


@dataclass(kw_only=True)
class TuneConfig(schema.TrainConfig):
    """Configuration of `auvbench tune`."""

    protocol: schema.Protocol
    search: Any = None  # ranges in search/NAME.yaml; None: the algorithm has no such file
    tune: Tune


def read(config: DictConfig) -> tuple[Tune, schema.Protocol]:
    """Return the settings of the search and the protocol that scores the trials, after a check of their values.

    Raises:
        ConfigError: a value is out of range, or the protocol does not use validation scenarios.
    """
    tune, protocol = structured(config, Tune, "tune"), structured(config, schema.Protocol, "protocol")
    evaluate_protocol(protocol)
    refuse_test(protocol)
    if len(protocol.conditions) > 1:
        raise ConfigError(
            f"protocol={protocol.name}: has {len(protocol.conditions)} conditions; a search needs a protocol with one"
        )
    _check_budget(tune, config)
    return tune, protocol


def refuse_test(protocol: schema.Protocol) -> None:
    """Raise ConfigError if the protocol uses test scenarios instead of validation scenarios."""
    if protocol.scenarios != STREAM:
        raise ConfigError(
            f"protocol={protocol.name}: uses the scenarios of a test (protocol.scenarios={protocol.scenarios}); "
            f"settings must be chosen on validation scenarios: type protocol=tuning"
        )


def _check_budget(tune: Tune, config: DictConfig) -> None:
    rungs = tune.rungs
    grow = bool(rungs) and sorted(set(rungs)) == rungs and rungs[0] >= 1
    require(grow, "tune.rungs", rungs, "be training budgets in steps, in rising order, e.g. [50000,150000]")
    for key in ("seeds", "fresh_seeds"):
        seeds = getattr(tune, key)
        fits = len(set(seeds)) == len(seeds) and all(0 <= seed < 1 << 32 for seed in seeds)
        require(fits, f"tune.{key}", seeds, f"be different whole numbers from 0 to {(1 << 32) - 1}")
    require(bool(tune.seeds), "tune.seeds", tune.seeds, "have at least one training seed")
    fresh = not set(tune.seeds) & set(tune.fresh_seeds)
    require(
        fresh, "tune.fresh_seeds", tune.fresh_seeds, f"have seeds that are not in tune.seeds={tune.seeds}"
    )
    schedule = OmegaConf.select(config, "algo.learning_rate_schedule", default="constant")
    if len(tune.rungs) > 1 and tune.pruner != "none" and schedule != "constant":
        raise ConfigError(
            f"algo.learning_rate_schedule={schedule}: depends on the budget, so no trial can continue from one "
            "rung to the next; "
            "type tune.pruner=none, with which every trial trains for the last of tune.rungs at once"
        )


def without_search(config: DictConfig) -> dict[str, Any]:
    """Return the keys of a run from the configuration of a search, with interpolations resolved."""
    values = resolved(config)
    return {field.name: values[field.name] for field in dataclasses.fields(schema.TrainConfig)}
