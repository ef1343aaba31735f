"""Measure how often intervals of interquartile means over conditions and vehicles contain the true value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.special import expit

from auvbench.analysis.records import Agent, RunRecord
from auvbench.analysis.score import Cell, bootstrapped, interquartile
from auvbench.analysis.sources import RunFolder
from benchmarks.statistics.worlds import FloatArray

LEVELS = (0.4, 2.9)
"""logits of the easiest and the hardest condition"""
LUCK, REST = 1.0, 0.3
"""logits by which trainings differ: the same under all conditions, and under each condition"""
PID, RANDOM = 2.5, -2.5
"""logits of the two agents that define the scale, under a condition of 0"""
EPISODES = 200
MANY, OFTEN = 4000, 4000
"""trainings and scenarios that represent all possible ones"""

DESIGNS = {
    "1 vehicle, 12 conditions": (1, 12),
    "3 vehicles, 1 condition": (3, 1),
    "3 vehicles, 4 conditions": (3, 4),
}


def _learner(S: int) -> Agent:
    config = {"algo.name": "ppo", "algo.learns": True, "algo.agent": "stable_baselines3"}
    runs = tuple(
        RunRecord(f"ppo-s{s}", RunFolder(Path("ppo")), "complete", s, config, {"steps": 1}) for s in range(S)
    )
    return Agent("PPO", {"algo": "ppo"}, runs, "f" * 16, np.zeros((S, 1), dtype=np.int8), {}, 1000.0)


def draw(vehicles: int, conditions: int, S: int, rng: np.random.Generator) -> list[Cell]:
    """Return trainings on each vehicle, tested under its conditions, each with its own `EPISODES` scenarios."""
    levels = np.linspace(*LEVELS, vehicles * conditions).reshape(vehicles, conditions)
    cells = []
    for level in levels:
        hard = rng.normal(size=EPISODES)
        trained = level + LUCK * rng.normal(size=(S, 1)) + REST * rng.normal(size=(S, conditions))

        def success(logit: FloatArray, hard: FloatArray = hard) -> FloatArray:
            chance = expit(logit[..., None] + hard)
            return np.asarray(rng.random(chance.shape) < chance, dtype=np.float64)

        cells.append(
            Cell(
                _learner(S),
                success(trained),
                success(level + RANDOM),
                success(level + PID),
                np.zeros(S, dtype=bool),
            )
        )
    return cells


def truth(vehicles: int, conditions: int) -> float:
    """Return the interquartile mean over all possible trainings and scenarios."""
    rng = np.random.default_rng(1)
    levels = np.linspace(*LEVELS, vehicles * conditions).reshape(vehicles, conditions)
    q = (np.arange(OFTEN) + 0.5) / OFTEN
    hard = np.quantile(rng.normal(size=200 * OFTEN), q)

    def rate(logit: FloatArray) -> FloatArray:
        return np.array([float(expit(x + hard).mean()) for x in logit.reshape(-1)]).reshape(logit.shape)

    parts = []
    for level in levels:
        spread = LUCK * rng.normal(size=(MANY, 1)) + REST * rng.normal(size=(MANY, conditions))
        zero, one = rate(level + RANDOM), rate(level + PID)
        parts.append(((rate(level + spread) - zero) / (one - zero)).reshape(-1))
    return float(interquartile(np.concatenate(parts)))


def coverage(vehicles: int, conditions: int, S: int, replications: int, seed: int = 0) -> float:
    """Return the share of intervals of interquartile means that contain the true value."""
    rng = np.random.default_rng(seed)
    true = truth(vehicles, conditions)
    held = 0
    for _ in range(replications):
        e = bootstrapped(draw(vehicles, conditions, S, rng), 0.95, rng, 300)
        held += e.low <= true <= e.high
    return held / replications
