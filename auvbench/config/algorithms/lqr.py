"""Define the agent LQR: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.cascade import Cascade
from auvbench.config.schema import number


@dataclass(kw_only=True)
class LQR(Cascade):
    velocity_error: float = number(0.0, 100.0, open_low=True)  # m/s
    yaw_error: float = number(0.0, 100.0, open_low=True)  # rad
    yaw_rate: float = number(0.0, 100.0, open_low=True)  # rad/s
    integral_error: float = number(0.0, 1e6, open_low=True)  # m
    effort_share: float = number(0.0, 1e3, open_low=True)


SPEC = AgentSpec(
    "lqr", "LQR", LQR, "auvbench.agents.classical.lqr:LQRController", knows=("sheet",), pilots=True
)
