"""Define the agent SMC: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.cascade import Cascade
from auvbench.config.schema import number


@dataclass(kw_only=True)
class SMC(Cascade):
    surface: float = number(0.0, 100.0)  # 1/s
    boundary_layer: float = number(0.0, 100.0, open_low=True)  # m/s, rad/s
    switching_gain: float = number(0.0, 1e3)  # m/s2, rad/s2
    largest_gain: float = number(0.0, 1e3, open_low=True)  # m/s2, rad/s2
    adaptation: float = number(0.0, 1e3)  # 1/s2
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s


SPEC = AgentSpec(
    "smc", "SMC", SMC, "auvbench.agents.classical.smc:SMCController", knows=("sheet",), pilots=True
)
