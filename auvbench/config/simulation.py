"""The schema of `auvbench simulate`: what goes into an open-loop run, and which values are admissible."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig

from auvbench.config import validate
from auvbench.config.schema import choice, number
from auvbench.errors import ConfigError

UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of a quaternion may be: enough for four typed digits; it is then brought to 1."""


@dataclass(kw_only=True)
class Input:
    """What acts on the vehicle, and where it starts. Constant over the run."""

    frame: str = choice("enu", "ned")
    wrench: list[float]  # (6,) N, N m
    command: Any  # (n_u,) in [-1, 1], or {actuator: command}
    pose: list[float]  # (7,) x y z qw qx qy qz
    velocity: list[float]  # (6,) m/s, rad/s
    current: list[float]  # (3,) m/s


@dataclass(kw_only=True)
class Simulation:
    """Everything that `auvbench simulate` composes."""

    vehicle: Any
    input: Input
    thrusters: str = choice("on", "off")
    duration: float = number(0.0, 1e6, open_low=True)  # s
    sample: float = number(0.0, 1e6, open_low=True)  # s
    max_step: float = number(0.0, 1.0, open_low=True)  # s
    output: str | None
    plot: str | None


MAX_ROWS = 10_000_000
MAX_STEPS = 1_000_000_000
"""Steps of the integrator: some ten minutes of computing, and the longest duration at the default max_step."""


def simulation_config(config: DictConfig) -> Simulation:
    """The typed configuration of an open-loop run, its values checked.

    Raises:
        ConfigError: a value is missing, out of range, or of the wrong length.
    """
    typed = validate.structured(config, Simulation)
    given = typed.input
    _vector("input.wrench", given.wrench, "[Fx, Fy, Fz, Mx, My, Mz] in N and N m", 6)
    _vector("input.pose", given.pose, "[x, y, z, qw, qx, qy, qz]", 7)
    _vector("input.velocity", given.velocity, "[u, v, w, p, q, r] in m/s and rad/s", 6)
    _vector("input.current", given.current, "[x, y, z] in m/s", 3)
    length = math.hypot(*given.pose[3:])
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise ConfigError(
            f"input.pose={given.pose}: the quaternion [qw, qx, qy, qz] has length {length:.6g}, it must be 1"
        )
    if typed.duration / typed.sample > MAX_ROWS:
        raise ConfigError(
            f"sample={typed.sample:g}: {typed.duration:g} s would be more than {MAX_ROWS} rows, sample less often"
        )
    if typed.duration / typed.max_step > MAX_STEPS:
        raise ConfigError(
            f"max_step={typed.max_step:g}: {typed.duration:g} s would be more than {MAX_STEPS} steps,"
            f" make it at least {typed.duration / MAX_STEPS:.3g} or simulate less long"
        )
    return typed


def _vector(key: str, value: list[float], meaning: str, length: int) -> None:
    if len(value) != length:
        raise ConfigError(f"{key}={value}: has {len(value)} numbers, needs {length}: {meaning}")
    if not all(math.isfinite(v) for v in value):
        raise ConfigError(f"{key}={value}: must be finite numbers")
