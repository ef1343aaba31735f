"""Define the agent ADRC: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.cascade import Cascade
from auvbench.config.schema import number


@dataclass(kw_only=True)
class ADRC(Cascade):
    bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s
    observer_bandwidth: float = number(0.0, 1e3, open_low=True)  # rad/s
    heading_bandwidth: float = number(0.0, 100.0, open_low=True)  # rad/s


SPEC = AgentSpec(
    "adrc", "ADRC", ADRC, "auvbench.agents.classical.adrc:ADRCController", knows=("sheet",), pilots=True
)
