"""What a study's claims are judged on: the agents of each algorithm in their cells, and the runs' training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from auvbench.analysis.records import Agent, RunRecord
from auvbench.analysis.study.learning import Episodes, Learning, learning
from auvbench.analysis.study.relabelled_return import collected, failing_top_by_k
from auvbench.statistics.intervals import FloatArray

FACTORS = {"algo": "algo.name", "reward.k": "reward.k", "step.frequency": "step.frequency"}


@dataclass(eq=False)
class Evidence:
    """Runs and agents of a report, as the claims use them."""

    runs: Sequence[RunRecord]
    agents: Sequence[Agent]
    confidence: float
    seed: int
    _trained: dict[str, list[Learning]] = field(default_factory=dict)
    """by algorithm; reading the records of a long training takes a while, so each is read once"""
    _tests: list[Episodes] | None = None

    def __post_init__(self) -> None:
        """Complete every agent's key with the factors of the grid, read from its runs."""
        self.agents = [_with_factors(agent) for agent in self.agents]

    def of(self, family: str) -> list[Agent]:
        """The agents of an algorithm: those trained as in the thesis (`sac_thesis`) where there are any."""
        names = {str(agent.key["algo"]) for agent in self.agents}
        name = f"{family}_thesis" if f"{family}_thesis" in names else family
        return [agent for agent in self.agents if agent.key["algo"] == name]

    def learnings(self, family: str) -> list[Learning]:
        """The training records of an algorithm's runs, evaluated or not."""
        names = {str(run.config.get("algo.name")) for run in self.runs}
        name = f"{family}_thesis" if f"{family}_thesis" in names else family
        if name not in self._trained:
            mine = [
                run for run in self.runs if run.state == "complete" and run.config.get("algo.name") == name
            ]
            found = (learning(run) for run in sorted(mine, key=lambda run: run.id))
            self._trained[name] = [one for one in found if one is not None]
        return self._trained[name]

    def collected(self, agent: Agent, k: float) -> FloatArray | None:
        """Return (seeds, episodes) of the agent's kept test paths, paid with K = k; None without paths."""
        return collected(agent, k)

    def failing_top_by_k(self, agent: Agent, ks: Sequence[float]) -> dict[float, float] | None:
        """Return, by K, the failing share of the frozen agent's best-paid kept test episodes; None without paths."""
        return failing_top_by_k(agent, ks)

    def attainable(self, limit: float) -> bool:
        """Return whether a control meets the criterion of convergence within a time limit in s.

        The controls are all evaluated policies of the report, controllers included: none of them learns during its
        test. Where no control converges, "did not converge" says nothing about learning.
        """
        return any(np.isfinite(control.converged_at(limit)) for control in self._controls())

    def _controls(self) -> list[Episodes]:
        if self._tests is None:
            self._tests = [
                Episodes(seconds, success, np.zeros(len(seconds)))
                for agent in self.agents
                if "duration_s" in agent.metrics
                for seconds, success in zip(agent.metrics["duration_s"], agent.success > 0, strict=True)
            ]
        return self._tests


def _with_factors(agent: Agent) -> Agent:
    key: dict[str, Any] = {"algo": agent.key.get("algo.name"), **agent.key}
    key.pop("algo.name", None)
    for short, full in FACTORS.items():
        if key.get(short) is None:
            values = {run.config.get(full) for run in agent.runs}
            key[short] = values.pop() if len(values) == 1 else None
    return replace(agent, key=key)


def cell(agent: Agent) -> tuple[float, float]:
    """K and training frequency of an agent; NaN where its runs differ."""
    k, f = agent.key["reward.k"], agent.key["step.frequency"]
    return (float("nan") if k is None else float(k), float("nan") if f is None else float(f))


def cell_of_run(run: RunRecord) -> tuple[float, float]:
    """K and training frequency of a run."""
    k, f = run.config.get("reward.k"), run.config.get("step.frequency")
    return (float("nan") if k is None else float(k), float("nan") if f is None else float(f))
