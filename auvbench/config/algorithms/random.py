"""Define the agent with random actions: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm


@dataclass(kw_only=True)
class Random(Algorithm):
    pass


SPEC = AgentSpec("random", "random", Random, "auvbench.agents.classical.random:RandomAgent", observes=False)
