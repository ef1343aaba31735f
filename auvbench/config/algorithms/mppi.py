"""Define the agent MPPI: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.schema import later, number


@dataclass(kw_only=True)
class MPPI(Algorithm):
    samples: int = number(16, 65_536)
    horizon: float = number(0.1, 100.0)  # s
    effort: float = number(0.0, 1.0, open_low=True)
    temperature: float = number(0.0, 1e3, open_low=True)
    noise: float = number(0.0, 2.0, open_low=True)
    turn_noise: float = number(0.0, 2.0)
    correlation: float = number(0.0, 100.0)  # s
    control_cost: float = number(0.0, 1.0)
    terminal_weight: float = number(0.0, 1e6)
    effort_weight: float = number(0.0, 1e6)
    change_weight: float = number(0.0, 1e6)
    spin_weight: float = number(0.0, 1e6)
    clearance: float = later(number(0.0, 100.0), 0.5)  # m
    clearance_weight: float = later(number(0.0, 1e6), 20.0)  # 1/m
    contact_weight: float = later(number(0.0, 1e6), 100.0)


SPEC = AgentSpec("mppi", "MPPI", MPPI, "auvbench.agents.classical.mppi:MPPIController", knows=("model",))
