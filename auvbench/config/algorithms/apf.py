"""Define the agent APF, an artificial potential field: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.pid import PID
from auvbench.config.schema import number


@dataclass(kw_only=True)
class APF(PID):
    influence: float = number(0.1, 1e3)  # m
    repulsion: float = number(0.0, 1e3)  # m3/s


SPEC = AgentSpec("apf", "APF", APF, "auvbench.agents.classical.potential:controller", knows=("sheet",))
