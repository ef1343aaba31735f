"""Define the agent PID: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.cascade import Cascade
from auvbench.config.schema import later, number


@dataclass(kw_only=True)
class PID(Cascade):
    bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    integral_time: float = number(0.0, 1e6, open_low=True)  # s
    heading_integral_time: float | None = later(number(0.0, 1e6, open_low=True))  # s


SPEC = AgentSpec("pid", "PID", PID, "auvbench.agents.classical.pid:controller", knows=("sheet",), pilots=True)
