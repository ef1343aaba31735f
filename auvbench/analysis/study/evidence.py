"""What a study's claims are judged on: the agents of each algorithm in their cells, and the runs' training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.paths import has_paths, paths
from auvbench.analysis.records import Agent, RunRecord
from auvbench.analysis.study.learning import Episodes, Learning, learning
from auvbench.statistics.intervals import FloatArray

EPISODES = 1000
"""more than any protocol keeps"""


def collected(agent: Agent, k: float) -> FloatArray | None:
    """Return (seeds, kept episodes) of the agent's test paths, paid with K = k; None where paths are missing.

    Equation 2.1 of the original study (docs/task.md) on the positions as kept (float32), with each run's coefficients
    but for K. All runs must have kept the same episodes.
    """
    found = _collected(agent, k)
    return None if found is None else found[1]


def failing_top_by_k(agent: Agent, ks: Sequence[float]) -> dict[float, float] | None:
    """Return, by K, the failing share of the tenth of kept test episodes that K pays best; None without paths.

    The policy is the same for every K, so what changes with K follows from the reward alone.
    """
    shares = {}
    for k in ks:
        found = _collected(agent, k)
        if found is None:
            return None
        episodes, paid = found
        fails = (agent.success[:, episodes] == 0).ravel()
        best = np.argsort(-paid.ravel(), kind="stable")[: max(paid.size // 10, 1)]
        shares[k] = float(fails[best].mean())
    return shares


def _collected(agent: Agent, k: float) -> tuple[list[int], FloatArray] | None:
    """Return the kept episodes and what they pay, (seeds, episodes)."""
    rows: list[FloatArray] = []
    episodes: list[int] | None = None
    for run in agent.runs:
        found = _paid(run, agent.fingerprint, k)
        if found is None or (episodes is not None and found[0] != episodes):
            return None
        episodes = found[0]
        rows.append(found[1])
    return (episodes, np.array(rows)) if rows and episodes else None


def _paid(run: RunRecord, fingerprint: str, k: float) -> tuple[list[int], FloatArray] | None:
    for evaluation in run.evaluations.values():
        if evaluation.fingerprint != fingerprint:
            continue
        if not has_paths(evaluation):
            return None
        names = [str(c["name"]) for c in evaluation.summary["conditions"]]
        condition = "nominal" if "nominal" in names else names[0]
        try:
            found = paths(run.id, evaluation, condition, EPISODES)
            kept = [
                (path.episode, pay(path.position, np.array(path.waypoint), run.config, k)) for path in found
            ]
        except Damage:  # the figures name it
            return None
        return [e for e, _ in kept], np.array([value for _, value in kept])
    return None


def pay(position: FloatArray, waypoint: FloatArray, config: Mapping[str, Any], k: float) -> float:
    """Return the episode return of a path (T + 1, 3) m to a waypoint (3,) m with K = k and a flattened configuration."""
    distance = np.linalg.norm(position - waypoint, axis=1)
    z = position[:, 2]
    low, high = float(config.get("task.depth_low", -60.0)), float(config.get("task.depth_high", -1.0))
    nearer: NDArray[np.bool_] = distance[1:] < distance[:-1]
    approach = k * np.exp(-distance[1:] / float(config.get("reward.length", 20.0)))
    reward = np.where(nearer, approach, float(config.get("reward.regress", -10.0)))
    if z[-1] < low or z[-1] > high:
        reward[-1] = float(config.get("reward.collision", -550.0))
    elif distance[-1] < float(config.get("task.goal_radius", 3.0)):
        reward[-1] = float(config.get("reward.success", 500.0))
    return float(reward.sum())


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
