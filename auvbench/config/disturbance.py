"""Disturbances: what spans several of their values."""

from __future__ import annotations

from auvbench.config import schema
from auvbench.errors import ConfigError

SCALES = ("mass", "buoyancy", "inertia", "added_mass", "damping", "thrust")
"""Factors of the domain randomisation, in the order in which simulators take them."""


def validate_disturbance(disturbance: schema.Disturbance) -> None:
    """Checks what spans several values; single values are `validate.validate_fields`'s.

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
