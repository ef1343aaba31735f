"""Define the keys of the cascade controllers (PID, LQR, SMC, ADRC)."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import Algorithm
from auvbench.config.schema import number


@dataclass(kw_only=True)
class Cascade(Algorithm):
    """Keys of the cascade controllers: an outer guidance loop sets a velocity, and an inner loop controls this velocity."""

    cruise_speed: float = number(0.0, 100.0, open_low=True)  # m/s
    approach: float = number(0.0, 100.0, open_low=True)  # 1/s
    filter_time: float = number(0.0, 1e3, open_low=True)  # s
    effort: float = number(0.0, 1.0, open_low=True)
