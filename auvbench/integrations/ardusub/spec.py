"""Define the agent ArduSub: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm
from auvbench.config.schema import choice, number


@dataclass(kw_only=True)
class ArduSub(Algorithm):
    sha256: str
    mode: str = choice("guided", "poshold", "alt_hold")
    stick: float = number(0.0, 1e3, open_low=True)  # 1/m, 1/rad
    parameters: dict[str, float]


agent = AgentSpec(
    "ardusub",
    "ArduSub",
    ArduSub,
    "auvbench.integrations.ardusub.agent:ArduSubAgent",
    observes=False,
    teams=False,
    program=True,
    settled="auvbench.integrations.ardusub.sitl:settled",
    check="auvbench.integrations.ardusub.agent:check",
)
