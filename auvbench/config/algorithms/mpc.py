"""Define the agent MPC: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.schema import later, number


@dataclass(kw_only=True)
class MPC(Algorithm):
    horizon: float = number(0.0, 1e3, open_low=True)  # s
    effort: float = number(0.0, 1.0, open_low=True)
    terminal_weight: float = number(0.0, 1e6)
    effort_weight: float = number(0.0, 1e6)
    change_weight: float = number(0.0, 1e6)
    spin_weight: float = number(0.0, 1e6)
    damping: float = number(0.0, 1e6)
    clearance: float = later(number(0.0, 100.0), 0.5)  # m
    clearance_weight: float = later(number(0.0, 1e6), 20.0)  # 1/m2


SPEC = AgentSpec("mpc", "MPC", MPC, "auvbench.agents.classical.mpc:MPCController", knows=("model",))
