"""What an agent collects at another K: its kept test paths, paid once more.

The return of an episode is paid with the K of the agent's training. Of two agents that move alike, the one with K = 100
collects more than the one with K = 1, so "a larger K raises the reward" would hold by definition. Here both are paid
with the same K.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvbench.analysis.evaluations import Damage
from auvbench.analysis.paths import has_paths, paths
from auvbench.analysis.records import Agent, RunRecord
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
            kept = [(e, pay(p, np.array(w), run.config, k)) for e, w, p, _ in found]
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
