"""Define the schema of `auvbench simulate`: the inputs of an open-loop run and their valid values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from omegaconf import DictConfig

from auvbench.config.fields import require
from auvbench.config.schema import choice, number
from auvbench.config.validate import structured

UNIT_TOLERANCE = 1e-3
"""Largest accepted deviation of a quaternion's norm from 1. A quaternion with four digits per component is accepted, and
normalised later.
"""


@dataclass(kw_only=True)
class Input:
    """Inputs of the vehicle, constant over the run, and its initial state."""

    frame: str = choice("enu", "ned")
    wrench: list[float]  # (6,) N, N m
    command: Any  # (n_u,) in [-1, 1], or {actuator: command}
    pose: list[float]  # (7,) x y z qw qx qy qz
    velocity: list[float]  # (6,) m/s, rad/s
    current: list[float]  # (3,) m/s


@dataclass(kw_only=True)
class Simulation:
    """Configuration of `auvbench simulate`."""

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
"""Largest number of integrator steps. This number of steps takes about ten minutes of computing, and is enough for the longest
duration with the default max_step.
"""


def simulation_config(config: DictConfig) -> Simulation:
    """Check the configuration of an open-loop run and return it as a typed object.

    Raises:
        ConfigError: a value is missing, out of range, or of the wrong length.
    """
    typed = structured(config, Simulation)
    inputs = typed.input
    for key, size, meaning in (
        ("wrench", 6, "[Fx, Fy, Fz, Mx, My, Mz] in N and N m"),
        ("pose", 7, "[x, y, z, qw, qx, qy, qz]"),
        ("velocity", 6, "[u, v, w, p, q, r] in m/s and rad/s"),
        ("current", 3, "[x, y, z] in m/s"),
    ):
        value = getattr(inputs, key)
        fits = len(value) == size and all(map(math.isfinite, value))
        require(fits, f"input.{key}", value, f"be {size} finite numbers {meaning}")
    length = math.hypot(*inputs.pose[3:])
    unit = abs(length - 1.0) <= UNIT_TOLERANCE
    require(
        unit,
        "input.pose",
        inputs.pose,
        f"have a quaternion [qw, qx, qy, qz] of length 1, it has {length:.6g}",
    )
    for key, most, otherwise in (
        ("sample", MAX_ROWS, f"the output has more than {MAX_ROWS} rows"),
        ("max_step", MAX_STEPS, "use a shorter duration"),
    ):
        value, least = getattr(typed, key), typed.duration / most
        require(value >= least, key, value, f"be at least {least:.3g}, or {otherwise}")
    return typed
