"""Disturbances: what spans several of their values, and composing them by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from omegaconf import DictConfig, OmegaConf

from auvbench.config import schema
from auvbench.errors import ConfigError

SCALES = ("mass", "buoyancy", "inertia", "added_mass", "damping", "thrust")
"""Factors of the domain randomisation, in the order in which simulators take them."""


def check(disturbance: schema.Disturbance) -> None:
    """Checks what spans several values; single values are `validate.check`'s.

    Raises:
        ConfigError: a range is upside down.
    """
    current, fault = disturbance.current, disturbance.fault
    _ordered("current.speed", current.speed, "current.speed_high", current.speed_high)
    _ordered("fault.time", fault.time, "fault.time_high", fault.time_high)
    if current.profile.bottom <= current.profile.top:
        raise ConfigError(
            f"disturbance.current.profile.bottom={current.profile.bottom:g}: must be more than "
            f"disturbance.current.profile.top={current.profile.top:g}"
        )
    for name in SCALES:
        scale: schema.Scale = getattr(disturbance.randomisation, name)
        _ordered(f"randomisation.{name}.low", scale.low, f"randomisation.{name}.high", scale.high)


def _ordered(low_key: str, low: float, high_key: str, high: float | None) -> None:
    if high is not None and high < low:
        raise ConfigError(f"disturbance.{high_key}={high:g}: must be at least disturbance.{low_key}={low:g}")


def compose(overrides: Sequence[str] = ()) -> schema.Disturbance:
    """The disturbance that a command line would give, e.g. of a test condition.

    >>> compose(["disturbance=current", "disturbance.current.speed=0.5"]).current.speed
    0.5

    Raises:
        ConfigError: a name, a key or a value is wrong.
    """
    from auvbench.config import compose as composing
    from auvbench.config import validate

    config = composing.compose("train", overrides)
    assert isinstance(config.disturbance, DictConfig)
    disturbance = OmegaConf.to_object(config.disturbance)
    assert isinstance(disturbance, schema.Disturbance)
    validate.check(disturbance, "disturbance.")
    check(disturbance)
    return disturbance


def replace(config: schema.TrainConfig, disturbance: schema.Disturbance) -> schema.TrainConfig:
    """The same configuration under another disturbance."""
    return dataclasses.replace(config, disturbance=disturbance)
