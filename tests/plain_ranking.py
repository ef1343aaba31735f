"""A ranking by textbook normal intervals: enough to test what is drawn from one, without the real statistics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from auvbench.analysis.effects import learns
from auvbench.analysis.model import Agent, Comparison, Problem, Ranking, Row
from auvbench.analysis.policies import one_policy
from auvbench.statistics.estimate import Estimate


def estimate(values: np.ndarray, confidence: float = 0.95) -> Estimate:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return Estimate(float("nan"), float("nan"), float("nan"), confidence)
    half = 1.96 * float(finite.std()) / np.sqrt(finite.size)
    mean = float(finite.mean())
    return Estimate(mean, mean - half, mean + half, confidence)


def plain_ranking(
    agents: Sequence[Agent], problems: Sequence[Problem] = (), baseline: str | None = None
) -> Ranking:
    estimates = []
    for agent in agents:
        one = {
            f"{name}_rate": estimate((agent.outcome == code) * 1.0)
            for code, name in enumerate(("success", "collision", "timeout"))
        }
        one |= {f"mean_{name}": estimate(values) for name, values in agent.metrics.items()}
        estimates.append(one)
    order = sorted(
        range(len(agents)),
        key=lambda i: (-estimates[i]["success_rate"].value, estimates[i]["mean_steps"].value),
    )
    rows = tuple(
        Row(
            label=agents[i].label,
            key=agents[i].key,
            seeds=tuple(run.seed for run in agents[i].runs),
            run_ids=tuple(run.id for run in agents[i].runs),
            episodes=agents[i].outcome.shape[1],
            rank=place,
            rank_interval=(max(1, place - 1), min(len(agents), place + 1)),
            group="abcdefghijklmnopqrstuvwxyz"[min((place - 1) // 2, 25)],
            estimates=estimates[i],
            trained=learns(agents[i]),
            compared=not one_policy(agents[i]),
        )
        for place, i in enumerate(order, 1)
    )
    ordered = [agents[i] for i in order]
    means = [a.success.mean(axis=0) - 1e-4 * a.metrics["steps"].mean(axis=0) for a in ordered]
    improvement = np.array([[float(np.mean((x > y) + 0.5 * (x == y))) for y in means] for x in means])
    comparisons = tuple(
        Comparison(
            first=agent.label,
            second=baseline,
            metric="success_rate",
            difference=Estimate(0.013, -0.004, 0.031),
            p_value=0.02,
            p_adjusted=0.06,
            probability_of_improvement=Estimate(0.51, 0.48, 0.54),
        )
        for agent in ordered
        if baseline is not None and agent.label != baseline
    )
    return Ranking(
        rows=rows,
        rank_by="success_rate",
        then="mean_steps",
        protocol="test",
        condition="nominal",
        fingerprint=agents[0].fingerprint,
        confidence=0.95,
        baseline=baseline,
        comparisons=comparisons,
        improvement=improvement,
        problems=tuple(problems),
    )
