"""Define the agent `onnx`, whose policy is read from an ONNX file: its schema and its spec."""

from __future__ import annotations

from dataclasses import dataclass

from auvbench.config.algorithms import AgentSpec, Algorithm


@dataclass(kw_only=True)
class ONNX(Algorithm):
    path: str
    sha256: str


SPEC = AgentSpec("onnx", "ONNX policy", ONNX, "auvbench.agents.policy_file:PolicyFile")
