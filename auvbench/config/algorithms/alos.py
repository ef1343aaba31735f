"""Define the agent ALOS: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec
from auvbench.config.algorithms.pid import PID
from auvbench.config.schema import number


@dataclass(kw_only=True)
class ALOS(PID):
    look_ahead: float = number(0.0, 1e4, open_low=True)  # m
    look_ahead_vertical: float = number(0.0, 1e4, open_low=True)  # m
    adaptation: float = number(0.0, 10.0)  # rad/(m s)
    adaptation_vertical: float = number(0.0, 10.0)  # rad/(m s)
    largest_angle: float = number(0.0, 1.5, open_low=True)  # rad


SPEC = AgentSpec("alos", "ALOS", ALOS, "auvbench.agents.classical.alos:controller", knows=("sheet",))
